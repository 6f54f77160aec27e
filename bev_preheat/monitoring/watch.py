# SPDX-License-Identifier: Apache-2.0
"""The loop of `preheat monitor`: listen briefly, show the planner's view, repeat."""

from __future__ import annotations

import io
import os
import time
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bev_preheat.files.output_files import write_whole
from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.planners import find_planners, Planners, PLANNERS_PERIOD_S
from bev_preheat.monitoring.terminal_view import line, page

if TYPE_CHECKING:
    from rich.console import RenderableType

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.monitoring.end_signals import EndSignals
    from bev_preheat.nodes.listening import Listener

REFRESH_S = 0.25
LINE_PERIOD_S = 15.0
# A missing planner is reported after this time [s].
PATIENCE_S = 3.0
MOST_WIDTH = 110


class LiveView:
    """
    Listens to a planner and shows it, in one thread, so that the data do not change while they are drawn.

    `planner` is the full name of its node; `signals` (EndSignals) end the view, as `seconds` do (None: no limit).
    """

    def __init__(self, listener: Listener, planner: str, console: Console, signals: EndSignals,
                 seconds: float | None = None) -> None:
        """Start; nothing is shown yet."""
        self._listener, self._planner, self._console = listener, planner, console
        self._signals, self._seconds = signals, seconds
        self._planners = Planners(listener.node, planner.__eq__)
        self._started_s = time.monotonic()
        self._look_s = self._started_s

    def show(self) -> None:
        """Show the page repeatedly on a terminal; elsewhere print a line now and then."""
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            # On the terminal's alternate screen: the previous contents come back at the end.
            with Live(console=self._console, auto_refresh=False, screen=True) as live:
                while not self._is_over():
                    live.update(self._shown(self._console.height), refresh=True)
                    self._listen()
        else:
            self._print_lines()
        if self._missing():
            self._console.print(self._waiting(), soft_wrap=True)

    def show_once(self) -> bool:
        """Print the page once every message has come, else name the missing ones; return whether all have."""
        while self._missing() and not self._is_over():
            self._listen()
        self._console.print(self._shown(None))
        if self._board is not None and self._missing():
            self._console.print(self._waiting(), soft_wrap=True)
        return not self._missing()

    def write_picture(self, path: AnyPath) -> None:
        """Write the page as SVG."""
        recorder = Console(record=True, width=MOST_WIDTH, file=io.StringIO(), force_terminal=True,
                           color_system='truecolor')
        recorder.print(self._shown(None))
        write_whole(path, recorder.export_svg(title='preheat monitor'))

    @property
    def _board(self) -> Board | None:
        return self._planners.boards.get(self._planner)

    def _listen(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._look_s:
            self._look_s = now_s + PLANNERS_PERIOD_S
            self._planners.look()
        self._listener.listen(REFRESH_S)

    def _is_over(self) -> bool:
        return self._signals.have_come or (
            self._seconds is not None and time.monotonic() - self._started_s >= self._seconds)

    def _missing(self) -> list[str]:
        """Return the messages that have not come yet."""
        pulses = (Board() if self._board is None else self._board).pulses
        return [name for name, pulse in pulses.items() if pulse.came_s is None]

    def _shown(self, height: int | None) -> RenderableType:
        if self._board is not None:
            return page(self._board, time.monotonic(), self._planner, height)
        return self._waiting() if time.monotonic() - self._started_s > PATIENCE_S else Text(self._planner)

    def _print_lines(self) -> None:
        next_s = self._started_s + min(PATIENCE_S, LINE_PERIOD_S)
        while not self._is_over():
            self._listen()
            if (now_s := time.monotonic()) >= next_s:
                told = self._waiting() if self._board is None else Text(line(self._board.view(now_s)))
                self._console.print(told, soft_wrap=True)
                next_s += LINE_PERIOD_S

    def _waiting(self) -> Text:
        domain = f'ROS domain {os.environ.get("ROS_DOMAIN_ID", "0")}'
        if self._board is not None:
            return Text(f'{self._planner} in {domain}: no message yet of {", ".join(self._missing())}.')
        others = sorted(find_planners(self._listener.node, {}))
        return Text(f'Waiting for {self._planner} in {domain}; ' + (
            f'there: {", ".join(others)} (--namespace, --node).' if others else 'there is no planner.'))
