# SPDX-License-Identifier: Apache-2.0
"""
Temperature ceiling for surplus heat: only as warm as is useful.

Heat that the friction brake would waste is free, but useful only in two ways: it brings the battery nearer to its
target, or it makes the battery accept, or deliver, power that its limits would refuse later. A plan that exceeds
its target with free heat is repeated with a ceiling on that heat. The result becomes the plan unless it gives up
more charge than the heat is worth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import searches as native_searches
from bev_preheat.planning.cheapest_steps import whole_charge_wh
from bev_preheat.planning.dynamics import JOULES_PER_WH, native_vehicle, terminal_limits_w
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.trip import BELOW_HIGHEST_K

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# A joule of free heat must bring at least this many joules of charge.
LEAST_GAIN = 0.1
# A plan that arrives no more than this above its target needs no ceiling.
ABOVE_TARGET_K = 0.2
# At most this many ceilings are tried.
MOST_CEILINGS = 3
# The first ceiling aims this far above the target; each next one higher by this factor of the miss.
AIM_K, MORE_AIM = 0.1, 1.2
# A ceiling that is nowhere higher than the previous one by more than this is not tried.
HIGHER_K = 0.01
# A battery is full from this state of charge on.
FULL_SOC = 1.0 - 1e-6
# The plan under a ceiling may miss the target by at most this much more.
MISSED_K = 1e-3
# The run that determines the remaining share of a kelvin starts this much warmer.
WARMER_K = 5.0
# The remaining share of a kelvin counts at least this much.
LEAST_KEPT = 1e-3
# The gain of warmth is computed for this many pieces above the unheated run, the first of 1 K, each one wider than
# the piece before by this factor.
PIECES, WIDER = 32, 1.15
OFFSETS_K = (WIDER ** np.arange(PIECES + 1) - 1.0) / (WIDER - 1.0)


def leave_useless_heat(trip: Trip, state: BatteryState, target_c: float, schedule: Schedule,
                       plan_again: Callable[[Trip], Schedule]) -> Schedule:
    """
    Return a Schedule for a target [deg C], or one with a ceiling on free heat if that loses no benefit.

    `plan_again` plans a Trip from the same state for the same target.
    """
    if not _is_too_warm(trip, target_c, schedule):
        return schedule
    bounded, aim_c = schedule, target_c + AIM_K
    ceiling_c = np.full(len(trip.route), -np.inf)
    for _ in range(MOST_CEILINGS):
        # A battery that is heated less is less full, and warmth may gain more there.
        along_c = find_surplus_ceiling_c(trip, state, aim_c, bounded.soc)
        if not (along_c > ceiling_c + HIGHER_K).any():
            break
        ceiling_c = np.maximum(ceiling_c, along_c)
        bounded = plan_again(trip.changed(surplus_ceiling_c=ceiling_c))
        if _is_as_useful(trip, target_c, bounded, schedule):
            return bounded
        # The remaining share of a kelvin depends on the battery temperature.
        aim_c += MORE_AIM * max(target_c - float(bounded.temperature_c[-1]), 0.0)
    return schedule


def _is_too_warm(trip: Trip, target_c: float, schedule: Schedule) -> bool:
    """Return whether free heat, if there is any, leads beyond the target."""
    is_free = (schedule.heater_power_w > 0.0) & (trip.route.propulsion_power_w < 0.0)
    return bool(is_free.any() and schedule.temperature_c[-1] > target_c + ABOVE_TARGET_K)


def _is_as_useful(trip: Trip, target_c: float, bounded: Schedule, free: Schedule) -> bool:
    """Return whether a Schedule saves more heat than its losses of charge, warmth and power are worth."""
    missed_k, free_missed_k = (target_c - float(run.temperature_c[-1]) for run in (bounded, free))
    if ((bounded.empty_at_s is None) != (free.empty_at_s is None)
            or missed_k > max(free_missed_k, 0.0) + MISSED_K
            or power_deficit(trip, bounded).worst_w > power_deficit(trip, free).worst_w):
        return False
    saved_wh = float((free.drawn_power_w - bounded.drawn_power_w) @ trip.route.duration_s) / JOULES_PER_WH
    lost_wh = float(free.soc[-1] - bounded.soc[-1]) * whole_charge_wh(trip, free)
    return lost_wh <= LEAST_GAIN * max(saved_wh, 0.0)


def find_surplus_ceiling_c(trip: Trip, state: BatteryState, target_c: float, soc: FloatArray) -> FloatArray:
    """
    Return the highest useful temperature of surplus heat at the end of each step [deg C], (N,).

    That is the temperature that reaches the target without further heating, or the one up to which warmth gains
    LEAST_GAIN of the heat in energy that the power limits would refuse at the states of charge `soc` (N + 1,),
    whichever is warmer; never near the highest temperature.
    """
    vehicle = native_vehicle(trip.vehicle)
    start = initial_states(state)[:2 if trip.vehicle.heat_path.is_direct else 4]
    found = None if vehicle is None else native_searches.find_surplus_ceiling(
        vehicle, trip.native, start, target_c, soc)
    if found is not None:
        return found
    idle_w = np.zeros(len(trip.route))
    cool_c, warm_c = (drive_as_planned(
        trip, replace(state, temperature_c=state.temperature_c + warmer_k), idle_w).temperature_c
        for warmer_k in (0.0, WARMER_K))
    kept = np.maximum((warm_c - cool_c) / WARMER_K, LEAST_KEPT)
    coasting_c = cool_c + (target_c - cool_c[-1]) * kept / kept[-1]
    highest_c = trip.vehicle.battery.temperature_range_c[1]
    useful_c = np.maximum(coasting_c, cool_c + _gaining_k(trip, soc, cool_c, kept))[1:]
    ceiling_c: FloatArray = np.minimum(useful_c, max(highest_c - BELOW_HIGHEST_K, min(target_c, highest_c)))
    return ceiling_c


def _gaining_k(trip: Trip, soc: FloatArray, cool_c: FloatArray, kept: FloatArray) -> FloatArray:
    """
    Return how much warmer than an unheated run the battery may be, for energy that pays, (N + 1,) [K].

    -inf if warmth gains nothing. The unheated run has the temperatures `cool_c` [deg C], the battery the states
    of charge `soc`, and `kept` is the share of a kelvin at the start that remains at each instant, each (N + 1,).
    """
    vehicle, duration_s = trip.vehicle, trip.route.duration_s
    battery = vehicle.battery
    temperature_c = np.minimum(
        cool_c[:-1, np.newaxis] + kept[:-1, np.newaxis] * OFFSETS_K, battery.temperature_range_c[1])
    least_w, most_w = (limit_w.reshape(temperature_c.shape) for limit_w in terminal_limits_w(
        vehicle, np.repeat(soc[:-1], PIECES + 1), temperature_c.ravel(),
        np.repeat(trip.power_variance_w2, PIECES + 1)))
    idle_w = trip.idle_power_w[:, np.newaxis]
    passed_w = np.where(idle_w < 0.0, -np.maximum(idle_w, least_w), np.minimum(idle_w, most_w))
    more_j = duration_s[:, np.newaxis] * (passed_w - passed_w[:, :1])
    least_j_per_k = LEAST_GAIN / vehicle.hvch.efficiency * (
        battery.heat_capacity_j_per_k + vehicle.heat_path.coolant_heat_capacity_j_per_k)
    gained_j = np.zeros(PIECES + 1)
    gaining_k = np.full(len(kept), -np.inf)
    is_full = False
    for k in range(len(duration_s) - 1, -1, -1):
        # A battery that accepts more before it is full accepts less afterwards.
        is_full = is_full or bool(soc[k + 1] >= FULL_SOC)
        if trip.idle_power_w[k] >= 0.0 or not is_full:
            gained_j = gained_j + more_j[k]
        gains = np.flatnonzero(np.diff(gained_j) >= least_j_per_k * kept[k] * np.diff(OFFSETS_K))
        if len(gains):
            gaining_k[k] = kept[k] * OFFSETS_K[gains[-1] + 1]
    return gaining_k
