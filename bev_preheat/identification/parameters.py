# SPDX-License-Identifier: Apache-2.0
"""Thermal parameters of a fit, with priors and bounds in a coordinate: the logarithm if they must be positive."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.tunables import NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# A lag that is left out of a structure [s].
NO_LAG_S = 0.01
# Of a shell that START does not have: share of the heat capacity, and conductance to the core.
NOMINAL_SHELL_SHARE, NOMINAL_SHELL_W_PER_K = 0.25, 300.0
# An estimate this close to a bound, in its coordinate, lies at it.
AT_BOUND = 1e-4


@dataclass(frozen=True)
class Parameter:
    """
    One parameter: its name with unit, START's value, and the prior in its coordinate.

    `is_log`: the coordinate is the logarithm. `deviation` is the prior's standard deviation, `low` and `high` are
    bounds, all in the coordinate. `fixed` is its coordinate where a structure leaves it out. `reason` explains the
    prior, `key` is the key of the vehicle file that it changes.
    """

    name: str
    label: str
    unit: str
    start: float
    is_log: bool
    deviation: float
    low: float
    high: float
    fixed: float
    reason: str
    key: str

    @property
    def prior(self) -> float:
        """Centre of the prior in the coordinate."""
        centre = math.log(self.start) if self.is_log else self.start
        return min(max(centre, self.low), self.high)

    def value(self, coordinate: float) -> float:
        """Return the parameter's value at a coordinate."""
        return math.exp(coordinate) if self.is_log else coordinate

    def bound_at(self, coordinate: float) -> float | None:
        """Return the bound, in the coordinate, at which a coordinate lies; None within them."""
        return next((end for end in (self.low, self.high) if abs(coordinate - end) < AT_BOUND), None)


# Names in the order of the thermal model's inputs.
NAMES = ('heat_capacity', 'leakage', 'leakage_with_speed', 'drivetrain_heat', 'heater_efficiency', 'heat_lag',
         'sensor_lag', 'shell_share', 'shell_conductance')
ALWAYS = NAMES[:5]


class Structure(NamedTuple):
    """The parameters freed beside ALWAYS, and where the sensor of a battery of two masses is."""

    names: tuple[str, ...] = ()
    sensor: str = ''
    drivetrain_in_core: bool = False

    @property
    def has_shell(self) -> bool:
        """Whether the battery has two masses."""
        return self.sensor != ''

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free parameters; of `heat_lag`, which a shell replaces, only if a trip has heating."""
        return (*ALWAYS, *self.names, *(() if self.has_shell else ('heat_lag',)))


# Structures of a vehicle file by name, simple ones first.
STRUCTURES = {
    'one mass': Structure(),
    'one mass, sensor lag': Structure(('sensor_lag',)),
    **{f'two masses, sensor {place}': Structure(NAMES[6:], sensor) for place, sensor in (
        ('on the shell', 'shell'), ('in the core', 'core'), ('at their mean', 'mean'))}}
# The model has the drivetrain's heat in the shell; intervals also contain the values of a car with it in the core.
IN_CORE = ', drivetrain heat in the core'
ALL_STRUCTURES = {**STRUCTURES, **{name + IN_CORE: structure._replace(drivetrain_in_core=True)
                                   for name, structure in STRUCTURES.items() if structure.has_shell}}


def structures_of(vehicle: Vehicle, has_heating: bool) -> list[str]:
    """
    Return the names of the structures to try: that of START first, which stays unless another is clearly better.

    A sensor that shows the mean hardly tells two masses from one, so that structure is only START's own. Without
    heating no heat passes through a shell in amounts that tell it: of nine drives of an i3 two masses explain the
    readings better and miss the arrivals by more, 0.31 K instead of 0.23 K.
    """
    own = next(name for name, structure in STRUCTURES.items()
               if structure.sensor == vehicle.heat_path.sensor_place)
    return [own, *(name for name, structure in STRUCTURES.items() if name != own and structure.sensor != 'mean'
                   and (has_heating or not structure.has_shell))]


def parameters_of(vehicle: Vehicle) -> dict[str, Parameter]:
    """Return the Parameters by name, with priors around a START vehicle."""
    battery, path = vehicle.battery, vehicle.heat_path
    # Coolant or shell warm with the battery.
    capacity = battery.heat_capacity_j_per_k + path.coolant_heat_capacity_j_per_k
    gamma = battery.leakage.gamma_0_w_per_k
    per_speed = battery.leakage.gamma_v_w_per_k_per_mps
    log = math.log
    lag_s = 0.0 if path.is_shell else path.coolant_lag_s
    share = path.shell_share or NOMINAL_SHELL_SHARE
    conductance = path.coolant_conductance_w_per_k if path.is_shell else NOMINAL_SHELL_W_PER_K
    listed = (
        Parameter('heat_capacity', 'heat capacity of battery and coolant', 'J/K', capacity, True, 0.3,
                  log(2e4), log(1e7), log(capacity),
                  'START within 30 %: cells, plates and housing of one size differ by no more',
                  'battery.heat_capacity_j_per_k'),
        Parameter('leakage', 'leakage at stand', 'W/K', max(gamma, 0.5), True, 1.2, log(0.2), log(1000.0),
                  log(max(gamma, 0.5)), 'START within a factor of 3.3: housings range from bare to insulated',
                  'battery.leakage.gamma_0_w_per_k'),
        Parameter('leakage_with_speed', 'leakage with speed', 'W/K per m/s', per_speed, False,
                  max(0.1, per_speed), 0.0, 50.0, per_speed, 'START within itself, at least 0.1 W/K per m/s',
                  'battery.leakage.gamma_v_w_per_k_per_mps'),
        Parameter('drivetrain_heat', 'share of drivetrain power that heats the battery', '',
                  vehicle.drivetrain.heat_share, False, 0.03, 0.0,
                  max(1.0 - vehicle.drivetrain.efficiency, vehicle.drivetrain.heat_share),
                  vehicle.drivetrain.heat_share,
                  'START within 0.03: from 0 (air-cooled drivetrain) to all losses',
                  'drivetrain.heat_recovery_efficiency'),
        Parameter('heater_efficiency', 'heater efficiency', '', vehicle.hvch.efficiency, False, 0.04, 0.3, 1.0,
                  vehicle.hvch.efficiency, 'START within 0.04: losses of heater and hoses', 'hvch.efficiency'),
        Parameter('heat_lag', 'lag of the heat', 's', lag_s or NOMINAL_HEAT_LAG_S, True, 0.7,
                  log(0.5),
                  log(600.0), log(lag_s or NO_LAG_S), 'START, else 40 s, within a factor of 2',
                  'heat_path.coolant_conductance_w_per_k'),
        Parameter('sensor_lag', 'lag of the sensor', 's', path.sensor_lag_s or NOMINAL_SENSOR_LAG_S, True, 0.7,
                  log(0.5), log(600.0), log(path.sensor_lag_s or NO_LAG_S),
                  'START, else 20 s, within a factor of 2',
                  'heat_path.sensor_lag_s'),
        Parameter('shell_share', 'share of the shell in the heat capacity', '', share, False, 0.15, 0.02, 0.8,
                  share, 'START, else a quarter, within 0.15: plates, coolant, housing, outer cells',
                  'thermal.shell_share'),
        # Sources: a housing behind still air has 5 m2 x 10 W/(m2 K); cells on a cooled plate, 0.1 m tall, conduct
        # 20 W/(m K) along their height through 1.5 m2, over a third of that height to their mean.
        Parameter('shell_conductance', 'conductance between shell and core', 'W/K', conductance, True, 1.2,
                  log(10.0), log(2e4), log(conductance),
                  'START, else 300 W/K, within a factor of 3.3: air gap 50, cells on a plate 900',
                  'thermal.conductance_w_per_k'))
    return {parameter.name: parameter for parameter in listed}
