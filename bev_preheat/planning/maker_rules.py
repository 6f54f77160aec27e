# SPDX-License-Identifier: Apache-2.0
"""
Rules by which makers start the battery's heating before a charger, as comparators of plans.

The heater is at full power from an instant that the rule alone decides, until the target or the arrival. Sources:
docs/explanation/worth.md.
"""
from __future__ import annotations

import math
from time import perf_counter
from typing import NamedTuple

import numpy as np

from bev_preheat.planning.limits import drive_as_planned, schedule_within_gates
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import finish_plan
from bev_preheat.planning.situation import BatteryState, check_situation, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.description import Vehicle


class MakerRule(NamedTuple):
    """The heater starts at most `before_s` [s], in cold air `cold_before_s`, and `before_m` [m] before arrival."""

    before_s: float
    cold_before_s: float
    before_m: float = math.inf
    # The warmest cold air [deg C]: 20 degF.
    cold_c: float = -20.0 / 3.0

    def start_s(self, route: Route) -> float:
        """Return the instant on a Route at which the heater starts [s]."""
        end_s = route.total_duration_s
        driven_m = np.concatenate(([0.0], np.cumsum(route.duration_s * route.speed_mps)))
        near_s = float(np.interp(driven_m[-1] - self.before_m, driven_m, route.time_s))
        cold_s = max(end_s - self.cold_before_s, 0.0)
        is_cold = route.ambient_temperature_c[route.segment_at(cold_s)] <= self.cold_c
        return max(cold_s if is_cold else end_s - self.before_s, near_s, 0.0)


MAKER_RULES = {
    '20 min': MakerRule(1200.0, 1200.0),
    '30 min': MakerRule(1800.0, 1800.0),
    '30/60 min': MakerRule(1800.0, 3600.0),
    '30 km': MakerRule(math.inf, math.inf, 30e3)}


def plan_by_rule(name: str, vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal) -> Plan:
    """Return the Plan of a rule of MAKER_RULES, as executed within limits and gates; raises InvalidInput."""
    started = perf_counter()
    check_situation(vehicle, route, state, goal)
    trip = make_trip(vehicle, route)
    wanted_w = maximum_between(trip, MAKER_RULES[name].start_s(route), route.total_duration_s)
    schedule = schedule_within_gates(trip, state, lambda gated: drive_as_planned(
        gated, state, np.minimum(wanted_w, gated.heater_limit_w), below_c=goal.target_temperature_c), {})
    return finish_plan(trip, goal, schedule, name, started)
