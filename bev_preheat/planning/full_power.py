# SPDX-License-Identifier: Apache-2.0
"""
Plans that heat at full power: as soon as possible, or until arrival.

Heating as soon as possible is planned on a route that ends when full power from now on reaches the target,
because only full power reaches it there. Heating until arrival is for a heater whose heat arrives late but
reaches the battery at the charger. A plan for the temperature on arrival switches such a heater off before it,
because heat under way then counts as lost (`two_switches`). If charging follows, that heat is not lost: the same
temperature on arrival is reached with a later start, and the heat under way loses little by leakage.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bev_preheat.numerics import first_true, FloatArray
from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.schedule import HeldBack, Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.route.segments import LIMITS, Route
from bev_preheat.tunables import (
    ABOVE_TARGET_K,
    AIMS_BELOW_K,
    HEATING_SHARE,
    LATEST_START_TOLERANCE_K,
    MOST_CHANGED_K,
    POWER_TOLERANCE,
    SHORTFALL_TOLERANCE_K,
    SPARES,
    START_RESOLUTION_S,
)
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import grid_fed


class FullPower:
    """The battery under the heater's full power from the start of a route on, within its limits."""

    def __init__(self, vehicle: Vehicle, route: Route, state: BatteryState,
                 heater_share: float = 1.0, heat_lag_s: float = 0.0) -> None:
        """Take the arguments of plan_preheating."""
        trip = make_trip(vehicle, route, heater_share)
        self._route, self._lag_s = route, heat_lag_s
        self._time_s = trip.time_s
        run = drive_as_planned(trip, state, trip.heater_limit_w)
        self._temperature_c, self._soc = run.temperature_c, run.soc
        if run.empty_at_s is not None:
            # The temperature if only the heater's power were limited.
            fed_trip = make_trip(grid_fed(vehicle), route, heater_share)
            self._temperature_c = drive_as_planned(
                fed_trip, state, fed_trip.heater_limit_w).temperature_c

    def plan(self, vehicle: Vehicle, goal: Goal, plan_on: Callable[[Route], Plan]) -> Plan:
        """
        Return the Plan that heats at once, as far towards the goal's target as its reserve allows.

        `plan_on(route)` makes a plan on the part of the route that ends there, or on the whole route if the heater
        never reaches the target.
        """
        aim_c = goal.target_temperature_c - AIMS_BELOW_K
        warm_s = self._reached_s(self._temperature_c, aim_c)
        if warm_s is None:
            return plan_on(self._route)
        spent_s = self._reached_s(-self._soc, -(reserve_soc(vehicle, goal) + SPARES))
        if spent_s is None or spent_s >= warm_s:
            plan = plan_on(self._until(warm_s))
            # Some of the last heat is lost on its way to the battery.
            warm_s = self._reached_s(self._temperature_c, aim_c + plan.shortfall_k - AIMS_BELOW_K)
            if self._lag_s == 0.0 or warm_s is None or plan.shortfall_k <= AIMS_BELOW_K:
                return plan
            return plan_on(self._until(warm_s))
        plan = plan_on(self._until(spent_s))
        if plan.shortfall_k <= SHORTFALL_TOLERANCE_K:
            return plan
        return replace(plan, status=Status.SOC_LIMITED, held_back=HeldBack.RESERVE)

    def _reached_s(self, values: FloatArray, wanted: float) -> float | None:
        """Return the first time [s] at which `values` (N + 1,) reach `wanted`; None if they never do."""
        after = first_true(values >= wanted)
        if after is None:
            return None
        return 0.0 if after == 0 else float(np.interp(
            wanted, values[after - 1:after + 1], self._time_s[after - 1:after + 1]))

    def _until(self, end_s: float) -> Route:
        """Return the route until an instant [s], plus the time until that instant's heat has arrived."""
        total_s = self._route.total_duration_s
        end_s = min(max(end_s, LIMITS['duration_s'][0]), total_s)
        route, felt_s = self._route.before(end_s), min(end_s + self._lag_s, total_s)
        # A separate step without heating, because its heat would arrive too late.
        return route if felt_s <= end_s else route.followed_by(
            self._route.before(felt_s).after(end_s))


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
                         LATEST_START_TOLERANCE_K, START_RESOLUTION_S)
    if abs(found.excess) > MOST_CHANGED_K:
        return schedule
    return replace(found.outcome, held_back=schedule.held_back)
