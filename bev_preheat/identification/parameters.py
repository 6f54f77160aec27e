# SPDX-License-Identifier: Apache-2.0
"""
The thermal parameters of a fit: coordinates, priors, bounds and the reasons for them.

A parameter that must be positive has its logarithm as coordinate.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.tunables import NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# A lag that is left out of a structure [s].
NO_LAG_S = 0.01


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


# Names in the order of the thermal model's inputs.
NAMES = ('heat_capacity', 'leakage', 'leakage_with_speed', 'drivetrain_heat', 'heater_efficiency', 'heat_lag',
         'sensor_lag', 'shell_share', 'shell_conductance')
ALWAYS = NAMES[:5]
# The parameters that each structure frees beside ALWAYS (and the heat's lag, if there is heating).
STRUCTURES = {
    'one mass': (),
    'one mass, sensor lag': ('sensor_lag',),
    'core and shell': ('shell_share', 'shell_conductance')}
# Those that a vehicle file, and with it plans, program, core and simulator, can hold; simple ones first.
IN_THE_FILE = ('one mass', 'one mass, sensor lag')


def parameters_of(vehicle: Vehicle) -> dict[str, Parameter]:
    """Return the Parameters by name, with priors around a START vehicle."""
    battery, path = vehicle.battery, vehicle.heat_path
    # Coolant warms with the battery.
    capacity = battery.heat_capacity_j_per_k + path.coolant_heat_capacity_j_per_k
    gamma = battery.leakage.gamma_0_w_per_k
    per_speed = battery.leakage.gamma_v_w_per_k_per_mps
    log = math.log
    listed = (
        Parameter('heat_capacity', 'heat capacity of battery and coolant', 'J/K', capacity, True, 0.3,
                  log(2e4), log(1e7), log(capacity),
                  'START within 30 %: cells, plates and housing of one size differ by no more',
                  'battery.heat_capacity_j_per_k'),
        Parameter('leakage', 'leakage at stand', 'W/K', max(gamma, 0.5), True, 0.8, log(0.2), log(1000.0),
                  log(max(gamma, 0.5)), 'START within a factor of 2.2: housings range from bare to insulated',
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
        Parameter('heat_lag', 'lag of the heat', 's', path.coolant_lag_s or NOMINAL_HEAT_LAG_S, True, 0.7,
                  log(0.5),
                  log(600.0), log(path.coolant_lag_s or NO_LAG_S), 'START, else 40 s, within a factor of 2',
                  'heat_path.coolant_conductance_w_per_k'),
        Parameter('sensor_lag', 'lag of the sensor', 's', path.sensor_lag_s or NOMINAL_SENSOR_LAG_S, True, 0.7,
                  log(0.5), log(600.0), log(path.sensor_lag_s or NO_LAG_S),
                  'START, else 20 s, within a factor of 2',
                  'heat_path.sensor_lag_s'),
        Parameter('shell_share', 'share of the shell in the heat capacity', '', 0.3, False, 0.15, 0.05, 0.7, 0.3,
                  'a third: plates, housing, outer cells', ''),
        Parameter('shell_conductance', 'conductance from core to shell', 'W/K', 300.0, True, 0.8, log(20.0),
                  log(5000.0), log(300.0), '300 W/K within a factor of 2.2', ''))
    return {parameter.name: parameter for parameter in listed}
