# SPDX-License-Identifier: Apache-2.0
"""
Pursues a goal of ~/prepare_battery as a trip of the planner's own until the goal ends.

The trip has one leg; its drive is taken from the route or assumed (see `assumed_drive`). It is rebuilt on
every input. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import TYPE_CHECKING

from bev_preheat.control.admitted import find_obstacle
from bev_preheat.control.assumed_drive import drive_of_route, DriveMemory, steady_drive
from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.control.margins import LONGEST_SOONEST_S
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal, PreparationOutcome
from bev_preheat.control.preparation_plan import in_price_steps, reserve_before
from bev_preheat.control.preparation_progress import conclusion, contradiction, PreparationProgress
from bev_preheat.control.timetable import Timetable
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.situation import check_situation, Goal
from bev_preheat.route.segments import LIMITS

if TYPE_CHECKING:
    from bev_preheat.control.admitted import AdmittedInputs
    from bev_preheat.control.decision import Decision
    from bev_preheat.control.inputs import Measurement
    from bev_preheat.control.preparation_progress import Conclusion
    from bev_preheat.route.segments import Route

# The route_id of plans for a goal; no route plan typed by hand has it.
ROUTE_ID = '~/prepare_battery'
# A goal's instant lies at most this far ahead [s].
LONGEST_S = 24 * 3600.0
# A known ambient temperature expires after this time [s].
AMBIENT_KNOWN_S = 6 * 3600.0


class PreparationControl:
    """
    Holds at most one PreparationGoal and builds its `timetable`; None without a goal.

    It also remembers the drive's power and the ambient temperature, which are assumed if no route gives them.
    """

    def __init__(self) -> None:
        """Start without a goal."""
        self.timetable: Timetable | None = None
        self._progress: PreparationProgress | None = None
        self._outcomes: list[PreparationOutcome] = []
        self._memory = DriveMemory()
        # Latest known ambient temperature: (instant [ns], temperature [deg C]).
        self._ambient: tuple[int, float] | None = None
        self._has_lost_time = False

    @property
    def goal(self) -> PreparationGoal | None:
        """The current PreparationGoal; None without one."""
        return None if self._progress is None else self._progress.goal

    def take_outcomes(self) -> tuple[PreparationOutcome, ...]:
        """Return the PreparationOutcomes since the last call, including those of refused goals."""
        if not self._outcomes:
            return ()
        outcomes, self._outcomes = tuple(self._outcomes), []
        return outcomes

    def see(self, measurement: Measurement, heater_w: float, inputs: AdmittedInputs) -> None:
        """Remember power and ambient temperature for a drive without a route; the heater takes `heater_w` [W]."""
        if self.goal is None or not self.goal.is_plugged_in:
            self._memory.see(measurement.stamp_ns, measurement.power_w, heater_w)
        self._note_ambient(inputs.mission, measurement.stamp_ns)

    def _note_ambient(self, mission: Mission | None, now_ns: int) -> None:
        if mission is not None:
            leg = mission.legs[mission.leg_number(now_ns)]
            at = leg.route.segment_at((now_ns - leg.start_ns) / NS_PER_S)
            self._ambient = (min(now_ns, mission.arrival_ns),
                             float(leg.route.ambient_temperature_c[at]))

    def lose_time(self) -> None:
        """Mark the goal to end, because the clock was restarted and its instants are void."""
        self._has_lost_time = True
        self._memory, self._ambient = DriveMemory(), None

    # Beginning and end

    def begin(self, goal: PreparationGoal, inputs: AdmittedInputs, now_ns: int) -> None:
        """Replace the current goal by this one; raise InvalidInput and keep the current one if it is refused."""
        before = self._progress, self.timetable
        try:
            self._begin(goal, inputs, now_ns)
        except InvalidInput as error:
            self._progress, self.timetable = before
            self._note(goal, PreparationEnding.REFUSED, f'The goal was refused: {error}.', inputs)
            raise
        except Exception:
            self._progress, self.timetable = before
            self._note(goal, PreparationEnding.REFUSED, 'The goal was refused: it could not be planned.', inputs)
            raise
        if before[0] is not None:
            self._note(before[0].goal, PreparationEnding.REPLACED, 'A later goal has replaced this one.', inputs,
                       before[0].target_c)

    def _begin(self, goal: PreparationGoal, inputs: AdmittedInputs, now_ns: int) -> None:
        target_c = inputs.defaults.target_battery_temperature_c if goal.target_c is None else goal.target_c
        problems = _problems(goal, now_ns)
        try:
            check_situation(inputs.vehicle, goal=Goal(target_c))
        except InvalidInput as error:
            problems += error.problems
        lowest_c = inputs.vehicle.battery.temperature_range_c[0]
        if goal.ambient_c is not None and goal.ambient_c < lowest_c:
            problems.append(
                f'ambient_temperature: {goal.ambient_c:g} degC is not allowed; it must be at '
                f"least {lowest_c:g} degC: the vehicle's battery is not described below that")
        if problems:
            raise InvalidInput(problems)
        measurement = inputs.measurement
        self._note_ambient(inputs.mission, now_ns)
        self._progress = PreparationProgress(
            goal, target_c, now_ns, measurement.state.soc if measurement else 0.0)
        self._has_lost_time = False
        needs_ambient = goal.is_plugged_in or not _has_route(inputs, now_ns)
        if needs_ambient and self._ambient_c(goal, now_ns) is None:
            raise InvalidInput('ambient_temperature: is not given, and no route has reported one in the '
                               'last 6 h; give it in the goal')
        objection = contradiction(self._progress, inputs, now_ns)
        if objection:
            raise InvalidInput(f'plugged_in: {objection}')
        # A placeholder trip: without any, find_obstacle would report a missing route.
        self.timetable = Timetable.of(Mission(ROUTE_ID, (Leg(steady_drive(1.0, 0.0, inputs.defaults)),)))
        obstacle = find_obstacle(inputs._replace(active_timetable=self.timetable), now_ns)
        if obstacle is not None:
            raise InvalidInput(obstacle.explanation.removesuffix('.'))
        self.revise(inputs, now_ns, 1.0)

    def end(self, goal: PreparationGoal | None, ending: PreparationEnding, explanation: str,
            inputs: AdmittedInputs) -> bool:
        """End the current goal if it is `goal` (None: any goal); return whether it was ended."""
        if self._progress is None or goal not in (None, self._progress.goal):
            return False
        self._note(self._progress.goal, ending, explanation, inputs, self._progress.target_c)
        self._progress = self.timetable = None
        return True

    def conclude(self, inputs: AdmittedInputs, now_ns: int, decision: Decision, obstacle: Decision | None,
                 temperature_c: float | None) -> bool:
        """
        End the goal if its time has come; return whether it has.

        `decision` is the current one, `obstacle` the reason that keeps the heater off (None: no obstacle),
        `temperature_c` the battery's temperature [deg C].
        """
        progress = self._progress
        if progress is None:
            return False
        if self._has_lost_time:
            over: Conclusion = (PreparationEnding.INPUT_LOST,
                                "The clock was set back: the goal's instant is no longer valid.")
        else:
            over = conclusion(progress, inputs, now_ns, decision, obstacle, temperature_c)
        if over is None:
            return False
        ending, explanation = over
        self._note(progress.goal, ending, explanation,
                   inputs, progress.target_c, temperature_c)
        self._progress = self.timetable = None
        return True

    def _note(self, goal: PreparationGoal, ending: PreparationEnding, explanation: str, inputs: AdmittedInputs,
              target_c: float = math.nan, temperature_c: float | None = None) -> None:
        if temperature_c is None:
            measurement = inputs.measurement
            temperature_c = measurement.state.temperature_c if measurement else math.nan
        self._outcomes.append(PreparationOutcome(
            goal, ending, explanation, max(0.0, target_c - temperature_c)
            if math.isfinite(target_c - temperature_c) else math.nan, temperature_c))

    # The trip that is planned for

    def revise(self, inputs: AdmittedInputs, now_ns: int, propulsion_factor: float) -> None:
        """
        Rebuild the trip from the current inputs; do nothing without a goal.

        An assumed drive uses measured power. It is divided by the `propulsion_factor` that the estimator
        found for routes, because planning multiplies by it.
        """
        progress = self._progress
        if progress is None or self._has_lost_time:
            return
        until_ns = progress.goal.ready_at_ns or now_ns + \
            round(LONGEST_SOONEST_S * NS_PER_S)
        if until_ns <= now_ns:
            return
        leg = Leg(self._drive(progress, inputs, now_ns, until_ns, propulsion_factor), progress.started_ns,
                  target_temperature_c=progress.target_c,
                  minimum_arrival_soc=reserve_before(
                      inputs, now_ns, progress.goal.ready_at_ns or progress.expected_ns or now_ns)
                  if not progress.goal.is_plugged_in else 0.0,
                  made_for=progress.goal).in_planning_steps(inputs.settings.planning_step_s)
        self.timetable = Timetable.of(Mission(ROUTE_ID, (replace(
            leg, route=in_price_steps(leg.route, progress.goal)),)))

    def _drive(self, progress: PreparationProgress, inputs: AdmittedInputs, now_ns: int, until_ns: int,
               propulsion_factor: float) -> Route:
        goal, defaults = progress.goal, inputs.defaults
        mission, from_ns = inputs.mission, progress.started_ns
        if mission is not None and not goal.is_plugged_in and _has_route(inputs, now_ns):
            route = drive_of_route(mission, from_ns, until_ns, defaults)
            return route if goal.ambient_c is None else replace(
                route, ambient_temperature_c=0.0 * route.duration_s + goal.ambient_c)
        ambient_c = self._ambient_c(goal, now_ns)
        if ambient_c is not None:
            progress.ambient_c = ambient_c
        # It was known when the goal began, or a route has reported it since.
        assert progress.ambient_c is not None
        propulsion_w = (0.0, 0.0) if goal.is_plugged_in else self._memory.propulsion_w(
            now_ns, defaults.cabin_heating_power_w + defaults.auxiliary_power_w)
        return steady_drive((until_ns - from_ns) / NS_PER_S, progress.ambient_c, defaults, (
            propulsion_w[0] / propulsion_factor, propulsion_w[1] / propulsion_factor))

    def _ambient_c(self, goal: PreparationGoal, now_ns: int) -> float | None:
        """Return the ambient temperature [deg C] of a goal, the last known, or the assumed one; None: unknown."""
        if goal.ambient_c is not None:
            return goal.ambient_c
        if self._ambient is not None and now_ns - self._ambient[0] <= AMBIENT_KNOWN_S * NS_PER_S:
            return self._ambient[1]
        return goal.assumed_ambient_c


def _has_route(inputs: AdmittedInputs, now_ns: int) -> bool:
    timetable = inputs.timetable
    return timetable is not None and timetable.end is None and timetable.mission.arrival_ns > now_ns


def _problems(goal: PreparationGoal, now_ns: int) -> list[str]:
    """Return the problems of a PreparationGoal by itself, as sentences."""
    problems = []
    ahead_s = (goal.ready_at_ns - now_ns) / NS_PER_S
    if not goal.is_soonest and not 0.0 < ahead_s <= LONGEST_S:
        problems.append(
            f'ready_at: lies {duration_text(abs(ahead_s))} {"ahead" if ahead_s > 0.0 else "in the past"}; '
            'it must lie ahead, by at most 24 h (0: as soon as possible)')
    low_c, high_c = LIMITS['ambient_temperature_c']
    if goal.ambient_c is not None and not low_c <= goal.ambient_c <= high_c:
        problems.append(f'ambient_temperature: {goal.ambient_c:g} degC is not allowed; it must be '
                        f'{low_c:g} ... {high_c:g} degC')
    return problems
