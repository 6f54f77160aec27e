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

from bev_preheat.planning.limits import limits_hold, run_within_limits, watch_limits
from bev_preheat.planning.optimal_switch import ARRIVAL_TOLERANCE_K, plan_optimal_switch
from bev_preheat.planning.value_curve import find_thresholds

# How far thresholds are moved to arrive at the target, and in how many runs.
LARGEST_SHIFT_K = 3.0
MOST_RUNS = 12
# The state of charge to be kept is kept to this.
SOC_TOLERANCE = 1e-7
MOST_TARGETS = 20


def plan_merit_order(trip, state, goal):
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    Where the target would cost the state of charge that is to be kept, the warmest that keeps it.
    """
    schedule = _plan_for_target(trip, state, goal)
    if schedule.soc[-1] >= goal.minimum_arrival_soc:
        return schedule
    return _keep_reserve(trip, state, goal, schedule)


def _plan_for_target(trip, state, goal):
    switch = plan_optimal_switch(trip, state, goal)
    if limits_hold(trip, switch):
        return switch
    watch = watch_limits(trip, switch.soc, switch.temperature_c)
    thresholds = find_thresholds(trip, watch, switch, goal.target_temperature_c)
    return _arrive_at(trip, state, watch, thresholds, goal.target_temperature_c)


def _arrive_at(trip, state, watch, thresholds, target_c):
    """Schedule of the thresholds, moved together so that the run arrives at the target."""
    cap_w = trip.heater_limit_w.tolist()
    low_c, high_c = thresholds.low_c.tolist(), thresholds.high_c.tolist()

    def run(shift_k):
        def paid_power_w(k, temperature_c):
            share = (high_c[k] + shift_k - temperature_c) / (high_c[k] - low_c[k])
            return cap_w[k] * (0.0 if share <= 0.0 else 1.0 if share >= 1.0 else share)

        schedule = run_within_limits(trip, state, watch, paid_power_w, take_surplus=True)
        return schedule, float(schedule.temperature_c[-1]) - target_c

    shift_k, (schedule, excess_k) = 0.0, run(0.0)
    # A kelvin more at the thresholds is about a kelvin more on arrival.
    slope, cold, warm = 1.0, -LARGEST_SHIFT_K, LARGEST_SHIFT_K
    best = schedule
    for _ in range(MOST_RUNS):
        if abs(excess_k) <= ARRIVAL_TOLERANCE_K:
            return schedule
        if excess_k < 0.0:
            cold = shift_k
        else:
            warm, best = shift_k, schedule
        next_k = shift_k - excess_k / slope
        if not cold < next_k < warm:
            next_k = 0.5 * (cold + warm)
        next_schedule, next_excess_k = run(next_k)
        if next_k != shift_k and next_excess_k != excess_k:
            slope = max((next_excess_k - excess_k) / (next_k - shift_k), 0.05)
        shift_k, schedule, excess_k = next_k, next_schedule, next_excess_k
    return best


def _keep_reserve(trip, state, goal, schedule):
    """Schedule of the highest target that keeps the state of charge on arrival."""
    def plan_for(target_c):
        found = _plan_for_target(trip, state, replace(goal, target_temperature_c=target_c))
        return found, float(found.soc[-1]) - goal.minimum_arrival_soc

    # Below what driving alone reaches, only heating that pays for itself is left.
    warm_c, warm_margin = float(schedule.temperature_c[-1]), \
        float(schedule.soc[-1]) - goal.minimum_arrival_soc
    cold_c = trip.vehicle.battery.temperature_range_c[0]
    best, margin = plan_for(cold_c)
    if margin <= 0.0:
        return best
    cold_c, cold_margin = float(best.temperature_c[-1]), margin
    for _ in range(MOST_TARGETS):
        if cold_margin <= SOC_TOLERANCE or warm_c - cold_c <= ARRIVAL_TOLERANCE_K:
            break
        # Energy grows almost in proportion to the temperature.
        share = cold_margin / (cold_margin - warm_margin)
        target_c = cold_c + min(max(share, 0.02), 0.98) * (warm_c - cold_c)
        found, margin = plan_for(target_c)
        if margin >= 0.0:
            best, cold_c, cold_margin = found, target_c, margin
        else:
            warm_c, warm_margin = target_c, margin
    return best
