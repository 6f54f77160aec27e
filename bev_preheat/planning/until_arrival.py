# SPDX-License-Identifier: Apache-2.0
"""
Heating until arrival, for a heater whose heat arrives late but reaches the battery at the charger.

A plan for the temperature on arrival switches the heater off before it, because heat under way then counts as
lost (`two_switches`). If charging follows, that heat is not lost. The same temperature on arrival is then reached
with a later start, and the heat under way loses little by leakage.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.tunables import (
    ABOVE_TARGET_K,
    HEATING_SHARE,
    LATEST_START_TOLERANCE_K,
    MOST_CHANGED_K,
    MOST_TRIALS,
    POWER_TOLERANCE,
    START_RESOLUTION_S,
)

if TYPE_CHECKING:
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip


def heat_until_arrival(trip: Trip, state: BatteryState, schedule: Schedule, target_c: float) -> Schedule:
    """
    Return a Schedule whose last heating lasts until arrival, with the same temperature on arrival.

    That heating begins later in return. A Schedule without heating for the target [deg C], or one that already
    heats until arrival, is returned unchanged. The result keeps the battery's limits.
    """
    heated = schedule.heater_power_w > HEATING_SHARE * trip.heater_limit_w
    possible = np.flatnonzero(trip.heater_limit_w > 0.0)
    planned_c = float(schedule.temperature_c[-1])
    if not heated.any() or planned_c > target_c + ABOVE_TARGET_K or (
            schedule.heater_power_w[possible[-1]] > (1.0 - POWER_TOLERANCE) * trip.heater_limit_w[possible[-1]]):
        return schedule
    last = int(np.flatnonzero(heated)[-1])
    pauses = possible[(possible < last) & ~heated[possible]]
    first = int(pauses[-1]) + 1 if len(pauses) else 0
    before_w = np.where(np.arange(len(heated)) < first, schedule.heater_power_w, 0.0)
    start_s, arrival_s = float(trip.time_s[first]), float(trip.time_s[-1])

    def from_instant(on_s: float) -> Trial[Schedule]:
        driven = drive_as_planned(
            trip, state, np.maximum(before_w, maximum_between(trip, on_s, arrival_s)))
        return Trial(on_s, float(driven.temperature_c[-1]) - planned_c, driven)

    slope_k_per_s = -trip.vehicle.hvch.efficiency * float(trip.heater_limit_w[possible[-1]]) / (
        trip.vehicle.battery.heat_capacity_j_per_k)
    found = follow_slope(start_s, arrival_s, from_instant(start_s), slope_k_per_s, from_instant,
                         LATEST_START_TOLERANCE_K, START_RESOLUTION_S, MOST_TRIALS)
    if abs(found.excess) > MOST_CHANGED_K:
        return schedule
    return replace(found.outcome, held_back=schedule.held_back)
