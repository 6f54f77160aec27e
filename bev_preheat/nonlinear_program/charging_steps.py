# SPDX-License-Identifier: Apache-2.0
"""
The steps of a charging session in a nonlinear program, of equal length in a free total time.

The heater's power in each step is free to the program, up to the car's own switch: on below the limit, off above.
The switch is smoothed, because a program needs smooth functions: half the power at the limit, and a tanh within
SWITCH_K on both sides, so that the battery is held close to the limit. Its input is the mean over both ends of a
step of the temperature with the heat under way, which is second-order accurate and always stable.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import casadi

from bev_preheat.charging.equations import (
    heated_c,
    make_charging_rates,
    make_charging_step,
    make_cooling,
    supply_of,
)
from bev_preheat.nonlinear_program.drive_steps import POWER_SCALE_W, SOC_SCALE
from bev_preheat.nonlinear_program.symbols import SMOOTH, smoothed, SYMBOLS
from bev_preheat.vehicle.charging import charging_of, vehicle_at_charger
from bev_preheat.vehicle.heated_step import make_heat_step
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.charging.stop import ChargingStop
    from bev_preheat.nonlinear_program.drive_steps import Blocks, DriveSteps
    from bev_preheat.vehicle import Vehicle

# Half the width of the switch [K].
SWITCH_K = 0.5
TIME_SCALE_S = 1000.0
# Name of each state on the drive and at the charger, and its scale.
STATES = (('soc', 'charging_soc', SOC_SCALE), ('temperature', 'charging_temperature', 1.0),
          ('heater_power', 'charging_heater_power', POWER_SCALE_W),
          ('coolant_excess', 'charging_coolant_excess', 1.0))


@dataclass(frozen=True)
class ChargingSteps:
    """The result of a session in a program: its duration [s] and the energy bought [J]."""

    duration_s: casadi.MX
    bought_j: casadi.MX


def add_charging_steps(drive: DriveSteps, stop: ChargingStop, steps: int, variables: Blocks,
                       constraints: Blocks) -> ChargingSteps:
    """
    Add the steps of the session after a drive to a program, and return the session's result.

    Variables: `charging_time` [s], each state of the drive at the ends of the steps, and for a car that can
    heat at the charger `charging_heater`, the highest power of its heater in each step [W].
    """
    vehicle = drive.vehicle
    duration = variables.variable('charging_time', 1, TIME_SCALE_S)
    duration_s = duration * TIME_SCALE_S
    starts: list[casadi.MX] = []
    ends: list[casadi.MX | None] = []
    for name, charging_name, scale in STATES:
        if not _is_state(vehicle, name):
            starts.append(casadi.MX.zeros(1, steps))
            ends.append(None)
        else:
            later = variables.variable(charging_name, steps, scale)
            starts.append(scale * casadi.horzcat(variables.row(name)[-1], later[:-1]))
            ends.append(later)
    later_ends = [casadi.MX.zeros(1, steps) if end is None else scale * end
                  for end, (_, _, scale) in zip(ends, STATES)]
    most_w = casadi.MX.zeros(1, steps)
    if can_heat(vehicle):
        most_w = POWER_SCALE_W * variables.variable('charging_heater', steps, POWER_SCALE_W)
    *reached, terminal_w, drawn_w = symbolic_charging_step(vehicle, stop).map(steps)(
        *starts, casadi.repmat(duration_s / steps, 1, steps), heated_c(vehicle, *later_ends[1:]), most_w)
    for (_, charging_name, scale), at_end, end in zip(STATES, reached, ends):
        if end is not None:
            constraints.add(f'{charging_name}_defect', at_end / scale - end, scale)
    bought_j = duration_s * (
        casadi.sum2(terminal_w + drawn_w) / steps
        + stop.cabin_heating_power_w + stop.auxiliary_power_w)
    return ChargingSteps(duration_s, bought_j)


def can_heat(vehicle: Vehicle) -> bool:
    """Return whether a vehicle can heat its battery while it charges."""
    return math.isfinite(charging_of(vehicle).heated_below_c)


def _is_state(vehicle: Vehicle, name: str) -> bool:
    path = vehicle.heat_path
    return {'heater_power': path.heater_lag_s > 0.0, 'coolant_excess': path.has_coolant}.get(name, True)


def symbolic_charging_step(vehicle: Vehicle, stop: ChargingStop) -> casadi.Function:
    """
    Return a step of `charging.session`, its switch smoothed, as a CasADi Function.

    Inputs: soc, temperature [deg C], heater power [W], coolant excess [K], duration [s], the temperature with the
    heat under way at its end (`heated_c`) [deg C], and the heater's power below the limit [W]. Outputs: the four
    states at the end, and the means of the power into the terminals and of the power of heater and cooling [W].
    """
    inputs = [casadi.SX.sym(name) for name in (
        'soc', 'temperature_c', 'heater_w', 'excess_k', 'duration_s', 'heated_end_c', 'most_w')]
    soc, temperature_c, heater_w, excess_k, duration_s, heated_end_c, most_w = inputs
    vehicle = vehicle_at_charger(smoothed(vehicle))
    battery, supply_w = vehicle.battery, supply_of(vehicle, stop)
    charging = charging_of(vehicle)
    limit_c = charging.heated_below_c
    rates = make_charging_rates(
        charging.power_limit.function(SYMBOLS), make_cooling(charging.cooling, stop.ambient_c, SMOOTH),
        make_rates(vehicle, SYMBOLS), SMOOTH)
    command_w = casadi.SX(0.0)
    if math.isfinite(limit_c):
        above_k = 0.5 * (heated_c(vehicle, temperature_c, heater_w, excess_k) + heated_end_c) - limit_c
        command_w = 0.5 * most_w * (1.0 - casadi.tanh(above_k / SWITCH_K))
    leakage_w_per_k = battery.leakage.coefficient_w_per_k(0.0)
    idle_heat_w = leakage_w_per_k * stop.ambient_c
    other_heat_w = casadi.SX(0.0)
    if vehicle.heat_path.has_coolant:
        other_heat_w = battery.heat_capacity_j_per_k * rates(
            soc, temperature_c, command_w - supply_w, 0.0, idle_heat_w, leakage_w_per_k)[1]
    drawn_w, arriving_w, heater_end_w, coolant_c = make_heat_step(vehicle, SYMBOLS)(
        heater_w, temperature_c + excess_k, temperature_c, duration_s, command_w, other_heat_w,
        idle_heat_w, leakage_w_per_k)
    soc_end, temperature_end_c, _, powers = make_charging_step(rates)(
        soc, temperature_c, duration_s, drawn_w - supply_w, 0.0, idle_heat_w + arriving_w,
        leakage_w_per_k)
    excess_end_k = (coolant_c - temperature_end_c if vehicle.heat_path.has_coolant else excess_k)
    return casadi.Function('charging_step', inputs, [
        soc_end, temperature_end_c, heater_end_w, excess_end_k, powers.terminal_w, drawn_w + powers.cooling_w])
