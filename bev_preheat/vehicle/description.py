# SPDX-License-Identifier: Apache-2.0
"""
The vehicle: everything that the model knows about one car.

Built and checked by `vehicle.loading` from a YAML file; nothing is checked here.
"""

from dataclasses import dataclass
from math import inf

from bev_preheat.numerics.arithmetic import Curve, Number
from bev_preheat.vehicle.heat_path import DIRECT, HeatPath
from bev_preheat.vehicle.heating_gates import HeatingGates, NO_GATES


@dataclass(frozen=True)
class Leakage:
    """Heat transfer coefficient battery-ambient [W/K]: gamma_0 + gamma_v * speed."""

    gamma_0_w_per_k: float
    gamma_v_w_per_k_per_mps: float

    def coefficient_w_per_k(self, speed_mps: Number) -> Number:
        """Gamma of eq. (3) [W/K] at a speed [m/s]; shape follows the input."""
        return self.gamma_0_w_per_k + self.gamma_v_w_per_k_per_mps * speed_mps


@dataclass(frozen=True)
class Battery:
    """
    The pack.

    Curves are those of `vehicle.curves`, over (state of charge, temperature): open-circuit voltage
    [V], internal resistance [ohm], power limits [W] (discharge positive, charge negative). `resistance` is that of
    the pack: cells, and the `connection_resistance_ohm` of busbars, contactors and connectors.
    `cells_in_series` is None if the file omits it; no equation needs it.
    """

    capacity_ah: float
    heat_capacity_j_per_k: float
    open_circuit_voltage: Curve
    resistance: Curve
    discharge_power_limit: Curve
    charge_power_limit: Curve
    leakage: Leakage
    soc_range: tuple[float, float]
    temperature_range_c: tuple[float, float]
    cells_in_series: int | None = None
    connection_resistance_ohm: float = 0.0

    @property
    def capacity_as(self) -> float:
        """C_b [A s]."""
        return 3600.0 * self.capacity_ah


@dataclass(frozen=True)
class Drivetrain:
    """
    The electric drivetrain: efficiency eta_ed_e, share of its losses that heats the battery.

    Both maximum powers [W] are electrical and positive; the friction brakes take the braking power
    beyond the maximum of regeneration.
    """

    efficiency: float
    heat_recovery_efficiency: float
    maximum_power_w: float
    maximum_regeneration_power_w: float = inf

    @property
    def heat_share(self) -> float:
        """Part of the magnitude of the propulsion power that reaches the battery as heat."""
        return self.heat_recovery_efficiency * (1.0 - self.efficiency)

    def heat_to_battery_w(self, propulsion_power_magnitude_w: Number) -> Number:
        """
        Q_ed of eq. (5) [W] for the mean magnitude of the propulsion power; shape follows the input.

        The paper's equation is signed, so that braking would cool the battery; losses are positive in both
        directions, so the magnitude is used. If the power changes its sign within a step, the
        mean of the magnitude exceeds the magnitude of the mean.
        """
        return self.heat_share * propulsion_power_magnitude_w


@dataclass(frozen=True)
class Hvch:
    """The high-voltage coolant heater: electrical maximum [W] and efficiency to battery heat."""

    maximum_power_w: float
    efficiency: float


@dataclass(frozen=True)
class RoadLoad:
    """Road load: mass, air and tyres (coefficients without a unit)."""

    mass_kg: float
    frontal_area_m2: float
    drag_coefficient: float
    rolling_resistance: float


@dataclass(frozen=True)
class Defaults:
    """Values used if a route or a driver gives none."""

    cabin_heating_power_w: float
    auxiliary_power_w: float
    target_battery_temperature_c: float


@dataclass(frozen=True)
class Cooling:
    """
    Active cooling of the battery at a charger.

    Above `set_point_c` [deg C] its heat flow out of the battery rises with the battery temperature, and reaches
    `cooling_power_w` [W] `proportional_band_k` [K] higher, with `electrical_power_w` [W] from the charger. A
    radiator removes at most `radiator_conductance_w_per_k` [W/K] times the battery's temperature above the air.
    """

    set_point_c: float
    electrical_power_w: float
    cooling_power_w: float
    proportional_band_k: float = 2.0
    radiator_conductance_w_per_k: float = inf

    @property
    def coefficient_of_performance(self) -> float:
        """Heat flow over electrical power."""
        return self.cooling_power_w / self.electrical_power_w


@dataclass(frozen=True)
class Charging:
    """
    A car at a fast charger.

    `power_limit` is the most charging power [W, negative] over (state of charge, temperature): the battery's
    own charge limit if the file has no map for fast charging. `battery_heating`: whether the car can heat its
    battery while it charges, None if the file does not say; `heating_limit_c` is the battery temperature [deg
    C] up to which it does. The car draws at most `maximum_inlet_power_w` [W] from the charger in total.
    `has_own_limit`: the file has a map for fast charging. `power_limit` includes the derating of a hot battery;
    `assumed_fall_c` is the temperature [deg C] from which it falls by assumption, because neither the map nor
    the file says how, else None. `polarization_factor` is the pack's resistance in a session over
    `Battery.resistance`, `cooling` the active cooling, None without.
    """

    power_limit: Curve
    battery_heating: bool | None = None
    heating_limit_c: float | None = None
    maximum_inlet_power_w: float = inf
    has_own_limit: bool = False
    assumed_fall_c: float | None = None
    polarization_factor: float = 1.0
    cooling: Cooling | None = None

    @property
    def heated_below_c(self) -> float:
        """Battery temperature [deg C] below which the car heats; -inf if it never does."""
        if not self.battery_heating or self.heating_limit_c is None:
            return -inf
        return self.heating_limit_c


@dataclass(frozen=True)
class Uncertainty:
    """
    Relative standard deviations of a vehicle file's values, those of the logarithms of the factors on them.

    None: not known for this car. The factors are those of `vehicle.variants`.
    """

    heat_capacity: float | None = None
    leakage: float | None = None
    resistance: float | None = None
    heater_efficiency: float | None = None


UNKNOWN_UNCERTAINTY = Uncertainty()


@dataclass(frozen=True, eq=False, repr=False)
class Vehicle:
    """
    One car; compared by identity, so that derived objects can be cached per vehicle.

    `road_load` is None if the file does not give it: routes with fixed powers can then be
    planned, descriptions of a road cannot. `heat_path` describes the arrival of the heater's heat:
    DIRECT if the file has none; if the file has `thermal`, `battery` is the core. `charging` describes the car
    at a fast charger, None if the file has no such block. `assumed` are the keys of the file whose values were not
    measured or stated for this car. `uncertainty` is that of the file's values. `heating_gates` are the
    car's own conditions for heating; NO_GATES if the file has none.
    """

    name: str
    battery: Battery
    drivetrain: Drivetrain
    hvch: Hvch
    defaults: Defaults
    road_load: RoadLoad | None = None
    assumed: tuple[str, ...] = ()
    heat_path: HeatPath = DIRECT
    charging: Charging | None = None
    uncertainty: Uncertainty = UNKNOWN_UNCERTAINTY
    heating_gates: HeatingGates = NO_GATES

    @property
    def pack_heat_capacity_j_per_k(self) -> float:
        """Heat capacity of the whole battery [J/K]: that of `battery`, and of the shell around it."""
        return self.battery.heat_capacity_j_per_k / (1.0 - self.heat_path.shell_share)

    def __repr__(self) -> str:
        """Return name, heater and the number of assumed values as one line."""
        assumed = f', {len(self.assumed)} values assumed' if self.assumed else ''
        return f'<Vehicle {self.name}: heater {self.hvch.maximum_power_w / 1e3:g} kW{assumed}>'
