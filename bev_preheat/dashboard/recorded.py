# SPDX-License-Identifier: Apache-2.0
"""A flight recording as tables for the page: the values that a Board would have shown, instant by instant."""

from __future__ import annotations

import math
from pathlib import Path
from threading import Thread
from typing import Any, TYPE_CHECKING

from bev_preheat.dashboard.board import BACK_S, Board
from bev_preheat.dashboard.messages import entries_seen, plan_seen
from bev_preheat.dashboard.plain import instant, written
from bev_preheat.dashboard.seen import RouteSeen
from bev_preheat.dashboard.unheated import Unheated
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.convert import plan_message
from bev_preheat.nodes.diagnostics import planner_diagnostics
from bev_preheat.nodes.news import without_figures
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.replay.flight_file import read_flight
from bev_preheat.replay.player import Player
from bev_preheat.replay.trip_result import lapses_in_words, TripResults

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from concurrent.futures import Future

    from bev_preheat.dashboard.asked import Answer, Asked
    from bev_preheat.dashboard.feed import Cursor
    from bev_preheat.replay.flight_file import Flight
    from bev_preheat.replay.player import Played

PLANNER = 'planner'
# The slider has at most so many positions, and at most so many plans are drawn.
MOST_FRAMES, DRAWN_PLANS, RECORDED_PLAN_POINTS = 4000, 200, 120
RECORDED_POINTS = 8000
# Values of a view that only a running planner has.
LIVE_ONLY = ('banner', 'ages', 'late', 'outcome')
CLOSE_S = 1e-6
# A longer time between two steps is a clock that was set [s].
CLOCK_JUMP_S = 3600.0


class RecordedDrive:
    """Fills a Board with replayed steps, and keeps its values at times at least a frame apart."""

    def __init__(self, length_s: float) -> None:
        """Start; `length_s` is the length of the recording [s]."""
        self._board = Board(RECORDED_POINTS)
        self._frame_s, self._plan_s = length_s / MOST_FRAMES, length_s / DRAWN_PLANS
        self._frames: list[dict[str, Any]] = []
        self._plans: list[dict[str, Any]] = []
        self._framed_s = self._planned_s = -math.inf
        self._marks = self._measured_ns = 0
        self._entry_kinds: list[tuple[str, str, str]] = []
        self._results = TripResults()

    def add(self, played: Played) -> None:
        """Add a step."""
        board, state, at_s = self._board, played.state, played.now_ns / NS_PER_S
        if board.unheated is None:
            board.unheated = Unheated(state.vehicle)
        self._results.add(played)
        if played.output.command is not None:
            board.see_command(at_s, played.output.command.battery_heating_power_w,
                              int(played.output.command.reason), at_s,
                              played.output.command.valid_until_ns / NS_PER_S)
        if state.heater_answer is not None and state.heater_answer.status is not None:
            board.see_answer(state.heater_answer.status)
        measurement = state.measurement
        if measurement is not None and measurement.stamp_ns != self._measured_ns:
            self._measured_ns = measurement.stamp_ns
            made = state.decision.plan
            board.see_battery(measurement.stamp_ns / NS_PER_S, measurement.state.temperature_c,
                              measurement.state.soc, at_s,
                              math.nan if made is None else float(made.battery_temperature_c[0]))
        status = None if board.plan is None else board.plan.status
        is_due = at_s - self._framed_s >= self._frame_s - CLOSE_S
        if not is_due and status == state.decision.status:
            return
        self._framed_s = at_s
        decision = state.decision
        if decision.leg is not None:
            board.see_route(RouteSeen((), 0, decision.leg.minimum_arrival_soc))
        plan = plan_seen(plan_message(decision, state.active_mission, played.now_ns))
        # A plan is stamped with its battery state; its event belongs to the step that shows it.
        board.see_plan(plan._replace(at_s=at_s), at_s)
        board.see_diagnostics(
            at_s, entries_seen(planner_diagnostics(PLANNER, state, played.now_ns), PLANNER), at_s)
        instant_s = round(at_s, 3)
        # Of several steps at one instant the last one counts.
        put(self._frames, {**self._with_known_entries(board.view(at_s)), 'at': instant_s})
        if at_s - self._planned_s >= self._plan_s - CLOSE_S or len(board.marks) != self._marks:
            self._planned_s, self._marks = at_s, len(board.marks)
            put(self._plans, {**board.plan_curves(RECORDED_PLAN_POINTS), 'at': instant_s})

    def _with_known_entries(self, view: dict[str, Any]) -> dict[str, Any]:
        """Return a view whose diagnostics are those of the frame before unless more than figures changed."""
        kinds = [(name, level, without_figures(text)) for name, level, text in view['entries']]
        if kinds != self._entry_kinds:
            self._entry_kinds = kinds
            return view
        # The page takes null for the same as before.
        return {**view, 'entries': None}

    def tables(self) -> dict[str, Any]:
        """Return the tables: results of trips, `keys` of the frames, `frames` in rows, plans, history, events."""
        # A dictionary keeps their order.
        keys = list({key: None for frame in self._frames for key in frame if key not in LIVE_ONLY})
        results = [[instant(trip.ended_ns / NS_PER_S), *trip.sentences()] for trip in self._results.trips]
        return {'results': results, 'lapses': lapses_in_words(self._results.account.without_command),
                'keys': keys, 'frames': [[frame.get(key) for key in keys] for frame in self._frames],
                'plans': self._plans, 'history': self._board.history(), 'events': self._board.events()}


class RecordedSource:
    """A recording as a Source: read in a thread of its own, because that takes some seconds for a day."""

    mode, has_controls = 'recording', False

    def __init__(self, path: str) -> None:
        """Read the file; raises InvalidInput if it is no recording."""
        self._flight = read_flight(path)
        if not self._flight.given:
            raise InvalidInput(f'{path}: has no step of the planner')
        self.name = Path(self._flight.paths[0]).name
        self._text: str | None = None
        self._done, self._problem = 0, ''
        self._thread = Thread(target=self._read, name='recording', daemon=True)
        self._thread.start()

    def _read(self) -> None:
        try:
            self._text = written(tables_of(self._flight, self._note))
        except Exception as error:
            self._problem = f'The recording cannot be replayed: {type(error).__name__}: {error}'

    def _note(self, steps: int) -> None:
        self._done = steps

    def recording(self) -> str:
        """Return the tables as JSON; until they are there, `progress` (0 ... 1) or a `problem`."""
        if self._text is not None:
            return self._text
        return written({'problem': self._problem} if self._problem else
                       {'progress': self._done / len(self._flight.given)})

    def planners(self, now_s: float) -> list[dict[str, Any]]:
        """Return the recorded planner."""
        return [{'name': self.name, 'problem': '', 'status': None}]

    def message(self, planner: str, cursor: Cursor, now_s: float) -> str | None:
        """Return None: nothing happens in a recording."""
        return None

    def ask(self, planner: str, asked: Asked) -> Future[Answer] | None:
        """Return None: a recording cannot answer."""
        return None


def tables_of(flight: Flight, note: Callable[[int], object]) -> dict[str, Any]:
    """
    Return the tables of a Flight, one for each drive: a clock that is set begins another one.

    `note(steps)` is called now and then with the number of steps read.
    """
    player, drives, before_ns = Player(flight), list[RecordedDrive](), 0
    lengths_s = iter(lengths_of(each.step.now_ns for each in flight.given))
    for number, each in enumerate(flight.given):
        if not drives or is_set(before_ns, each.step.now_ns):
            drives.append(RecordedDrive(next(lengths_s)))
        before_ns = each.step.now_ns
        played = player.play(each)
        # At 0 a simulated clock has not started yet.
        if played.now_ns > 0:
            drives[-1].add(played)
        if number % 100 == 0:
            note(number)
    tables = [drive.tables() for drive in drives]
    return {'remarks': list(flight.remarks), 'drives': [each for each in tables if each['frames']]}


def put(rows: list[dict[str, Any]], row: dict[str, Any]) -> None:
    """Add a row; it replaces the rows of its instant and of later ones."""
    while rows and rows[-1]['at'] >= row['at']:
        replaced = rows.pop()
        if row.get('entries', ()) is None:
            row['entries'] = replaced['entries']
    rows.append(row)


def is_set(before_ns: int, now_ns: int) -> bool:
    """Return whether the clock was set between two steps; the planner steps with every command, seconds apart."""
    return not -BACK_S * NS_PER_S <= now_ns - before_ns <= CLOCK_JUMP_S * NS_PER_S


def lengths_of(instants_ns: Iterable[int]) -> list[float]:
    """Return the lengths [s] of the drives that the instants [ns] of steps belong to."""
    bounds: list[tuple[int, int]] = []
    for now_ns in instants_ns:
        if not bounds or is_set(bounds[-1][1], now_ns):
            bounds.append((now_ns, now_ns))
        else:
            bounds[-1] = bounds[-1][0], now_ns
    return [(last_ns - first_ns) / NS_PER_S for first_ns, last_ns in bounds]
