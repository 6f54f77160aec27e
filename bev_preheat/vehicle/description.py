# SPDX-License-Identifier: Apache-2.0
"""
The vehicle: everything that the model knows about one car, with its heat path and its own conditions for heating.

Built and checked by `vehicle.loading` from a YAML file; nothing is checked here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.numerics import AnyNumber, Curve, FloatArray, Number
from bev_preheat.vehicle.heater_controller import Refusal, SERVED, step_below_w, Verdict


@dataclass(frozen=True)
class HeatPath:
    """
    Time constants of heater and temperature sensor [s]; heat capacity and conductance of coolant.

    All 0 is the paper's heat path: heat arrives at once, and the sensor shows it.

    With a `shell_share` (0 ... 1) of the pack's heat capacity the battery has two masses: the shell takes the
    coolant's place, and the vehicle's `battery` is the core. `sensor_rise` is the sensor's temperature above the
    core's for each kelvin by which the mean of both is above it: 0 in the core, 1 / `shell_share` in the shell.
    """

    heater_lag_s: float = 0.0
    coolant_heat_capacity_j_per_k: float = 0.0
    coolant_conductance_w_per_k: float = 0.0
    sensor_lag_s: float = 0.0
    shell_share: float = 0.0
    sensor_rise: float = 0.0

    @property
    def is_shell(self) -> bool:
        """Whether the battery has two masses."""
        return self.shell_share > 0.0

    @property
    def sensor_place(self) -> str:
        """Where the sensor of a battery of two masses is, as `thermal` of a vehicle file names it; else ''."""
        return '' if not self.is_shell else {0.0: 'core', 1.0: 'mean'}.get(self.sensor_rise, 'shell')

    @property
    def has_coolant(self) -> bool:
        """Whether the heat passes through coolant, or a shell."""
        return self.is_shell or self.coolant_heat_capacity_j_per_k > 0.0

    @cached_property
    def is_direct(self) -> bool:
        """Whether heat arrives without delay."""
        return self.heater_lag_s == 0.0 and not self.has_coolant

    @property
    def coolant_lag_s(self) -> float:
        """Time constant [s] of the coolant at constant battery temperature, or between shell and core."""
        if not self.has_coolant:
            return 0.0
        return (1.0 - self.shell_share) * (self.coolant_heat_capacity_j_per_k / self.coolant_conductance_w_per_k)

    @property
    def heat_lag_s(self) -> float:
        """Total lag of the heat [s]: its mean time from command to battery."""
        return self.heater_lag_s + self.coolant_lag_s


DIRECT = HeatPath()


# The heat source that every vehicle has, beside the names of its `heat_sources`.
HVCH = 'hvch'
# Slower than this a vehicle stands [m/s]: positions and wheel pulses jitter.
STANDING_MPS = 0.3


@dataclass(frozen=True)
class HeatingGates:
    """
    The car heats from `minimum_soc` (0 ... 1) on and up to `maximum_temperature_c` [deg C].

    `only_while_standing`: not in motion. `power_steps_w` [W], ascending: the heater's powers other than 0;
    () for any, one for a heater that is either on or off.
    """

    minimum_soc: float = 0.0
    maximum_temperature_c: float = inf
    only_while_standing: bool = False
    power_steps_w: tuple[float, ...] = ()

    @property
    def is_any(self) -> bool:
        """Whether the vehicle has a gate."""
        return self.looks_at_battery or self.only_while_standing or bool(self.power_steps_w)

    @property
    def looks_at_battery(self) -> bool:
        """Whether a gate depends on the battery's state."""
        return self.minimum_soc > 0.0 or isfinite(self.maximum_temperature_c)

    def step_below_w(self, power_w: float) -> float:
        """Return the highest power [W] that the heater has and that is at most `power_w`."""
        return step_below_w(self.power_steps_w, power_w)

    def verdict(self, soc: float, temperature_c: float, speed_mps: float = 0.0) -> Verdict:
        """Return the Verdict on heating at a charge, a temperature [deg C] and a speed [m/s]; NaN forbids."""
        if self.minimum_soc > 0.0 and not soc >= self.minimum_soc:
            return Verdict(Refusal.LOW_CHARGE, f'the state of charge is {100.0 * soc:.1f} %; this vehicle heats '
                           f'from {100.0 * self.minimum_soc:g} % on')
        if isfinite(self.maximum_temperature_c) and not temperature_c < self.maximum_temperature_c:
            return Verdict(Refusal.HOT_BATTERY, f'the battery is at {temperature_c:.1f} degC; this vehicle heats '
                           f'below {self.maximum_temperature_c:g} degC')
        if self.only_while_standing and not abs(speed_mps) < STANDING_MPS:
            return Verdict(Refusal.IN_MOTION, f'the vehicle moves at {speed_mps:.1f} m/s; it heats only while it '
                           'stands')
        return SERVED


NO_GATES = HeatingGates()


def steps_below_w(steps_w: Sequence[float], power_w: FloatArray) -> FloatArray:
    """Return `step_below_w` for an array of powers [W]."""
    if not steps_w:
        return power_w
    with_off_w = np.array((0.0, *steps_w))
    return with_off_w[np.maximum(np.searchsorted(with_off_w, power_w, side='right') - 1, 0)]


def step_problems(place: str, steps_w: Sequence[float], most_w: float, most: str) -> Iterator[str]:
    """Yield a sentence for implausible steps of power, at a place of a file that also gives their most [W]."""
    if any(not low_w < high_w for low_w, high_w in zip(steps_w, steps_w[1:])):
        yield f'{place}.power_steps_w: {list(steps_w)} must rise from step to step'
    if steps_w and steps_w[-1] > most_w:
        yield f'{place}.power_steps_w: {steps_w[-1]:g} W is above {most}.maximum_power_w, {most_w:g} W'


def gate_problems(gates: HeatingGates, maximum_power_w: float, lowest_c: float) -> Iterator[str]:
    """Yield a sentence for each implausible value; heater [W] and coldest battery [deg C] of the same file."""
    yield from step_problems('heating_gates', gates.power_steps_w, maximum_power_w, HVCH)
    if gates.maximum_temperature_c <= lowest_c:
        yield (f'heating_gates.maximum_temperature_c: {gates.maximum_temperature_c:g} degC is not above the '
               f'lowest temperature of battery.temperature_range_c, {lowest_c:g} degC, so the vehicle would never '
               'heat')


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
class HeatSource:
    """
    A source of battery heat beside the HVCH, or of cold; `vehicle.heat_sources` makes and uses it.

    Curves over (ambient temperature, battery temperature) [deg C]: `maximum_power_w`, electrical, and
    `hvch_watts`, the HVCH power with the heat of one watt of this source; below 0 it `cools`. `only_while` is
    'driving', 'standing' or '' for both; with `shares_cabin_limit` cabin heating comes first. `most_w` is the most
    electrical power [W]. `power_steps_w` are as those of HeatingGates. Once on or off, it stays so for its minimum
    time [s]; `switch_on_wh` [Wh] is the price of a start.
    """

    name: str
    maximum_power_w: Curve
    hvch_watts: Curve
    only_while: str = ''
    shares_cabin_limit: bool = False
    cools: bool = False
    most_w: float = inf
    power_steps_w: tuple[float, ...] = ()
    minimum_on_time_s: float = 0.0
    minimum_off_time_s: float = 0.0
    switch_on_wh: float = 0.0

    def serves_at(self, speed_mps: AnyNumber) -> AnyNumber:
        """Return whether the source may serve at a speed [m/s], a float or an array."""
        return {'driving': speed_mps >= STANDING_MPS, 'standing': speed_mps < STANDING_MPS}.get(
            self.only_while, speed_mps > -inf)

    @property
    def is_switched(self) -> bool:
        """Whether a start or a stop of this source has consequences."""
        return max(self.minimum_on_time_s, self.minimum_off_time_s, self.switch_on_wh) > 0.0


@dataclass(frozen=True)
class RoadLoad:
    """Road load: mass, air and tyres (coefficients without a unit), and the additional drag area of a load."""

    mass_kg: float
    frontal_area_m2: float
    drag_coefficient: float
    rolling_resistance: float
    additional_drag_area_m2: float = 0.0

    @property
    def drag_area_m2(self) -> float:
        """Drag coefficient times frontal area [m^2], with the additional one."""
        return self.drag_coefficient * self.frontal_area_m2 + self.additional_drag_area_m2


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
    With the `curves` of a cooling heat source, its electrical power [W] and its heat flow for each watt over
    (ambient temperature, battery temperature) [deg C], both powers are the source's largest.
    """

    set_point_c: float
    electrical_power_w: float
    cooling_power_w: float
    proportional_band_k: float = 2.0
    radiator_conductance_w_per_k: float = inf
    curves: tuple[Curve, Curve] | None = None

    @property
    def coefficient_of_performance(self) -> float:
        """Heat flow over electrical power."""
        return self.cooling_power_w / self.electrical_power_w


@dataclass(frozen=True)
class Ageing:
    """
    The price of ageing in a charging session, by a published `model` (`charging.ageing`).

    The battery is `age_years` old and has been charged and discharged `full_cycles` times. It ends with the share
    `end_of_life` (0 ... 1) of its capacity, and a new one costs `battery_price`, in the currency of all prices.
    """

    model: str
    battery_price: float
    age_years: float
    full_cycles: float
    end_of_life: float = 0.8

    @property
    def price(self) -> float:
        """Price of the loss of all the capacity, at that of the share that may be lost."""
        return self.battery_price / (1.0 - self.end_of_life)


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
    `Battery.resistance`, `cooling` the active cooling, `ageing` the price of ageing; None without.
    """

    power_limit: Curve
    battery_heating: bool | None = None
    heating_limit_c: float | None = None
    maximum_inlet_power_w: float = inf
    has_own_limit: bool = False
    assumed_fall_c: float | None = None
    polarization_factor: float = 1.0
    cooling: Cooling | None = None
    ageing: Ageing | None = None

    @property
    def heated_below_c(self) -> float:
        """Battery temperature [deg C] below which the car heats; -inf if it never does."""
        if not self.battery_heating or self.heating_limit_c is None:
            return -inf
        return self.heating_limit_c


@dataclass(frozen=True)
class Uncertainty:
    """Relative standard deviations of a file's values, those of the log of factors on them; None: unknown."""

    heat_capacity: float | None = None
    leakage: float | None = None
    resistance: float | None = None
    heater_efficiency: float | None = None
    source_heat: float | None = None


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
    car's own conditions for heating; NO_GATES if the file has none. `heat_sources` are those beside the HVCH.
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
    heat_sources: tuple[HeatSource, ...] = ()

    @property
    def cools(self) -> bool:
        """Whether a heat source cools."""
        return any(source.cools for source in self.heat_sources)

    def gates_of(self, name: str) -> HeatingGates:
        """Return the gates of the heat source of a name: those of heating, none of cooling."""
        cooling = {source.name for source in self.heat_sources if source.cools}
        return NO_GATES if name in cooling else self.heating_gates

    @property
    def pack_heat_capacity_j_per_k(self) -> float:
        """Heat capacity of the whole battery [J/K]: that of `battery`, and of the shell around it."""
        return self.battery.heat_capacity_j_per_k / (1.0 - self.heat_path.shell_share)

    def most_w(self, name: str) -> float:
        """Return the most electrical power [W] of the heat source of a name; raise InvalidInput without one."""
        most_w = {HVCH: self.hvch.maximum_power_w, **{each.name: each.most_w for each in self.heat_sources}}
        if name not in most_w:
            raise InvalidInput(f'heat source {quoted(name)} is not in vehicle {self.name}, which has '
                               f'{", ".join(most_w)}')
        return most_w[name]

    def steps_w(self, name: str) -> tuple[float, ...]:
        """Return the steps of power [W] of the heat source of a name, () for none."""
        return {source.name: source.power_steps_w for source in self.heat_sources}.get(
            name, self.heating_gates.power_steps_w)

    def __repr__(self) -> str:
        """Return name, heater and the number of assumed values as one line."""
        assumed = f', {len(self.assumed)} values assumed' if self.assumed else ''
        return f'<Vehicle {self.name}: heater {self.hvch.maximum_power_w / 1e3:g} kW{assumed}>'
