# SPDX-License-Identifier: Apache-2.0
"""The messages to one browser tab: the current values, and the new part of the curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from bev_preheat.dashboard.plain import written

if TYPE_CHECKING:
    from bev_preheat.dashboard.board import Board

# A tab gets the trajectories of a plan at most this often [s]: the planner makes a plan at each battery state.
PLAN_PERIOD_S = 1.0


@dataclass
class Cursor:
    """Contents of a tab: generations and numbers of rows of the trails, version of the plan, events as text."""

    generations: tuple[int, ...] = ()
    rows: tuple[int, int, int] = (0, 0, 0)
    plan_version: int = -1
    plan_at_s: float = float('-inf')
    events: str = ''


def message(planner: str, board: Board, cursor: Cursor, now_s: float) -> str:
    """Return the next message (JSON) to the tab of a Cursor, and advance that; `now_s` is monotonic."""
    values: dict[str, Any] = {'planner': planner, 'view': board.view(now_s)}
    trails = board.temperatures, board.powers, board.deliveries
    generations = (board.generation, *(trail.generation for trail in trails))
    is_new = generations != cursor.generations
    if is_new:
        cursor.generations, cursor.rows = generations, (0, 0, 0)
    counts = len(trails[0]), len(trails[1]), len(trails[2])
    if is_new or counts != cursor.rows:
        values['history'] = {'isWhole': is_new, **board.history(*cursor.rows)}
        cursor.rows = counts
    if is_new or (board.plan_version != cursor.plan_version and now_s - cursor.plan_at_s >= PLAN_PERIOD_S):
        values['plan'] = board.plan_curves()
        cursor.plan_version, cursor.plan_at_s = board.plan_version, now_s
    events = written(board.events())
    if events != cursor.events:
        values['events'] = board.events()
        cursor.events = events
    return written(values)
