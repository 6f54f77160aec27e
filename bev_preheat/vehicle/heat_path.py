# SPDX-License-Identifier: Apache-2.0
"""
How the heater's heat gets into the battery, and what the temperature sensor shows of it.

The paper's heat arrives at once. In a car the heater follows its command late, the coolant between
heater and battery has to get warm first, and the sensor sits on a cell that warms late:

    lag P' = P_command - P                                   electrical power P of the heater
    C_c T_c' = eta P - G (T_c - T_b)                         coolant temperature T_c
    C_b T_b' = G (T_c - T_b) + other heat                    battery, in place of eta P
    lag_s T_s' = T_b - T_s                                   sensor temperature T_s

The coolant's time constant may be a few seconds, far below the steps that plans are made in. So
heater and coolant are not integrated in steps but solved: within a step the command, and all other
heat of the battery, are constant, and what is left is linear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.numerics.arithmetic import Arithmetic, Number

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# Two time constants that are closer than this (relative) are taken this far apart: the solution for
# equal ones has another form, and the same values.
APART = 1e-6

# `step(power_w, coolant_c, temperature_c, duration_s, command_w, other_heat_w)`.
HeatStep = Callable[[Number, Number, Number, Number, Number, Number],
                    tuple[Number, Number, Number, Number]]


@dataclass(frozen=True)
class HeatPath:
    """
    Time constants of heater and temperature sensor [s]; heat capacity and conductance of coolant.

    0 everywhere is the paper's: heat arrives at once, and the sensor shows it.
    """

    heater_lag_s: float = 0.0
    coolant_heat_capacity_j_per_k: float = 0.0
    coolant_conductance_w_per_k: float = 0.0
    sensor_lag_s: float = 0.0

    @property
    def has_coolant(self) -> bool:
        """Whether there is coolant to be warmed."""
        return self.coolant_heat_capacity_j_per_k > 0.0

    @property
    def is_direct(self) -> bool:
        """Whether heat arrives when it is commanded."""
        return self.heater_lag_s == 0.0 and not self.has_coolant


DIRECT = HeatPath()


def make_heat_step(vehicle: Vehicle, arithmetic: Arithmetic[Number]) -> HeatStep[Number]:
    """
    Return one step of heater and coolant of the vehicle's `heat_path`.

    `step(power_w, coolant_c, temperature_c, duration_s, command_w, other_heat_w)` takes the heater's
    power [W], coolant and battery temperature [deg C] at its start, and what is constant within it:
    the command [W], and what else warms the battery [W]. It returns (mean electrical power [W], mean
    heat into the battery [W], electrical power at the end [W], coolant temperature at the end
    [deg C]). The heater's heat goes into battery and coolant, to rounding.
    """
    path = vehicle.heat_path
    exp = arithmetic.exp
    efficiency = vehicle.hvch.efficiency

    def decay(duration_s: Number, time_constant_s: float) -> tuple[Number, Number]:
        """Return what is left of a difference at the end of a step, and on average."""
        left = exp(-duration_s / time_constant_s)
        return left, (1.0 - left) * time_constant_s / duration_s

    def heater(power_w: Number, duration_s: Number,
               command_w: Number) -> tuple[Number, Number]:
        """Return (mean, end) of the heater's power [W]."""
        if path.heater_lag_s == 0.0:
            return command_w, command_w
        left, average = decay(duration_s, path.heater_lag_s)
        behind_w = power_w - command_w
        return command_w + behind_w * average, command_w + behind_w * left

    if not path.has_coolant:
        def direct(power_w: Number, coolant_c: Number, temperature_c: Number, duration_s: Number,
                   command_w: Number,
                   other_heat_w: Number) -> tuple[Number, Number, Number, Number]:
            mean_w, end_w = heater(power_w, duration_s, command_w)
            return mean_w, efficiency * mean_w, end_w, temperature_c

        return direct

    coolant_j_per_k = path.coolant_heat_capacity_j_per_k
    conductance_w_per_k = path.coolant_conductance_w_per_k
    battery_j_per_k = vehicle.battery.heat_capacity_j_per_k
    # Of the difference between coolant and battery, which share one heat.
    rate_per_s = conductance_w_per_k * (1.0 / coolant_j_per_k + 1.0 / battery_j_per_k)
    time_constant_s = 1.0 / rate_per_s
    lag_s = path.heater_lag_s
    if abs(lag_s / time_constant_s - 1.0) < APART:
        lag_s = time_constant_s * (1.0 + APART)

    def through_coolant(
            power_w: Number, coolant_c: Number, temperature_c: Number, duration_s: Number,
            command_w: Number, other_heat_w: Number) -> tuple[Number, Number, Number, Number]:
        mean_w, end_w = heater(power_w, duration_s, command_w)
        excess_k = coolant_c - temperature_c
        # Where the difference settles under the command, and what the heater's lag adds to it.
        settled_k = (efficiency * command_w / coolant_j_per_k
                     - other_heat_w / battery_j_per_k) * time_constant_s
        _, average = decay(duration_s, time_constant_s)
        if lag_s == 0.0:
            mean_excess_k = settled_k + (excess_k - settled_k) * average
        else:
            _, lag_average = decay(duration_s, lag_s)
            lagging_k = (efficiency * (power_w - command_w) / coolant_j_per_k
                         / (rate_per_s - 1.0 / lag_s))
            mean_excess_k = (settled_k + (excess_k - settled_k - lagging_k) * average
                             + lagging_k * lag_average)
        heat_w = conductance_w_per_k * mean_excess_k
        return (mean_w, heat_w, end_w,
                coolant_c + (efficiency * mean_w - heat_w) * duration_s / coolant_j_per_k)

    return through_coolant


def sensor_reading_c(path: HeatPath, reading_c: Number, start_c: Number, end_c: Number,
                     duration_s: Number, arithmetic: Arithmetic[Number]) -> Number:
    """
    Return what a sensor shows [deg C] after a step in which the battery warms evenly.

    `reading_c` is what it showed before, `start_c` and `end_c` are the battery's temperatures.
    """
    if path.sensor_lag_s == 0.0:
        return end_c
    behind_k = (end_c - start_c) * path.sensor_lag_s / duration_s
    left: Number = arithmetic.exp(-duration_s / path.sensor_lag_s)
    return end_c - behind_k + (reading_c - start_c + behind_k) * left
