# SPDX-License-Identifier: Apache-2.0
"""
The search of method `optimal_switch`: off, one partial step, then full power, arriving exactly at the target.

Among all such schedules, the one whose forward run arrives at the target, computed with the NLP's own integrator,
is the NLP's optimum if no limit but the heater's is active (docs/explanation/planning.md). The first guess is the
paper's crossing (found with a second-order step, and with the state of charge after heating); a few forward runs
of the heated part refine it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import SATURATING_FLOATS
from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.planning.dynamics import run_on
from bev_preheat.planning.paper import find_crossing
from bev_preheat.planning.schedule import maximum_from, Schedule
from bev_preheat.tunables import ARRIVAL_TOLERANCE_K, HEATING_ALLOWANCE
from bev_preheat.vehicle.model import heat_with_heater_w, make_midpoint, make_rates, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.trip import Trip


def find_switch(trip: Trip, target_c: float, unheated: Schedule) -> Schedule:
    """
    Return the Schedule whose forward run arrives at the target [deg C], switched on once.

    `unheated` is the Schedule without any heating, ignoring limits. Heat arrives at once.
    """
    idle = unheated.soc, unheated.temperature_c
    if idle[1][-1] >= target_c:
        return unheated
    guess_s = find_crossing(trip, target_c, _terminal_soc(trip, idle, target_c), idle[1], make_midpoint)
    return refine_switching_instant(trip, target_c, idle, guess_s or 0.0)


def _terminal_soc(trip: Trip, idle: tuple[FloatArray, FloatArray], target_c: float) -> float:
    """Return the approximate state of charge on arrival: that of the unheated run less the charge for heating."""
    battery = trip.vehicle.battery
    idle_soc, idle_c = float(idle[0][-1]), float(idle[1][-1])
    heating_j = (HEATING_ALLOWANCE * battery.heat_capacity_j_per_k * (target_c - idle_c)
                 / trip.vehicle.hvch.efficiency)
    voltage_v = battery.open_circuit_voltage.function(SATURATING_FLOATS)(idle_soc, idle_c)
    return max(idle_soc - heating_j / (voltage_v * battery.capacity_as), 0.0)


def refine_switching_instant(trip: Trip, target_c: float, idle: tuple[FloatArray, FloatArray],
                             guess_s: float) -> Schedule:
    """
    Return the Schedule that arrives at the target, from a first guess of the switching instant [s].

    `idle` is the unheated run (soc, temperature_c) that arrives below the target. If heating all the way is not
    enough, the schedule heats all the way.
    """
    def switched_on_at(instant_s: float) -> Trial[Schedule]:
        schedule = _switch_at(trip, idle, instant_s)
        return Trial(instant_s, float(schedule.temperature_c[-1]) - target_c, schedule)

    # The earlier the heater starts, the warmer the battery arrives.
    earliest_s, latest_s = 0.0, float(trip.time_s[-1])
    first = switched_on_at(min(max(guess_s, earliest_s), latest_s))
    return follow_slope(
        earliest_s, latest_s, first, _arrival_slope_k_per_s(trip, first.outcome, first.value),
        switched_on_at, ARRIVAL_TOLERANCE_K).outcome


def _switch_at(trip: Trip, idle: tuple[FloatArray, FloatArray], instant_s: float) -> Schedule:
    """Return the Schedule with one switching instant; before it the run is the unheated one."""
    heater_power_w = maximum_from(trip, instant_s)
    soc, temperature_c = run_on(
        trip, make_runge_kutta_4, *idle, _step_at(trip, instant_s), heater_power_w)
    return Schedule(instant_s, heater_power_w, np.zeros(len(trip.route)), soc, temperature_c,
                    make_runge_kutta_4)


def _arrival_slope_k_per_s(trip: Trip, schedule: Schedule, instant_s: float) -> float:
    """
    Return the estimated change of the arrival temperature with the Schedule's switching instant [K/s].

    The heater's contribution to the rate of change at the switching instant, less the part that leaks until
    arrival, or that a warmer battery saves in Joule heat.
    """
    first = _step_at(trip, instant_s)
    rates = make_rates(trip.vehicle, SATURATING_FLOATS)
    soc, temperature_c = schedule.soc, schedule.temperature_c

    def rate(step: int, warmer_k: float, heater_w: float) -> float:
        return rates(
            soc[step], temperature_c[step] + warmer_k, trip.idle_power_w[step] + heater_w,
            trip.power_variance_w2[step],
            heat_with_heater_w(trip.vehicle, trip.idle_heat_w[step], heater_w),
            trip.leakage_w_per_k[step])[1]

    gained_k_per_s = rate(first, 0.0, trip.heater_limit_w[first]) - rate(first, 0.0, 0.0)
    middle = (first + len(trip.route)) // 2
    full_w = trip.heater_limit_w[middle]
    damping_per_s = rate(middle, 0.0, full_w) - rate(middle, 1.0, full_w)
    return float(-gained_k_per_s * math.exp(
        -damping_per_s * (float(trip.time_s[-1]) - instant_s)))


def _step_at(trip: Trip, instant_s: float) -> int:
    """Return the index of the step in which an instant lies."""
    return min(int(np.searchsorted(trip.time_s, instant_s, side='right')), len(trip.route)) - 1
