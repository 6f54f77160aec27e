# SPDX-License-Identifier: Apache-2.0
"""
Method `merit_order`: heat where a watt-hour of battery energy brings the most.

Algorithm 2 of the paper runs one temperature backward from the target, heated all the way: below it
heating must be on. Here a whole *value curve* runs backward: V_k(T), the battery energy that the
rest of the trip costs from temperature T on, limits and all. Its slope says what a kelvin is worth.
Heating pays in a step where a kelvin is worth more than the heater takes for it, which is so below
one temperature a step, the *threshold*; surplus regeneration costs nothing and is taken first. The
forward run then heats below the threshold.

Without limits, V_N is a step at the target, and its thresholds are the temperatures of Algorithm 2:
the method is `optimal_switch`, and returns just that where no limit is active.
"""

from dataclasses import dataclass

import numpy as np

from bev_preheat.arithmetic import ARRAYS
from bev_preheat.model import make_rates
from bev_preheat.planning.limits import (
    limits_hold, make_terminal_limits, run_within_limits, watch_limits)
from bev_preheat.planning.optimal_switch import ARRIVAL_TOLERANCE_K, plan_optimal_switch

# Steps in which no limit matters are taken together up to this long: the curve changes slowly.
LONGEST_STRIDE_S = 60.0
# A kelvin below the target, or a watt that the battery lacks, costs this many times what the heater
# takes for a kelvin, so that nothing is saved there.
PENALTY = 30.0
# The curve reaches this far beyond the temperatures that the trip can take.
MARGIN_K = 10.0
# Points are dropped from the curve where they say less than this [J].
CURVE_TOLERANCE_J = 100.0
MOST_POINTS = 40
# How far thresholds are moved to arrive at the target, and in how many runs.
LARGEST_SHIFT_K = 3.0
MOST_RUNS = 12


@dataclass(frozen=True)
class Thresholds:
    """
    Heating pays in step k below `low_c[k]` at full power, above `high_c[k]` not at all, shape (N,).

    In between, in proportion: the step in which the threshold is reached.
    """

    low_c: np.ndarray
    high_c: np.ndarray


def plan_merit_order(trip, state, goal):
    """Return the Schedule with the least battery energy that reaches the target within limits."""
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
        heating = False

        def paid_power_w(k, temperature_c):
            # Once the threshold is reached the heater stays on while it pays at all: on the way the
            # temperature follows the lower threshold but for the rounding of the two runs.
            nonlocal heating
            share = (high_c[k] + shift_k - temperature_c) / (high_c[k] - low_c[k])
            if share <= 0.0:
                heating = False
                return 0.0
            if heating or share >= 1.0:
                heating = True
                return cap_w[k]
            heating = True
            return cap_w[k] * share
        schedule = run_within_limits(trip, state, watch, paid_power_w, take_surplus=True)
        return schedule, float(schedule.temperature_c[-1]) - target_c

    shift_k, (schedule, excess_k) = 0.0, run(0.0)
    # Moving all thresholds by a kelvin moves the arrival by about what has not leaked by then; one
    # is a good first guess.
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


@dataclass(frozen=True)
class _Strides:
    """The trip in strides: steps taken together where no limit matters; arrays of shape (M,)."""

    first: np.ndarray
    duration_s: np.ndarray
    columns: tuple
    cap_w: np.ndarray
    propulsion_w: np.ndarray
    soc: np.ndarray
    may_overcharge: np.ndarray
    may_overdraw: np.ndarray


def _make_strides(trip, watch, soc):
    limited = (watch.charge | watch.discharge).tolist()
    durations = trip.route.duration_s.tolist()
    first, length_s, before_limited = [], np.inf, True
    for k, (duration_s, is_limited) in enumerate(zip(durations, limited)):
        if is_limited or before_limited or length_s + duration_s > LONGEST_STRIDE_S:
            first.append(k)
            length_s = 0.0
        length_s += duration_s
        before_limited = is_limited
    first = np.array(first)
    duration_s = np.add.reduceat(trip.route.duration_s, first)

    def mean(values):
        return np.add.reduceat(values * trip.route.duration_s, first) / duration_s

    return _Strides(
        first=first, duration_s=duration_s,
        columns=tuple(mean(column) for column in (
            trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w, trip.leakage_w_per_k)),
        cap_w=mean(trip.heater_limit_w),
        propulsion_w=mean(trip.route.propulsion_power_w),
        soc=soc[:-1][first],
        may_overcharge=watch.charge[first], may_overdraw=watch.discharge[first])


def find_thresholds(trip, watch, run, target_c):
    """
    Return the Thresholds of a trip, by running the value curve backward.

    `run` (a Schedule) says along which states of charge, and about which temperatures, the curve
    is needed. As in Algorithm 2, a step is taken with the rates at its end.
    """
    vehicle = trip.vehicle
    battery, hvch = vehicle.battery, vehicle.hvch
    rates = make_rates(vehicle, ARRAYS)
    limits = make_terminal_limits(vehicle, ARRAYS)
    strides = _make_strides(trip, watch, run.soc)
    price_j_per_k = battery.heat_capacity_j_per_k / hvch.efficiency
    coldest_c = max(min(run.temperature_c.min(), target_c) - MARGIN_K,
                    battery.temperature_range_c[0] + 1e-3)
    warmest_c = max(run.temperature_c.max(), target_c) + 2.0 * MARGIN_K
    curve_c = np.array([coldest_c - MARGIN_K, target_c, warmest_c])
    value_j = np.array([PENALTY * price_j_per_k * (target_c - curve_c[0]), 0.0, 0.0])
    count = len(strides.first)
    low_c, high_c = np.empty(count), np.empty(count)
    for m in range(count - 1, -1, -1):
        duration_s, soc, cap_w = strides.duration_s[m], strides.soc[m], float(strides.cap_w[m])
        power_w, variance_w2, heat_w, leakage_w_per_k = (
            float(column[m]) for column in strides.columns)
        surplus_w, lacking_w, room_w = 0.0, 0.0, cap_w
        if strides.may_overcharge[m] or strides.may_overdraw[m]:
            least_w, most_w = limits(soc, curve_c, variance_w2)
            if strides.may_overcharge[m]:
                surplus_w = np.clip(least_w - power_w, 0.0, -strides.propulsion_w[m])
            lacking_w = np.maximum(power_w - most_w, 0.0)
            room_w = np.clip(most_w - power_w, 0.0, cap_w)
        free_w = np.minimum(cap_w, surplus_w)
        full_w = np.maximum(room_w, free_w)

        def backward(heater_w):
            brake_w = surplus_w - np.minimum(heater_w, surplus_w)
            terminal_w = power_w + heater_w + brake_w
            _, rate, joule_w = rates(
                soc, curve_c, terminal_w, variance_w2,
                heat_w + hvch.efficiency * heater_w
                - vehicle.drivetrain.heat_share * brake_w, leakage_w_per_k)
            return (curve_c - duration_s * rate,
                    value_j + duration_s * (terminal_w + joule_w
                                            + PENALTY * lacking_w))

        idle_c, idle_j = backward(free_w)
        full_c, full_j = backward(full_w)
        # What the heater takes for a kelvin, at each point; nothing where all it can do is free.
        gained_k = idle_c - full_c
        asked = np.where(gained_k > 1e-9, (full_j - idle_j) / np.maximum(gained_k, 1e-9), -np.inf)
        worth = -np.diff(value_j) / np.diff(curve_c)
        pays = worth > asked[1:]
        split = int(pays.sum()) if pays.all() else int(np.argmin(pays))
        low_c[m], high_c[m] = full_c[split], max(idle_c[split], full_c[split] + 1e-9)
        curve_c = np.concatenate((full_c[:split + 1], idle_c[split:]))
        value_j = np.concatenate((full_j[:split + 1], idle_j[split:]))
        curve_c, value_j = _thin_out(curve_c, value_j, coldest_c, warmest_c)
    steps = np.arange(len(trip.route))
    return Thresholds(np.interp(steps, strides.first, low_c),
                      np.interp(steps, strides.first, high_c))


def _thin_out(curve_c, value_j, coldest_c, warmest_c):
    """Drop points that say little, and those that lie beyond what the trip can take."""
    first = max(int(np.searchsorted(curve_c, coldest_c)) - 1, 0)
    last = int(np.searchsorted(curve_c, warmest_c)) + 1
    curve_c, value_j = curve_c[first:last], value_j[first:last]
    if len(curve_c) > MOST_POINTS:
        inner = np.interp(curve_c[1:-1:2], curve_c[::2], value_j[::2])
        error_j = np.abs(value_j[1:-1:2] - inner)
        keep = np.ones(len(curve_c), dtype=bool)
        keep[1:-1:2] = error_j > CURVE_TOLERANCE_J
        curve_c, value_j = curve_c[keep], value_j[keep]
    return curve_c, value_j
