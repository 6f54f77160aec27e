# SPDX-License-Identifier: Apache-2.0
"""The source of the page's values: running planners."""

from __future__ import annotations

from concurrent.futures import Future
from threading import Lock
from typing import Any, TYPE_CHECKING

from bev_preheat.dashboard.board import Board, status_name
from bev_preheat.dashboard.feed import message

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.dashboard.asked import Answer, Asked
    from bev_preheat.dashboard.feed import Cursor

    # Asks a planner by name at an instant of its clock [s].
    Ask = Callable[[str, Asked, float | None], Future[Answer]]


class LiveSource:
    """
    The Boards of planners by name, and the way to ask them (None: the page has no buttons).

    The executor's thread fills the Boards, the server's reads them; both hold `lock`.
    """

    def __init__(self) -> None:
        """Start without planners."""
        self.lock = Lock()
        self.boards: dict[str, Board] = {}
        self.ask_planner: Ask | None = None

    @property
    def has_controls(self) -> bool:
        """Whether planners may be asked."""
        return self.ask_planner is not None

    def planners(self, now_s: float) -> list[dict[str, Any]]:
        """Return name, status and problem of each planner; the problem is '' for a running one."""
        with self.lock:
            return [{'name': name, 'problem': '' if (banner := board.banner(now_s)) is None else banner.word,
                     'status': None if board.plan is None else status_name(board.plan.status)}
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
                board.version += 1
