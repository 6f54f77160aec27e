# SPDX-License-Identifier: Apache-2.0
"""
Wants the battery warm for the departures of a week: a source of goals beside the clients of ~/prepare_battery.

It reads the State and returns events for the next step, so the planner does not know the origin of a goal.
Everything but a skipped departure follows from file and clock, and needs no memory across a restart. In doubt
there is no goal, and the report has the reason. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from enum import Enum
from typing import ClassVar, NamedTuple, TYPE_CHECKING

from bev_preheat.control.assumed_drive import DriveMemory, drives_between
from bev_preheat.control.events import DeparturesSkipped, PreparationEnded, PreparationWanted
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.regime import Regime
from bev_preheat.control.settings import defaults_of
from bev_preheat.numerics.factors import NS_PER_S
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
    from bev_preheat.control.departures import Departures, Occurrence
    from bev_preheat.control.events import Event
    from bev_preheat.control.grid_prices import GridPrices
    from bev_preheat.control.preparation_goal import PreparationOutcome
    from bev_preheat.control.state import State


class DepartureState(Enum):
    """State of the next departure; the values are the words in diagnostics."""

    NONE = 'none'
    LATER = 'later'
    HELD_OFF = 'held off'
    PREPARING = 'preparing'


class DepartureReport(NamedTuple):
    """
    The next departure that is not skipped, its DepartureState and the reason as a sentence.

    `next_words` is its name and local time, '' without one; `plugged_in`: the grid is expected to feed the heater.
    `skipped_words` is the last skipped departure, '' for none; `latest` the sentence on the last one that has
    passed, '' for none yet.
    """

    state: DepartureState
    reason: str
    next_ns: int | None = None
    next_words: str = ''
    target_c: float | None = None
    plugged_in: bool = False
    skipped_words: str = ''
    latest: str = ''


class DepartureSource:
    """Turns Departures into goals, one at a time."""

    NOTHING: ClassVar = DepartureReport(DepartureState.NONE, 'the file of departures cannot be used')

    def __init__(self, departures: Departures, prices: GridPrices | None = None,
                 last_seen_ns: int | None = None) -> None:
        """
        Begin without a goal; `prices` are those of energy from the grid.

        `last_seen_ns` [ns] is the instant until which the planner ran before a restart; None: unknown.
        """
        self._departures, self._prices = departures, prices
        self._tick_ns = last_seen_ns
        self._next: Occurrence | None = None
        self._skipped_ns: int | None = None
        # The goal that this source has set, and its departure; None: none.
        self._goal: PreparationGoal | None = None
        self._goal_for: Occurrence | None = None
        # Instant of the latest departure whose goal has lasted until then.
        self._concluded_ns = 0
        # Why the latest goal was refused or lost, and when it is wanted again.
        self._refusal, self._retry_ns = '', 0
        self._state = DepartureState.NONE
        self._reason = 'the planner was not running'
        self._latest = ''
        self._memory = DriveMemory()
        # Lowest state of charge since the grid was found not to feed the vehicle; None: the file holds.
        self._unplugged_soc: float | None = None

    def use(self, departures: Departures, prices: GridPrices | None) -> None:
        """Use other Departures and GridPrices; a goal that does not fit them ends with the next `events`."""
        self._departures, self._prices, self._next = departures, prices, None

    def give_up(self) -> tuple[Event, ...]:
        """Return the event that ends the current goal, because there are no departures any more."""
        goal, self._goal, self._goal_for = self._goal, None, None
        return () if goal is None else (PreparationEnded(
            goal, PreparationEnding.CANCELED, 'The parameter departures names no file any more.'),)

    # Events

    def events(self, state: State, now_ns: int) -> tuple[Event, ...]:
        """Return the events of an instant [ns]: a goal begins or ends; mostly ()."""
        self._look_at_clock(now_ns)
        self._find_next(state.choices.skipped_until_ns, now_ns)
        self._look_at_vehicle(state)
        if self._goal is not None and state.preparation_goal is not self._goal:
            # A step failed before the goal began.
            self._goal = self._goal_for = None
        if self._goal_for is not None and self._goal_for.instant_ns <= now_ns:
            # The preparation concludes itself.
            return ()
        self._state, self._reason = self._judge(state, now_ns)
        wanted = self._wanted() if self._state is DepartureState.PREPARING else None
        goal = self._goal
        if wanted is None:
            self._goal = self._goal_for = None
            return () if goal is None else (PreparationEnded(
                goal, PreparationEnding.CANCELED,
                f'The preparation for a departure has ended: {self._reason}.'),)
        if goal is not None and _is_same(wanted, goal):
            return ()
        # Without a pause it replaces a goal that the file or the evidence has changed.
        self._goal, self._goal_for = wanted, self._next
        return (PreparationWanted(wanted),)

    def note(self, outcome: PreparationOutcome, state: State, now_ns: int) -> None:
        """Take in the PreparationOutcome of any goal, and the State after it."""
        if outcome.preparation_goal is not self._goal or self._goal_for is None:
            return
        words = self._departures.in_words(self._goal_for)
        self._latest = f'{words}: {outcome.ending.name}: {outcome.explanation}'
        ready_ns, self._goal, self._goal_for = self._goal.ready_at_ns, None, None
        self._concluded_ns = ready_ns if ready_ns <= now_ns else 0
        self._refusal = outcome.explanation.removesuffix('.')
        self._retry_ns = now_ns + round(RETRY_S * NS_PER_S)
        if outcome.ending is PreparationEnding.REPLACED:
            self._retry_ns = 0
        elif outcome.ending is PreparationEnding.UNPLUGGED:
            self._retry_ns = 0
            if state.mission is None or not drives_between(state.mission, now_ns, ready_ns):
                # The charge has fallen: evidence outranks the file, and the battery feeds the heater.
                self._unplugged_soc = 1.0
        self._state, self._reason = DepartureState.HELD_OFF, self._refusal

    def skip_next(self, state: State, now_ns: int) -> tuple[DeparturesSkipped | None, str]:
        """Return the event that skips the next departure, None without one, and a sentence for the driver."""
        self._find_next(state.choices.skipped_until_ns, now_ns)
        if self._next is None:
            return None, 'There is no departure to skip.'
        following = next(self._departures.after(self._next.instant_ns))
        return (DeparturesSkipped(self._next.instant_ns),
                f'Skipped: {self._departures.in_words(self._next)}; the next departure is '
                f'{self._departures.in_words(following)}.')

    def unskip(self, state: State, now_ns: int) -> tuple[DeparturesSkipped, str]:
        """Return the event that skips no departure any more, and a sentence for the driver."""
        self._find_next(None, now_ns)
        return DeparturesSkipped(None), 'No departure is skipped. ' + (
            'There is none.' if self._next is None else
            f'The next departure is {self._departures.in_words(self._next)}.')

    @property
    def report(self) -> DepartureReport:
        """The DepartureReport after the latest `events`."""
        following, skipped_ns = self._next, self._skipped_ns
        if following is None:
            return DepartureReport(self._state, self._reason, latest=self._latest)
        skipped = '' if skipped_ns is None else ', '.join(
            map(self._departures.in_words, self._departures.until(skipped_ns - 1, skipped_ns)))
        return DepartureReport(
            self._state, self._reason, following.instant_ns, self._departures.in_words(following),
            following.departure.target_c, following.departure.is_plugged_in and self._unplugged_soc is None,
            skipped, self._latest)

    # Clock and calendar

    def _look_at_clock(self, now_ns: int) -> None:
        """Note the departures that have passed since the latest look, without a goal."""
        before_ns, self._tick_ns = self._tick_ns, now_ns
        if before_ns is None or before_ns < EARLIEST_NS:
            return
        if now_ns < before_ns:
            # Set back: results for later instants are void.
            self._next, self._retry_ns = None, 0
            self._memory = DriveMemory()
            return
        from_ns = max(before_ns, self._skipped_ns or 0, now_ns - FURTHEST_SKIP_NS)
        for passed in self._departures.until(from_ns, now_ns):
            if passed.instant_ns != self._concluded_ns and (
                    self._goal_for is None or self._goal_for.instant_ns != passed.instant_ns):
                self._latest = f'{self._departures.in_words(passed)}: not prepared: {self._reason}.'
            self._unplugged_soc = None

    def _find_next(self, skipped_ns: int | None, now_ns: int) -> None:
        """Find the next departure after those that are skipped until an instant [ns]; None: none is."""
        if skipped_ns is not None and not now_ns < skipped_ns <= now_ns + FURTHEST_SKIP_NS:
            skipped_ns = None
        if now_ns < EARLIEST_NS:
            self._next = None
        elif self._next is None or skipped_ns != self._skipped_ns or self._next.instant_ns <= now_ns:
            self._next = next(self._departures.after(skipped_ns or now_ns), None)
            self._retry_ns = 0
        self._skipped_ns = skipped_ns

    # Evidence

    def _look_at_vehicle(self, state: State) -> None:
        measurement, command = state.measurement, state.latest_command
        if measurement is None:
            return
        self._memory = self._memory.seen(
            measurement.stamp_ns, measurement.power_w,
            0.0 if command is None else command.battery_heating_power_w)
        if self._unplugged_soc is None:
            return
        soc = measurement.state.soc
        self._unplugged_soc = min(self._unplugged_soc, soc)
        if state.regime.regime is Regime.CHARGING or soc > self._unplugged_soc + CHARGE_FALLS_BY:
            self._unplugged_soc = None

    def _drive_w(self, state: State, now_ns: int) -> float:
        """Return the mean power of driving in the last minutes [W]; 0 for a vehicle that stands."""
        defaults = defaults_of(state.vehicle, state.settings)
        return self._memory.propulsion_w(now_ns, defaults.cabin_heating_power_w + defaults.auxiliary_power_w)[0]

    # Judgement

    def _judge(self, state: State, now_ns: int) -> tuple[DepartureState, str]:
        """Return the DepartureState of the next departure, and the reason without full stop."""
        if now_ns < EARLIEST_NS:
            return DepartureState.NONE, 'the clock was never set: it shows a time before 2020'
        if self._next is None:
            return DepartureState.NONE, 'the file has no departures'
        left_s, begins_s = (self._next.instant_ns - now_ns) / NS_PER_S, self._begins_s()
        if left_s > begins_s:
            return DepartureState.LATER, f'its preparation may begin in {duration_text(left_s - begins_s)}'
        obstacle = self._obstacle(state, now_ns)
        if obstacle:
            return DepartureState.HELD_OFF, obstacle
        if self._goal is None and now_ns < self._retry_ns:
            return DepartureState.HELD_OFF, self._refusal
        return DepartureState.PREPARING, 'the battery is prepared' + (
            ' from the grid' if self._is_plugged_in() else
            '; it feeds the heater itself, because the charge has fallen' if self._unplugged_soc is not None else
            ' with its own energy')

    def _obstacle(self, state: State, now_ns: int) -> str:
        """Return why the next departure cannot be prepared at an instant [ns]; '' if nothing forbids it."""
        assert self._next is not None
        other = state.preparation_goal
        if not state.is_enabled:
            return 'preheating is switched off through ~/enable'
        if other is not None and other is not self._goal:
            return 'another goal of prepare_battery is active'
        if state.mission is not None and drives_between(state.mission, now_ns, self._next.instant_ns):
            return f'the route plan {state.mission.route_id!r} drives before the departure'
        drive_w = self._drive_w(state, now_ns)
        if drive_w > DRIVES_W:
            return f'the vehicle drives: the battery gives {drive_w / 1000.0:.1f} kW'
        if self._goal is None:
            measurement = state.measurement
            if measurement is None:
                return 'no valid battery state has arrived yet'
            timeout_s = state.settings.battery_state_timeout_s
            if not measurement.stamp_ns - timeout_s * NS_PER_S < now_ns < measurement.expires_ns(timeout_s):
                return 'the battery state is too old, or ahead of the clock'
        return ''

    def _is_plugged_in(self) -> bool:
        return self._next is not None and self._next.departure.is_plugged_in and self._unplugged_soc is None

    def _begins_s(self) -> float:
        return BEGINS_WITH_PRICES_S if self._prices is not None and self._is_plugged_in() else BEGINS_S

    def _wanted(self) -> PreparationGoal:
        assert self._next is not None
        is_plugged_in = self._is_plugged_in()
        return PreparationGoal(
            self._next.instant_ns, self._next.departure.target_c, is_plugged_in,
            assumed_ambient_c=self._departures.ambient_c, prices=self._prices if is_plugged_in else None)


def _is_same(first: PreparationGoal, second: PreparationGoal) -> bool:
    """Return whether two goals ask for the same."""
    return (first.ready_at_ns, first.target_c, first.is_plugged_in, first.assumed_ambient_c) == (
        second.ready_at_ns, second.target_c, second.is_plugged_in, second.assumed_ambient_c
    ) and first.prices is second.prices
