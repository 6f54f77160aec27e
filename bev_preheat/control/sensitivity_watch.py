# SPDX-License-Identifier: Apache-2.0
"""
The sensitivity of the planner's current plan, kept up to date at little cost.

It is for people, not for the command: each look makes one plan at most, and a search begins once a minute.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.control.inputs import goal_of_leg
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.sensitivity import has_sensitivity, search_sensitivity
from bev_preheat.tunables import SENSITIVITY_PERIOD_NS
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from collections.abc import Generator

    from bev_preheat.control.inputs import Leg
    from bev_preheat.control.state import State
    from bev_preheat.planning.sensitivity import Sensitivity

# Key of the sentences in the planner's diagnostics.
SENSITIVITY = 'sensitivity of the plan'


class SensitivityWatch:
    """
    Finds the Sensitivity of the current plan, in parts.

    It plans as the planner does, with the estimated state, the corrected vehicle and the lag of the heat, but
    without the margin for the uncertainty and the limits of the coldest cell. It leaves out plans of preparation
    goals and for a heater that does not obey.
    """

    def __init__(self) -> None:
        """Start without a plan."""
        # Route and number of later legs of the plan.
        self._planned: tuple[str, int] | None = None
        self._search: Generator[None, None, Sensitivity | None] | None = None
        self._begun_ns: int | None = None
        self._sentences = ''

    def look(self, state: State, now_ns: int) -> str:
        """
        Return the latest sentences on the current plan, '' before the first or without one.

        Continues the search by one plan at most.
        """
        decision = state.decision
        mission, leg = state.active_mission, decision.leg
        planned = None
        if mission is not None and leg is not None and _is_followed(state):
            planned = mission.route_id, len(decision.later_legs)
        if planned != self._planned:
            self._planned, self._search, self._begun_ns, self._sentences = planned, None, None, ''
        if leg is None or planned is None:
            return ''
        if self._search is None and (
                self._begun_ns is None or not 0 <= now_ns - self._begun_ns < SENSITIVITY_PERIOD_NS):
            self._search, self._begun_ns = _search(state, leg), now_ns
        if self._search is not None:
            try:
                next(self._search)
            except StopIteration as found:
                self._search = None
                self._sentences = '' if found.value is None else found.value.in_words()
            except (InvalidInput, PlanningFailure, ArithmeticError):
                self._search, self._sentences = None, ''
        return self._sentences


def _search(state: State, leg: Leg) -> Generator[None, None, Sensitivity | None]:
    """Find the Sensitivity of the current plan, as `search_sensitivity` does."""
    decision, vehicle, heat_lag_s = state.decision, state.vehicle, 0.0
    route, plan = leg.route_ahead(decision.plan_start_ns), decision.plan
    if route is None or plan is None:
        return None
    goal = goal_of_leg(leg, vehicle, state.settings)
    if decision.target is not None:
        goal = decision.target.goal(goal)
    if state.estimate is not None:
        *factors, propulsion_factor = decision.model_factors
        vehicle = corrected_vehicle(vehicle, Corrections(*factors))
        route = route.with_propulsion(propulsion_factor)
        heat_lag_s = state.estimate.heat_lag_s if vehicle.heat_path.is_direct else 0.0
    inputs = vehicle, route, plan.start_state, goal
    return (yield from search_sensitivity(
        *inputs, plan_preheating(*inputs, state.settings.method, heat_lag_s=heat_lag_s), heat_lag_s))


def _is_followed(state: State) -> bool:
    """Return whether the current plan is for a leg of a route and for a heater that obeys."""
    decision = state.decision
    return (decision.plan is not None and has_sensitivity(decision.plan) and decision.commanded is None
            and decision.leg is not None and decision.leg.terms.is_trip
            and (state.estimate is None or bool(decision.model_factors)))
