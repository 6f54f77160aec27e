# SPDX-License-Identifier: Apache-2.0
"""
Wants the battery warm for the departures of a week: a source of goals beside the clients of ~/prepare_battery.

It reads the State and returns events for the next step, so the planner does not know the origin of a goal.
Everything but a skipped departure follows from file and clock, and needs no memory across a restart. In doubt
there is no goal, and the report has the reason. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.events import DeparturesSkipped, Event, PreparationEnded, PreparationWanted
from bev_preheat.control.expected_drive import DriveMemory, drives_between
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal, PreparationOutcome
from bev_preheat.control.regime import Regime
from bev_preheat.control.settings import defaults_of
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.tunables import (
    BEGINS_S,
    BEGINS_WITH_PRICES_S,
    CHARGE_FALLS_BY,
    DRIVES_W,
    EARLIEST_NS,
    FURTHEST_SKIP_NS,
    RETRY_S,
)

if TYPE_CHECKING:
    from bev_preheat.control.departures import Departures, GridPrices, Occurrence
    from bev_preheat.control.state import State


class DepartureState(Enum):
    """State of the next departure; the values are the words in diagnostics."""

    NONE = 'none'
    LATER = 'later'
    HELD_OFF = 'held off'
    PREPARING = 'preparing'


class DepartureSource(NamedTuple):
    """
    Turns Departures into goals, one at a time; a value: each look makes another one.

    `departures` are those of the file, `prices` those of energy from the grid, None: unknown. `looked_ns` [ns] is
    the latest look, or the instant until which the planner ran before a restart, None: unknown. `following` is the
    next departure that is not skipped, `skipped_ns` [ns] the instant until which they are. `goal` is the goal that
    was set, and `goal_for` its departure; None: none. `concluded_ns` [ns] is the instant of the latest departure
    whose goal has lasted until then. `refusal` is why the latest goal was refused or lost, `retry_ns` [ns] when it
    is wanted again. `state` is that of the next departure, `reason` why, and `latest` the sentence on the last
    departure that has passed, '' for none yet. `unplugged_soc` is the lowest state of charge since the grid was
    found not to feed the vehicle; None: the file holds.
    """

    departures: Departures
    prices: GridPrices | None = None
    looked_ns: int | None = None
    following: Occurrence | None = None
    skipped_ns: int | None = None
    goal: PreparationGoal | None = None
    goal_for: Occurrence | None = None
    concluded_ns: int = 0
    refusal: str = ''
    retry_ns: int = 0
    state: DepartureState = DepartureState.NONE
    reason: str = 'the planner was not running'
    latest: str = ''
    memory: DriveMemory = DriveMemory()
    unplugged_soc: float | None = None

    def using(self, departures: Departures, prices: GridPrices | None) -> DepartureSource:
        """Return the source of other Departures; a goal that does not fit ends with the next `events`."""
        return self._replace(departures=departures, prices=prices, following=None)

    def given_up(self) -> tuple[Event, ...]:
        """Return the event that ends the current goal, because there are no departures any more."""
        return () if self.goal is None else (PreparationEnded(
            self.goal, PreparationEnding.CANCELED, 'The parameter departures names no file any more.'),)

    # Events

    def events(self, state: State, now_ns: int) -> tuple[DepartureSource, tuple[Event, ...]]:
        """Return the source after an instant [ns], and its events: a goal begins or ends; mostly ()."""
        skipped_ns = state.inbox.choices.skipped_until_ns
        source = self._after_clock(now_ns)._finding_next(skipped_ns, now_ns)._seeing(state)
        if source.goal is not None and state.preparation_goal is not source.goal:
            # A step failed before the goal began.
            source = source._without_goal()
        if source.goal_for is not None and source.goal_for.instant_ns <= now_ns:
            # The preparation concludes itself.
            return source, ()
        judged, reason = source._judge(state, now_ns)
        source, goal = source._replace(state=judged, reason=reason), source.goal
        if judged is not DepartureState.PREPARING:
            return source._without_goal(), () if goal is None else (PreparationEnded(
                goal, PreparationEnding.CANCELED, f'The preparation for a departure has ended: {reason}.'),)
        wanted = source._wanted()
        if goal is not None and _is_same(wanted, goal):
            return source, ()
        # Without a pause it replaces a goal that the file or the evidence has changed.
        return source._replace(goal=wanted, goal_for=source.following), (PreparationWanted(wanted),)

    def noted(self, outcome: PreparationOutcome, state: State, now_ns: int) -> DepartureSource:
        """Return the source after the PreparationOutcome of any goal; `state` is the State after it."""
        goal, goal_for = self.goal, self.goal_for
        if goal is None or outcome.preparation_goal is not goal or goal_for is None:
            return self
        ready_ns, ending, unplugged_soc = goal.ready_at_ns, outcome.ending, self.unplugged_soc
        if ending is PreparationEnding.UNPLUGGED and (
                state.mission is None or not drives_between(state.mission, now_ns, ready_ns)):
            # The charge has fallen: evidence outranks the file, and the battery feeds the heater.
            unplugged_soc = 1.0
        refusal = outcome.explanation.removesuffix('.')
        is_wanted_at_once = ending in (PreparationEnding.REPLACED, PreparationEnding.UNPLUGGED)
        return self._without_goal()._replace(
            latest=f'{self.departures.in_words(goal_for)}: {ending.name}: {outcome.explanation}',
            concluded_ns=ready_ns if ready_ns <= now_ns else 0, refusal=refusal,
            retry_ns=0 if is_wanted_at_once else now_ns + round(RETRY_S * NS_PER_S),
            unplugged_soc=unplugged_soc, state=DepartureState.HELD_OFF, reason=refusal)

    def skip_next(self, state: State, now_ns: int) -> tuple[DeparturesSkipped | None, str]:
        """Return the event that skips the next departure, None without one, and a sentence for the driver."""
        skipped = self._finding_next(state.inbox.choices.skipped_until_ns, now_ns).following
        if skipped is None:
            return None, 'There is no departure to skip.'
        after = next(self.departures.after(skipped.instant_ns))
        return DeparturesSkipped(skipped.instant_ns), (
            f'Skipped: {self.departures.in_words(skipped)}; the next departure is '
            f'{self.departures.in_words(after)}.')

    def unskip(self, now_ns: int) -> tuple[DeparturesSkipped, str]:
        """Return the event that skips no departure any more, and a sentence for the driver."""
        following = self._finding_next(None, now_ns).following
        return DeparturesSkipped(None), 'No departure is skipped. ' + (
            'There is none.' if following is None else
            f'The next departure is {self.departures.in_words(following)}.')

    @property
    def skipped(self) -> str:
        """Names and local times of the skipped departures, '' for none."""
        return '' if self.following is None or self.skipped_ns is None else ', '.join(
            map(self.departures.in_words, self.departures.until(self.skipped_ns - 1, self.skipped_ns)))

    @property
    def is_plugged_in(self) -> bool:
        """Whether the grid is expected to feed the heater until the next departure."""
        return self.following is not None and self.following.departure.is_plugged_in and self.unplugged_soc is None

    def _without_goal(self) -> DepartureSource:
        return self._replace(goal=None, goal_for=None)

    # Clock and calendar

    def _after_clock(self, now_ns: int) -> DepartureSource:
        """Return the source that has noted the departures since the latest look which had no goal."""
        before_ns, source = self.looked_ns, self._replace(looked_ns=now_ns)
        if before_ns is None or before_ns < EARLIEST_NS:
            return source
        if now_ns < before_ns:
            # Set back: results for later instants are void.
            return source._replace(following=None, retry_ns=0, memory=DriveMemory())
        from_ns = max(before_ns, self.skipped_ns or 0, now_ns - FURTHEST_SKIP_NS)
        for passed in self.departures.until(from_ns, now_ns):
            if passed.instant_ns != self.concluded_ns and (
                    self.goal_for is None or self.goal_for.instant_ns != passed.instant_ns):
                source = source._replace(
                    latest=f'{self.departures.in_words(passed)}: not prepared: {self.reason}.')
            source = source._replace(unplugged_soc=None)
        return source

    def _finding_next(self, skipped_ns: int | None, now_ns: int) -> DepartureSource:
        """Return the source with the next departure after those that are skipped until an instant [ns]."""
        if skipped_ns is not None and not now_ns < skipped_ns <= now_ns + FURTHEST_SKIP_NS:
            skipped_ns = None
        following, retry_ns = self.following, self.retry_ns
        if now_ns < EARLIEST_NS:
            following = None
        elif following is None or skipped_ns != self.skipped_ns or following.instant_ns <= now_ns:
            following, retry_ns = next(self.departures.after(skipped_ns or now_ns), None), 0
        return self._replace(following=following, skipped_ns=skipped_ns, retry_ns=retry_ns)

    # Evidence

    def _seeing(self, state: State) -> DepartureSource:
        """Return the source after a look at the vehicle."""
        measurement, command = state.measurement, state.latest_command
        if measurement is None:
            return self
        memory, lowest_soc, soc = self.memory.seen(
            measurement.stamp_ns, measurement.power_w,
            0.0 if command is None else command.total_w), self.unplugged_soc, measurement.state.soc
        if lowest_soc is not None:
            lowest_soc = min(lowest_soc, soc)
            if state.regime.regime is Regime.CHARGING or soc > lowest_soc + CHARGE_FALLS_BY:
                lowest_soc = None
        return self._replace(memory=memory, unplugged_soc=lowest_soc)

    # Judgement

    def _judge(self, state: State, now_ns: int) -> tuple[DepartureState, str]:
        """Return the DepartureState of the next departure, and the reason without full stop."""
        if now_ns < EARLIEST_NS:
            return DepartureState.NONE, 'the clock was never set: it shows a time before 2020'
        if self.following is None:
            return DepartureState.NONE, 'the file has no departures'
        left_s, begins_s = (self.following.instant_ns - now_ns) / NS_PER_S, self._begins_s()
        if left_s > begins_s:
            return DepartureState.LATER, f'its preparation may begin in {duration_text(left_s - begins_s)}'
        obstacle = self._obstacle(state, now_ns)
        if obstacle:
            return DepartureState.HELD_OFF, obstacle
        if self.goal is None and now_ns < self.retry_ns:
            return DepartureState.HELD_OFF, self.refusal
        return DepartureState.PREPARING, 'the battery is prepared' + (
            ' from the grid' if self.is_plugged_in else
            '; it feeds the heater itself, because the charge has fallen' if self.unplugged_soc is not None else
            ' with its own energy')

    def _obstacle(self, state: State, now_ns: int) -> str:
        """Return why the next departure cannot be prepared at an instant [ns]; '' if nothing forbids it."""
        assert self.following is not None
        other = state.preparation_goal
        if not state.is_enabled:
            return 'preheating is switched off through ~/enable'
        if other is not None and other is not self.goal:
            return 'another goal of prepare_battery is active'
        if state.mission is not None and drives_between(state.mission, now_ns, self.following.instant_ns):
            return f'the route plan {state.mission.route_id!r} drives before the departure'
        defaults = defaults_of(state.vehicle, state.settings)
        drive_w, _ = self.memory.propulsion_w(now_ns, defaults.cabin_heating_power_w + defaults.auxiliary_power_w)
        if drive_w > DRIVES_W:
            return f'the vehicle drives: the battery gives {drive_w / 1000.0:.1f} kW'
        if self.goal is None:
            measurement = state.measurement
            if measurement is None:
                return 'no valid battery state has arrived yet'
            timeout_s = state.settings.battery_state_timeout_s
            if not measurement.stamp_ns - timeout_s * NS_PER_S < now_ns < measurement.expires_ns(timeout_s):
                return 'the battery state is too old, or ahead of the clock'
        return ''

    def _begins_s(self) -> float:
        return BEGINS_WITH_PRICES_S if self.prices is not None and self.is_plugged_in else BEGINS_S

    def _wanted(self) -> PreparationGoal:
        assert self.following is not None
        is_plugged_in, departure = self.is_plugged_in, self.following.departure
        return PreparationGoal(
            self.following.instant_ns, departure.target_c, is_plugged_in,
            assumed_ambient_c=self.departures.ambient_c, prices=self.prices if is_plugged_in else None,
            maximum_arrival_temperature_c=departure.most_c)


def _is_same(first: PreparationGoal, second: PreparationGoal) -> bool:
    """Return whether two goals ask for the same."""
    return (first.ready_at_ns, first.target_c, first.most_c, first.is_plugged_in, first.assumed_ambient_c) == (
        second.ready_at_ns, second.target_c, second.most_c, second.is_plugged_in, second.assumed_ambient_c
    ) and first.prices is second.prices
