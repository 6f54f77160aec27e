# SPDX-License-Identifier: Apache-2.0
"""
Plans for a PreparationGoal: as soon as possible, or fed by the grid.

They use the same planner. "As soon as possible" is planned on a route that ends when full power from now on
reaches the target, because only full power reaches it there. "Plugged in" is planned with a vehicle whose battery
delivers no power.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.local_time import in_words
from bev_preheat.control.target_choice import TargetChoice, TargetSource
from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import OF_GOAL
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_preheating, plan_unheated, SHORTFALL_TOLERANCE_K
from bev_preheat.planning.schedule import HeldBack
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import LIMITS
from bev_preheat.vehicle.grid import grid_fed

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.inputs import Leg
    from bev_preheat.control.preparation_goal import PreparationGoal
    from bev_preheat.control.settings import Settings
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.schedule import StepPrices
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


# If full power exceeded the target by rounding, each new plan would start heating a moment later. So the route
# ends this far below the target [K].
AIMS_BELOW_K = 0.05
# Start of every sentence for a goal.
PREPARING = 'Preparing the battery.'
# State of charge left above the reserve, for the same reason.
SPARES = 1e-4


def is_from_grid(leg: Leg) -> bool:
    """Return whether the grid feeds the heater on a leg."""
    return leg.made_for is not None and leg.made_for.is_plugged_in


def fed(vehicle: Vehicle, preparation_goal: PreparationGoal | None) -> Vehicle:
    """Return the Vehicle to plan a goal with: fed by the grid if the goal is plugged in."""
    return grid_fed(vehicle) if preparation_goal is not None and preparation_goal.is_plugged_in else vehicle


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
        reached = np.flatnonzero(values >= wanted)
        if not len(reached):
            return None
        after = int(reached[0])
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


def plan_preparation(preparation_goal: PreparationGoal, vehicle: Vehicle, route: Route,
                     state: BatteryState, goal: Goal, method: str) -> Plan:
    """Return the Plan for a goal on the route that was made for it; raises as plan_preheating does."""
    vehicle = fed(vehicle, preparation_goal)
    if not preparation_goal.is_soonest:
        plan = plan_preheating(
            vehicle, route, state, goal, method, step_prices=step_prices_of(preparation_goal, route))
    else:
        plan = FullPower(vehicle, route, state).plan(vehicle, goal, lambda part: plan_preheating(
            vehicle, part, state, goal, method))
    return accounted(plan, preparation_goal, state.soc)


def step_prices_of(preparation_goal: PreparationGoal | None, route: Route) -> StepPrices | None:
    """
    Return the mean prices of a goal's steps on a Route that ends at its instant.

    None: the goal is not plugged in, is wanted as soon as possible, or no price until its instant is known.
    """
    if preparation_goal is None or preparation_goal.is_soonest:
        return None
    prices, ready_ns = preparation_goal.prices, preparation_goal.ready_at_ns
    start_ns = ready_ns - round(route.total_duration_s * NS_PER_S)
    if prices is None or not preparation_goal.is_plugged_in or not prices.is_known(start_ns, ready_ns):
        return None
    return partial(prices.step_prices, start_ns)


def in_price_steps(route: Route, preparation_goal: PreparationGoal) -> Route:
    """Return a Route that ends at a goal's instant, divided where the price of energy from the grid changes."""
    if step_prices_of(preparation_goal, route) is None:
        return route
    assert preparation_goal.prices is not None
    ready_ns, shortest_s = preparation_goal.ready_at_ns, LIMITS['duration_s'][0]
    start_ns = ready_ns - round(route.total_duration_s * NS_PER_S)
    for period in preparation_goal.prices.periods(start_ns, ready_ns)[:-1]:
        at_s = (period.until_ns - start_ns) / NS_PER_S
        if np.abs(route.time_s - at_s).min() > shortest_s:
            route = route.before(at_s).followed_by(route.after(at_s))
    return route


def price_note(preparation_goal: PreparationGoal | None, from_ns: int) -> str:
    """Return the sentence on the prices of a goal from an instant [ns] on; '' if they do not count."""
    if preparation_goal is None or preparation_goal.prices is None or preparation_goal.is_soonest or (
            not preparation_goal.is_plugged_in):
        return ''
    prices, ready_ns = preparation_goal.prices, preparation_goal.ready_at_ns
    unknown_ns = prices.unknown_from_ns(from_ns, ready_ns)
    if unknown_ns is None:
        return 'The grid supplies the heat in the cheapest hours.'
    if not prices.is_known(from_ns, ready_ns):
        return 'No price of energy is known until then: heating is as late as possible.'
    return ('The grid supplies the heat in the cheapest hours; no price is known from '
            f'{in_words(unknown_ns, prices.zone)} on, and such an hour counts as the dearest.')


def accounted(plan: Plan, preparation_goal: PreparationGoal | None, soc: float) -> Plan:
    """Return the Plan with the battery's own energy: if the grid feeds the heater, the charge does not change."""
    if preparation_goal is None or not preparation_goal.is_plugged_in:
        return plan
    return replace(plan, soc=np.full(len(plan.soc), soc),
                   energy_wh=replace(plan.energy_wh, joule=0.0, battery_total=0.0))


def target_of_preparation(preparation_goal: PreparationGoal, settings: Settings) -> TargetChoice:
    """Return the TargetChoice of a goal; its target is given or the default, never chosen."""
    if preparation_goal.target_c is not None:
        return TargetChoice(TargetSource.GIVEN, 'The target is given by the goal.')
    if settings.target_temperature_c is not None:
        return TargetChoice(
            TargetSource.GIVEN, 'The target is given by the parameter target_battery_temperature.')
    return TargetChoice(TargetSource.DEFAULT, "The target is the vehicle's default: the goal gives none.")


def in_words_of_preparation(decision: Decision) -> Decision:
    """Return the Decision with sentences for a goal, which do not call its instant an arrival."""
    plan = decision.plan
    if plan is None:
        return replace(decision, sentence=f'{PREPARING} {decision.explanation}')
    plan = plan.told(plan.status, partial(plan.sentence, words=OF_GOAL))
    note = price_note(None if decision.leg is None else decision.leg.made_for, decision.plan_start_ns)
    plan = replace(plan, note=' '.join(filter(None, (plan.note, note))))
    return replace(decision, sentence=f'{PREPARING} {plan.explanation}', plan=plan)


def reserve_before(inputs: AdmittedInputs, now_ns: int, until_ns: int) -> float:
    """
    Return the state of charge to leave at an instant [ns] so that the route's leg keeps its reserve.

    It is the reserve at the leg's end plus the charge that the drive from the instant to there takes.
    """
    mission, measurement = inputs.mission, inputs.measurement
    if mission is None or measurement is None:
        return 0.0
    leg = mission.legs[mission.leg_number(until_ns)]
    start_ns = max(now_ns, leg.start_ns)
    route = leg.route_ahead(start_ns)
    if route is None or not start_ns <= until_ns < leg.arrival_ns:
        return 0.0
    goal = inputs.goal_of(leg)
    reserve = reserve_soc(inputs.vehicle, goal)
    try:
        plan = plan_unheated(inputs.vehicle, route, measurement.state, goal)
    except (InvalidInput, PlanningFailure):
        # Then the goal cannot be planned either, which is reported.
        return reserve
    until_s = (until_ns - start_ns) / NS_PER_S
    # Energy regenerated on a later descent is not available earlier.
    least_soc = plan.soc[plan.time_s >= until_s].min()
    takes = max(0.0, float(np.interp(until_s, plan.time_s, plan.soc) - least_soc))
    return min(reserve + takes, 1.0)
