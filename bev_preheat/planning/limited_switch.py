# SPDX-License-Identifier: Apache-2.0
"""
One switching instant within limits: the reference that no plan with active limits may be worse than.

The power that the battery leaves for the heater depends on its temperature, and so on earlier heating. Thresholds
computed along one run may not fit the resulting run, and then cost more than they bring. `optimal_switch` ignores
limits; here its single heating interval is searched again within the limits.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K, follow_slope, Trial
from bev_preheat.planning.dynamics import limits_along, terminal_limits_w
from bev_preheat.planning.heat_run import mean_share_left
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.two_switches import maximum_between

if TYPE_CHECKING:
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# One to three runs are usually enough; a run that is still off the target then is no better than the plan.
MOST_RUNS = 8


def switch_within_limits(trip: Trip, state: BatteryState, target_c: float, planned: Schedule,
                         off_s: float) -> Schedule:
    """
    Return the run within limits that heats from one instant until `off_s` [s] and arrives at the target [deg C].

    It does not heat if driving alone reaches the target, and heats all the way if even that is not enough.
    `planned` is another run within limits, which gives the approximate amount of heating.
    """
    idle = drive_as_planned(trip, state, np.zeros(len(trip.route)), take_surplus=True)
    if idle.temperature_c[-1] >= target_c:
        return idle

    def switched_on_at(on_s: float) -> Trial[Schedule]:
        first, command_w = trip.route.segment_at(on_s), maximum_between(trip, on_s, off_s)
        # Share that the battery can supply; otherwise heating part of a step would equal heating all of it.
        command_w[first] *= _share_given(trip, idle, first)
        # Before the switching instant the run is the unheated one.
        run = drive_as_planned(trip, state, command_w, take_surplus=True, first=first, before=idle)
        return Trial(on_s, float(run.temperature_c[-1]) - target_c, run)

    first = switched_on_at(_guess_s(trip, idle, planned, target_c, off_s))
    slope = -_warmed_k_per_s(trip, idle, first.value)
    return follow_slope(0.0, off_s, first, slope, switched_on_at, ARRIVAL_TOLERANCE_K,
                        most_trials=MOST_RUNS).outcome


def _share_given(trip: Trip, idle: Schedule, step: int) -> float:
    """Return the share of a step's highest command that the battery can supply, in an unheated run's state."""
    at = slice(step, step + 1)
    most_w = float(terminal_limits_w(
        trip.vehicle, idle.soc[at], idle.temperature_c[at], trip.power_variance_w2[at])[1][0])
    # A heater with lag draws only part of its command in this step.
    taken_w = float(trip.heater_limit_w[step]) * (
        1.0 - float(mean_share_left(trip.vehicle.heat_path, trip.route.duration_s[at])[0]))
    room_w = max(most_w - float(trip.idle_power_w[step]), 0.0)
    return room_w / taken_w if room_w < taken_w else 1.0


def _guess_s(trip: Trip, idle: Schedule, planned: Schedule, target_c: float, off_s: float) -> float:
    """Return the instant [s] from which heating until `off_s` takes as much energy as in a planned run."""
    if planned.temperature_c[-1] < target_c - ARRIVAL_TOLERANCE_K:
        # Heating all the way may not be enough either.
        return 0.0
    duration_s = trip.route.duration_s
    room_w = np.minimum(maximum_between(trip, 0.0, off_s), limits_along(trip, planned)[1] - trip.idle_power_w)
    most_j = (room_w - idle.heater_power_w) * duration_s
    left_j = float(((planned.heater_power_w - idle.heater_power_w) * duration_s).cumsum()[-1])
    for k in range(len(duration_s) - 1, -1, -1):
        if most_j[k] > 0.0:
            if left_j <= most_j[k]:
                end_s = min(float(trip.time_s[k + 1]), off_s)
                return end_s - max(left_j, 0.0) / float(most_j[k]) * (end_s - float(trip.time_s[k]))
            left_j -= float(most_j[k])
    return 0.0


def _warmed_k_per_s(trip: Trip, idle: Schedule, on_s: float) -> float:
    """Return how much warmer the battery arrives for each second of earlier heating, approximately."""
    step = trip.route.segment_at(on_s)
    capacity = trip.vehicle.battery.heat_capacity_j_per_k
    left = math.exp(-float(trip.leakage_w_per_k[step]) / capacity * (float(trip.time_s[-1]) - on_s))
    heat_w = trip.vehicle.hvch.efficiency * float(trip.heater_limit_w[step]) * _share_given(trip, idle, step)
    return heat_w / capacity * left
