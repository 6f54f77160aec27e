# SPDX-License-Identifier: Apache-2.0
"""The page's source: running planners, requests of people to them, and the messages to one browser tab."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass
import math
from threading import Lock
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.messages.fields import seconds
from bev_preheat.monitoring.view import instant, LONGEST_SENTENCE, number, status_name, written

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.monitoring.board import Board
    from bev_preheat.monitoring.seen import PlanSeen

    # Asks a planner by name at an instant of its clock [s].
    Ask = Callable[[str, 'Asked', float | None], Future['Answer']]

KINDS = ENABLE, DISABLE, PREPARE, CANCEL, SKIP, UNSKIP = (
    'enable', 'disable', 'prepare', 'cancel', 'skip', 'unskip')
# As the action has them: a day ahead, and the temperatures of batteries.
MINUTES, TARGETS_C = (1.0, 1440.0), (-60.0, 60.0)
# A tab gets the trajectories of a plan at most this often [s]: the planner makes a plan at each battery state.
PLAN_PERIOD_S = 1.0


class Asked(NamedTuple):
    """A request: kind; for `prepare` when [min from now; None: soonest], target [deg C; None: own], plugged in."""

    kind: str
    minutes: float | None = None
    target_c: float | None = None
    is_plugged_in: bool = False


class Answer(NamedTuple):
    """Whether the planner serves the request, and its sentence."""

    is_accepted: bool
    text: str


def asked_of(values: Any) -> Asked:
    """Return the Asked of a request's JSON; raises InvalidInput, naming the field."""
    if not isinstance(values, dict):
        raise InvalidInput('the request must be a JSON object')
    kind = values.get('kind')
    if kind not in KINDS:
        raise InvalidInput(f'kind: {quoted(str(kind)[:40])} is not allowed; it must be one of {", ".join(KINDS)}')
    if kind != PREPARE:
        return Asked(kind)
    plugged_in = values.get('pluggedIn', False)
    if not isinstance(plugged_in, bool):
        raise InvalidInput('pluggedIn: must be true or false')
    return Asked(kind, _number(values, 'minutes', MINUTES, 'min'), _number(values, 'target', TARGETS_C, 'degC'),
                 plugged_in)


def _number(values: dict[str, Any], name: str, limits: tuple[float, float], unit: str) -> float | None:
    value, (low, high) = values.get(name), limits
    if value is None:
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not low <= value <= high:
        raise InvalidInput(f'{name}: {quoted(str(value)[:40])} is not allowed; it must be {low:g} ... {high:g} '
                           f'{unit}')
    return float(value)


@dataclass
class Cursor:
    """Contents of a tab: generations and numbers of rows of the trails, the plan, events as text."""

    generations: tuple[int, ...] = ()
    rows: tuple[int, int, int, int] = (0, 0, 0, 0)
    plan: PlanSeen | None = None
    plan_at_s: float = float('-inf')
    events: str = ''


class LiveSource:
    """The Boards of planners by name, and the way to ask them (None: no buttons); each thread holds `lock`."""

    def __init__(self, boards: dict[str, Board] | None = None, lock: Lock | None = None) -> None:
        """Show the Boards of these planners by name, under their lock."""
        self.boards: dict[str, Board] = {} if boards is None else boards
        self.lock = Lock() if lock is None else lock
        self.ask_planner: Ask | None = None

    @property
    def has_controls(self) -> bool:
        """Whether planners may be asked."""
        return self.ask_planner is not None

    def planners(self, now_s: float) -> list[dict[str, Any]]:
        """Return name, status and problem of each planner; the problem is '' for a running one."""
        with self.lock:
            return [{'name': name, 'problem': '' if (banner := board.banner(now_s)) is None else banner.word,
                     'status': None if board.plan is None else status_name(board.plan.message.status)}
                    for name, board in sorted(self.boards.items())]

    def message(self, planner: str, cursor: Cursor, now_s: float) -> str | None:
        """Return the next message to a tab; None if there is no such planner."""
        with self.lock:
            board = self.boards.get(planner)
            return None if board is None else message(planner, board, cursor, now_s)

    def ask(self, planner: str, asked: Asked) -> Future[Answer] | None:
        """Ask a planner; None if there is no such planner, or none may be asked."""
        with self.lock:
            board = self.boards.get(planner)
            at_s = None if board is None else board.at_s
        if board is None or self.ask_planner is None:
            return None
        return self.ask_planner(planner, asked, at_s)

    def note_outcome(self, planner: str, text: str) -> None:
        """Show the end of a goal that was sent from the page."""
        with self.lock:
            board = self.boards.get(planner)
            if board is not None:
                board.outcome = text


def message(planner: str, board: Board, cursor: Cursor, now_s: float) -> str:
    """Return the next message (JSON) to the tab of a Cursor, and advance that; `now_s` is monotonic."""
    values: dict[str, Any] = {'planner': planner, 'view': view_values(board, now_s)}
    trails = board.temperatures, board.powers, board.deliveries, board.mixes
    generations = (board.generation, *(trail.generation for trail in trails))
    is_new = generations != cursor.generations
    if is_new:
        cursor.generations, cursor.rows = generations, (0, 0, 0, 0)
    counts = len(trails[0]), len(trails[1]), len(trails[2]), len(trails[3])
    if is_new or counts != cursor.rows:
        values['history'] = {'isWhole': is_new, **board.history(*cursor.rows)}
        cursor.rows = counts
    if is_new or (board.plan is not cursor.plan and now_s - cursor.plan_at_s >= PLAN_PERIOD_S):
        values['plan'] = board.plan_curves()
        cursor.plan, cursor.plan_at_s = board.plan, now_s
    events = written(board.events())
    if events != cursor.events:
        values['events'] = board.events()
        cursor.events = events
    return written(values)


def view_values(board: Board, now_s: float) -> dict[str, Any]:
    """Return the values of a Board for the page's JSON, rounded as they are shown; `now_s` is monotonic."""
    banner = board.banner(now_s)
    return {
        'at': instant(board.at_s), 'banner': None if banner is None else banner._asdict(),
        'ages': {topic: number(pulse.age_s(now_s), 1) for topic, pulse in board.pulses.items()},
        'late': board.late(now_s), 'temperature': number(board.temperature_c, 2), 'soc': number(board.soc, 4),
        'power': number(board.power_w, 1), 'delivered': number(board.delivered_w(board.at_s), 1),
        'sources': [[name, number(power_w, 1)] for name, power_w in board.sources_w.items()],
        'reason': None if board.reason is None else status_name(board.reason),
        **_plan_values(board), 'reserve': number(board.reserve, 4), 'unheatedProblem': board.unheated_problem,
        'outcome': shortened(board.outcome, LONGEST_SENTENCE), 'tripFrom': instant(board.trip_from_s),
        **board.diagnosis.as_dictionary()}


def _plan_values(board: Board) -> dict[str, Any]:
    if board.plan is None:
        return {'status': None, 'sentence': '', 'routeId': '', 'method': ''}
    plan = board.plan.message
    return {
        'status': status_name(plan.status), 'sentence': shortened(plan.explanation, LONGEST_SENTENCE),
        'routeId': shortened(plan.route_id, 256), 'method': shortened(plan.method, 60),
        'heatingStart': instant(board.plan.heating_start_s), 'heatingEnd': instant(seconds(plan.heating_end)),
        'arrival': instant(seconds(plan.arrival)), 'predicted': number(plan.predicted_arrival_temperature, 2),
        'deviation': number(plan.predicted_arrival_temperature_deviation, 2),
        'target': number(plan.target_battery_temperature, 2), 'most': number(plan.maximum_arrival_temperature, 2),
        'targetReason': shortened(plan.target_reason, LONGEST_SENTENCE),
        'arrivalSoc': number(plan.predicted_arrival_soc, 4), 'charging': number(plan.charging_time, 0),
        'chargingUnheated': number(plan.charging_time_unheated, 0)}
