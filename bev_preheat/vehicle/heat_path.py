# SPDX-License-Identifier: Apache-2.0
"""
The heat path of one vehicle: time constants of heater, coolant or shell, and temperature sensor.

The equations are in `heated_step`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property


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
