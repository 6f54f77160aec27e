# SPDX-License-Identifier: Apache-2.0
"""
Pursues a goal of ~/prepare_battery as a trip of the planner's own until the goal ends; plans those of a week.

The trip has one leg; its drive is taken from the route or assumed (see `expected_drive`). It is rebuilt on
every input. Instants are integers, in nanoseconds of the node's clock.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any, NamedTuple

import numpy as np

from bev_preheat.control.decision import Decision, find_obstacle, Moment
from bev_preheat.control.departures import DAYS_A_WEEK, Departures, GridPrices, Occurrence
from bev_preheat.control.expected_drive import drive_of_route, DriveMemory, steady_drive
from bev_preheat.control.inputs import in_planning_steps, Leg, Measurement, Mission, Terms
from bev_preheat.control.preparation_goal import (
    conclusion,
    contradiction,
    PreparationEnding,
    PreparationGoal,
    PreparationOutcome,
    PreparationProgress,
)
from bev_preheat.control.settings import Settings
from bev_preheat.control.target import TargetChoice, TargetSource
from bev_preheat.control.timetable import Timetable
from bev_preheat.errors import InvalidInput, located, PlanningFailure
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.plan import cost_of, Plan
from bev_preheat.planning.planner import DEFAULT_METHOD, plan_unheated
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.route.segments import LIMITS, Route
from bev_preheat.tunables import (
    AMBIENT_KNOWN_S,
    BEGINS_S,
    BEGINS_WITH_PRICES_S,
    FURTHEST_GOAL_S,
    LONGEST_SOONEST_S,
    PLANNING_STEP_S,
)
from bev_preheat.vehicle.description import Vehicle

# The route_id of plans for a goal; no route plan typed by hand has it.
ROUTE_ID = '~/prepare_battery'


class Preparation(NamedTuple):
    """
    At most one PreparationGoal and its `timetable`; None without a goal. A value: each change makes another one.

    It also remembers the drive's power and the latest known ambient temperature as (instant [ns], [deg C]), which
    are assumed if no route gives them. `outcomes` are those of goals that have ended since they were last taken.
    `has_lost_time`: the clock was restarted, so the goal ends.
    """

    timetable: Timetable | None = None
    progress: PreparationProgress | None = None
    outcomes: tuple[PreparationOutcome, ...] = ()
    memory: DriveMemory = DriveMemory()
    ambient: tuple[int, float] | None = None
    has_lost_time: bool = False

    @property
    def goal(self) -> PreparationGoal | None:
        """The current PreparationGoal; None without one."""
        return None if self.progress is None else self.progress.goal

    def seen(self, measurement: Measurement, heater_w: float, mission: Mission | None) -> Preparation:
        """Remember power and ambient temperature for a drive without a route; the heater takes `heater_w` [W]."""
        memory = self.memory if self.goal is not None and self.goal.is_plugged_in else self.memory.seen(
            measurement.stamp_ns, measurement.power_w, heater_w)
        return self._replace(memory=memory)._with_ambient(mission, measurement.stamp_ns)

    def _with_ambient(self, mission: Mission | None, now_ns: int) -> Preparation:
        if mission is None:
            return self
        leg = mission.legs[mission.leg_number(now_ns)]
        at = leg.route.segment_at((now_ns - leg.start_ns) / NS_PER_S)
        return self._replace(ambient=(
            min(now_ns, mission.arrival_ns), float(leg.route.ambient_temperature_c[at])))

    def without_instants(self) -> Preparation:
        """Return the Preparation whose goal is to end, because the clock was restarted: its instants are void."""
        return self._replace(has_lost_time=True, memory=DriveMemory(), ambient=None)

    # Beginning and end

    def begun(self, goal: PreparationGoal, moment: Moment) -> tuple[Preparation, Exception | None]:
        """Return the Preparation with this goal, or with the current one and the exception that refuses this."""
        try:
            after = self._begun(goal, moment)
        except Exception as error:
            why = error if isinstance(error, InvalidInput) else 'it could not be planned'
            return self._noting(goal, PreparationEnding.REFUSED, f'The goal was refused: {why}.', moment), error
        before = self.progress
        return after if before is None else after._noting(
            before.goal, PreparationEnding.REPLACED, 'A later goal has replaced this one.', moment,
            before.target_c), None

    def _begun(self, goal: PreparationGoal, moment: Moment) -> Preparation:
        now_ns = moment.now_ns
        target_c = moment.defaults.target_battery_temperature_c if goal.target_c is None else goal.target_c
        problems = _problems(goal, now_ns)
        try:
            check_situation(moment.vehicle, goal=Goal(target_c, maximum_arrival_temperature_c=goal.most_c))
        except InvalidInput as error:
            problems += error.problems
        lowest_c = moment.vehicle.battery.temperature_range_c[0]
        if goal.ambient_c is not None and goal.ambient_c < lowest_c:
            problems.append(
                f'ambient_temperature: {goal.ambient_c:g} degC is not allowed; it must be at '
                f"least {lowest_c:g} degC: the vehicle's battery is not described below that")
        if problems:
            raise InvalidInput(problems)
        measurement = moment.measurement
        progress = PreparationProgress(goal, target_c, now_ns, measurement.state.soc if measurement else 0.0)
        after = self._replace(progress=progress, has_lost_time=False)._with_ambient(moment.mission, now_ns)
        needs_ambient = goal.is_plugged_in or not _has_route(moment)
        if needs_ambient and after._ambient_c(goal, now_ns) is None:
            raise InvalidInput('ambient_temperature: is not given, and no route has reported one in the '
                               'last 6 h; give it in the goal')
        objection = contradiction(progress, moment)
        if objection:
            raise InvalidInput(f'plugged_in: {objection}')
        # A placeholder trip: without any, find_obstacle would report a missing route.
        placeholder = Timetable.of(Mission(ROUTE_ID, (Leg(steady_drive(1.0, 0.0, moment.defaults)),)))
        obstacle = find_obstacle(moment._replace(active_timetable=placeholder))
        if obstacle is not None:
            raise InvalidInput(obstacle.explanation.removesuffix('.'))
        return after._replace(timetable=placeholder).revised(moment._replace(estimate=None))

    def ended(self, goal: PreparationGoal | None, ending: PreparationEnding, explanation: str,
              moment: Moment) -> Preparation:
        """Return the Preparation without the current goal if that is `goal` (None: any goal)."""
        if self.progress is None or goal not in (None, self.progress.goal):
            return self
        after = self._noting(self.progress.goal, ending, explanation, moment, self.progress.target_c)
        return after._replace(progress=None, timetable=None)

    def concluded(self, moment: Moment, decision: Decision, obstacle: Decision | None) -> Preparation:
        """Return the Preparation without its goal if its time has come; arguments as of `conclusion`."""
        if self.progress is None:
            return self
        progress, over = conclusion(self.progress, moment, decision, obstacle)
        if self.has_lost_time:
            over = PreparationEnding.INPUT_LOST, "The clock was set back: the goal's instant is no longer valid."
        if over is None:
            return self._replace(progress=progress)
        after = self._noting(progress.goal, *over, moment, progress.target_c, moment.temperature_c)
        return after._replace(progress=None, timetable=None)

    def _noting(self, goal: PreparationGoal, ending: PreparationEnding, explanation: str, moment: Moment,
                target_c: float = math.nan, temperature_c: float | None = None) -> Preparation:
        if temperature_c is None:
            measurement = moment.measurement
            temperature_c = measurement.state.temperature_c if measurement else math.nan
        return self._replace(outcomes=(*self.outcomes, PreparationOutcome(
            goal, ending, explanation, max(0.0, target_c - temperature_c, temperature_c - goal.most_c)
            if math.isfinite(target_c - temperature_c) else math.nan, temperature_c)))

    # The trip that is planned for

    def revised(self, moment: Moment) -> Preparation:
        """Return the Preparation with the trip from the current inputs; without a goal it stays."""
        progress, now_ns = self.progress, moment.now_ns
        if progress is None or self.has_lost_time:
            return self
        until_ns = progress.goal.ready_at_ns or now_ns + round(LONGEST_SOONEST_S * NS_PER_S)
        if until_ns <= now_ns:
            return self
        ambient_c = self._ambient_c(progress.goal, now_ns)
        progress = progress if ambient_c is None else replace(progress, ambient_c=ambient_c)
        terms = terms_of(progress.goal, moment.settings)
        leg = Leg(self._drive(progress, moment, until_ns), progress.started_ns,
                  target_temperature_c=progress.target_c, maximum_arrival_temperature_c=progress.goal.most_c,
                  minimum_arrival_soc=0.0 if terms.is_from_grid else _reserve_before(
                      moment, progress.goal.ready_at_ns or progress.expected_ns or now_ns),
                  terms=terms).in_planning_steps(moment.settings.planning_step_s)
        return self._replace(progress=progress, timetable=Timetable.of(Mission(ROUTE_ID, (replace(
            leg, route=terms.in_price_steps(leg.route)),))))

    def _drive(self, progress: PreparationProgress, moment: Moment, until_ns: int) -> Route:
        goal, defaults = progress.goal, moment.defaults
        mission, from_ns = moment.mission, progress.started_ns
        if mission is not None and not goal.is_plugged_in and _has_route(moment):
            route = drive_of_route(mission, from_ns, until_ns, defaults)
            return route if goal.ambient_c is None else replace(
                route, ambient_temperature_c=0.0 * route.duration_s + goal.ambient_c)
        # It was known when the goal began, or a route has reported it since.
        assert progress.ambient_c is not None
        mean_w, rms_w = (0.0, 0.0) if goal.is_plugged_in else self.memory.propulsion_w(
            moment.now_ns, defaults.cabin_heating_power_w + defaults.auxiliary_power_w)
        # Planning multiplies measured power by the factor that the estimator has found for routes.
        factor = 1.0 if moment.estimate is None else moment.estimate.propulsion_factor
        return steady_drive((until_ns - from_ns) / NS_PER_S, progress.ambient_c, defaults, (
            mean_w / factor, rms_w / factor))

    def _ambient_c(self, goal: PreparationGoal, now_ns: int) -> float | None:
        """Return the ambient temperature [deg C] of a goal, the last known, or the assumed one; None: unknown."""
        if goal.ambient_c is not None:
            return goal.ambient_c
        if self.ambient is not None and now_ns - self.ambient[0] <= AMBIENT_KNOWN_S * NS_PER_S:
            return self.ambient[1]
        return goal.assumed_ambient_c


def _has_route(moment: Moment) -> bool:
    timetable = moment.timetable
    return timetable is not None and timetable.end is None and timetable.mission.arrival_ns > moment.now_ns


def _problems(goal: PreparationGoal, now_ns: int) -> list[str]:
    """Return the problems of a PreparationGoal by itself, as sentences."""
    problems = []
    ahead_s = (goal.ready_at_ns - now_ns) / NS_PER_S
    if not goal.is_soonest and not 0.0 < ahead_s <= FURTHEST_GOAL_S:
        problems.append(
            f'ready_at: lies {duration_text(abs(ahead_s))} {"ahead" if ahead_s > 0.0 else "in the past"}; '
            'it must lie ahead, by at most 24 h (0: as soon as possible)')
    if goal.is_soonest and math.isfinite(goal.most_c):
        problems.append('maximum_arrival_temperature: is not allowed without ready_at')
    low_c, high_c = LIMITS['ambient_temperature_c']
    if goal.ambient_c is not None and not low_c <= goal.ambient_c <= high_c:
        problems.append(f'ambient_temperature: {goal.ambient_c:g} degC is not allowed; it must be '
                        f'{low_c:g} ... {high_c:g} degC')
    return problems


def terms_of(goal: PreparationGoal, settings: Settings) -> Terms:
    """Return the Terms of a goal; its target is given or the default, never chosen."""
    is_given, of_settings = goal.target_c is not None, settings.target_battery_temperature_c is not None
    choice = TargetChoice(
        TargetSource.GIVEN if is_given or of_settings else TargetSource.DEFAULT,
        'The target is given by the goal.' if is_given else
        'The target is given by the parameter target_battery_temperature.' if of_settings else
        "The target is the vehicle's default: the goal gives none.")
    has_prices = goal.is_plugged_in and not goal.is_soonest
    return Terms(False, goal.is_soonest, goal.is_plugged_in, goal.prices if has_prices else None,
                 goal.ready_at_ns, choice)


def _reserve_before(moment: Moment, until_ns: int) -> float:
    """
    Return the state of charge to leave at an instant [ns] so that the route's leg keeps its reserve.

    It is the reserve at the leg's end plus the charge that the drive from the instant to there takes.
    """
    mission, measurement = moment.mission, moment.measurement
    if mission is None or measurement is None:
        return 0.0
    leg = mission.legs[mission.leg_number(until_ns)]
    start_ns = max(moment.now_ns, leg.start_ns)
    route = leg.route_ahead(start_ns)
    if route is None or not start_ns <= until_ns < leg.arrival_ns:
        return 0.0
    goal = moment.goal_of(leg)
    reserve = reserve_soc(moment.vehicle, goal)
    try:
        plan = plan_unheated(moment.vehicle, route, measurement.state, goal)
    except (InvalidInput, PlanningFailure):
        # Then the goal cannot be planned either, which is reported.
        return reserve
    until_s = (until_ns - start_ns) / NS_PER_S
    # Energy regenerated on a later descent is not available earlier.
    least_soc = plan.soc[plan.time_s >= until_s].min()
    takes = max(0.0, float(np.interp(until_s, plan.time_s, plan.soc) - least_soc))
    return min(reserve + takes, 1.0)


WEEK_NS = DAYS_A_WEEK * 86400 * NS_PER_S


@dataclass(frozen=True)
class PreparedDeparture:
    """
    A departure and its Plan, which starts at `start_ns` [ns].

    `cost` is that of the energy from the grid, `latest_cost` that of heating as late as possible, both in the
    currency of the prices; None for a vehicle that is not plugged in, and without prices.
    """

    occurrence: Occurrence
    start_ns: int
    plan: Plan
    cost: float | None
    latest_cost: float | None

    def heating_ns(self) -> list[tuple[int, int]]:
        """Return (begin, end) [ns] of each heating interval."""
        return [(self.start_ns + round(interval.start_s * NS_PER_S),
                 self.start_ns + round(interval.end_s * NS_PER_S)) for interval in self.plan.intervals]

    def as_dictionary(self) -> dict[str, Any]:
        """Return it as JSON-compatible numbers, texts and lists; instants in seconds since 1970."""
        departure, plan = self.occurrence.departure, self.plan
        return {
            'name': departure.name, 'departure_s': self.occurrence.instant_ns / NS_PER_S,
            'plugged_in': departure.is_plugged_in, 'status': plan.status.name,
            'target_c': plan.target_temperature_c, 'temperature_c': plan.arrival_temperature_c,
            'hvch_electric_wh': plan.energy_wh.hvch_electric,
            'heating_s': [[begin / NS_PER_S, end / NS_PER_S] for begin, end in self.heating_ns()],
            'cost': self.cost, 'latest_cost': self.latest_cost}


def prepare_week(vehicle: Vehicle, departures: Departures, prices: GridPrices | None, from_ns: int,
                 soc: float, ambient_c: float | None = None,
                 temperature_c: float | None = None) -> list[PreparedDeparture]:
    """
    Return the PreparedDeparture of each departure within a week of an instant [ns].

    When a preparation may begin, the battery has `soc` (0 ... 1) and `temperature_c` [deg C], None: the ambient
    temperature. `ambient_c` [deg C] None: that of the file. Raises InvalidInput if something is out of range.
    """
    ambient_c = departures.ambient_c if ambient_c is None else ambient_c
    if ambient_c is None:
        raise InvalidInput('--ambient: is missing, and the file of departures has no ambient_temperature_c')
    low_c, high_c = LIMITS['ambient_temperature_c']
    if not low_c <= ambient_c <= high_c:
        raise InvalidInput(
            f'--ambient: {ambient_c:g} degC is not allowed; it must be {low_c:g} ... {high_c:g} degC')
    state = BatteryState(ambient_c if temperature_c is None else temperature_c, soc)
    prepared, free_ns = [], from_ns
    for occurrence in departures.until(from_ns, from_ns + WEEK_NS):
        prepared.append(_prepared(vehicle, occurrence, prices, free_ns, state, ambient_c))
        # The planner prepares one departure at a time.
        free_ns = occurrence.instant_ns
    return prepared


def _prepared(vehicle: Vehicle, occurrence: Occurrence, prices: GridPrices | None, free_ns: int,
              state: BatteryState, ambient_c: float) -> PreparedDeparture:
    departure, ready_ns = occurrence.departure, occurrence.instant_ns
    terms = Terms(is_trip=False, is_from_grid=departure.is_plugged_in, ready_ns=ready_ns,
                  prices=prices if departure.is_plugged_in else None)
    begins_s = BEGINS_S if terms.prices is None else BEGINS_WITH_PRICES_S
    start_ns = max(free_ns, ready_ns - round(begins_s * NS_PER_S))
    route = terms.in_price_steps(in_planning_steps(steady_drive(
        (ready_ns - start_ns) / NS_PER_S, ambient_c, vehicle.defaults), PLANNING_STEP_S))
    target_c = vehicle.defaults.target_battery_temperature_c if departure.target_c is None else departure.target_c
    goal = Goal(target_c, maximum_arrival_temperature_c=math.inf if departure.most_c is None else departure.most_c)
    situation = vehicle, route, state, goal, DEFAULT_METHOD
    with located(f'departure {departure.name}'):
        plan, step_prices = terms.plan(*situation), terms.step_prices(route)
        if step_prices is None:
            return PreparedDeparture(occurrence, start_ns, plan, None, None)
        latest = terms._replace(prices=None).plan(*situation)
    return PreparedDeparture(occurrence, start_ns, plan, cost_of(plan, step_prices), cost_of(latest, step_prices))
