# SPDX-License-Identifier: Apache-2.0
"""
Method `merit_order`: heat where a watt-hour of battery energy brings the most.

Steps in which the battery may not take what the drivetrain regenerates come first: heating with the
surplus costs nothing. Then come those in which a kelvin is worth the most to the rest of the trip
for what it takes (`value_curve`): before a descent, so that a warmer battery takes more of it;
before a climb that the cold battery cannot deliver; and, by leakage, the later the better, before
arrival. Heating stops where the target, the highest temperature or the state of charge to be kept
is met.

Where no limit is active all that is left is the end of the trip: `optimal_switch`, and that is what
is returned.
"""

from dataclasses import replace

import numpy as np

from bev_preheat.planning.forward_runs import ForwardRuns
from bev_preheat.planning.limits import limits_hold, watch_limits, within_limits
from bev_preheat.planning.optimal_switch import ARRIVAL_TOLERANCE_K, plan_optimal_switch
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.value_curve import find_thresholds

# The curve is made again where the run it leads to differs more than this in state of charge.
SOC_AGREEMENT = 5e-4
MOST_PASSES = 3
# The state of charge to be kept is kept to this.
SOC_TOLERANCE = 1e-5
MOST_TARGETS = 8


def plan_merit_order(trip, state, goal):
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    Where the target would cost the state of charge that is to be kept, the warmest that keeps it.
    """
    schedule = _plan_for_target(trip, state, goal)
    if schedule.soc[-1] >= reserve_soc(trip.vehicle, goal):
        return schedule
    return _keep_reserve(trip, state, goal, schedule)


def _plan_for_target(trip, state, goal):
    schedule = plan_optimal_switch(trip, state, goal)
    if limits_hold(trip, schedule):
        return schedule
    for _ in range(MOST_PASSES):
        watch = watch_limits(trip, schedule.soc, schedule.temperature_c)
        thresholds = find_thresholds(trip, watch, schedule, goal.target_temperature_c)
        assumed_soc = schedule.soc
        schedule = ForwardRuns(trip, state, watch, thresholds).settle(goal.target_temperature_c)
        # Limits depend on the state of charge, and the curve was made for another.
        if np.abs(schedule.soc - assumed_soc).max() <= SOC_AGREEMENT:
            break
    return within_limits(trip, state, schedule)


def _keep_reserve(trip, state, goal, schedule):
    """Schedule of the highest target that keeps the state of charge on arrival."""
    reserve = reserve_soc(trip.vehicle, goal)

    def plan_for(target_c):
        found = _plan_for_target(trip, state, replace(goal, target_temperature_c=target_c))
        return found, float(found.soc[-1]) - reserve

    warm_c, lacking = float(schedule.temperature_c[-1]), reserve - float(schedule.soc[-1])
    # Below what driving alone reaches, only heating that pays for itself is left.
    best, margin = plan_for(float(schedule.temperature_c.min()) - 1.0)
    if margin <= 0.0:
        # What is left is heating for climbs, which the other plan may do with less.
        return max(best, schedule, key=lambda each: each.soc[-1])
    cold_c = float(best.temperature_c[-1])
    for _ in range(MOST_TARGETS):
        if margin <= SOC_TOLERANCE or warm_c - cold_c <= ARRIVAL_TOLERANCE_K:
            break
        # Energy grows almost in proportion to the temperature; a side that has stood still for a
        # step counts half (Illinois), or the other would creep.
        target_c = cold_c + margin / (margin + lacking) * (warm_c - cold_c)
        found, next_margin = plan_for(target_c)
        if next_margin >= 0.0:
            best, cold_c, margin, lacking = found, target_c, next_margin, 0.5 * lacking
        else:
            warm_c, lacking, margin = target_c, -next_margin, 0.5 * margin
    return best
