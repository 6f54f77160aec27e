# SPDX-License-Identifier: Apache-2.0
"""The loop of `preheat monitor`: listen briefly, show the received data, repeat."""

from __future__ import annotations

import io
import os
import time
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bev_preheat.files.output_files import write_whole
from bev_preheat.monitoring.view import line, page, waiting

if TYPE_CHECKING:

    from rich.console import RenderableType

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.monitoring.end_signals import EndSignals
    from bev_preheat.monitoring.heard import Heard
    from bev_preheat.nodes.listening import Listener

REFRESH_S = 0.25
LINE_PERIOD_S = 15.0
# Missing topics are named after this silence [s].
MISSING_AFTER_S = 3.0
MOST_WIDTH = 110


class LiveView:
    """
    Listens to a planner and shows it, in one thread, so that the data do not change while they are drawn.

    `listener` is a Listener whose node fills `heard`; `signals` are EndSignals. It ends after
    `seconds` (None: with a signal).
    """

    def __init__(self, listener: Listener, heard: Heard, console: Console, signals: EndSignals,
                 seconds: float | None = None) -> None:
        """Start; nothing is shown yet."""
        self._listener, self._heard, self._console = listener, heard, console
        self._signals, self._seconds = signals, seconds
        self._started_s = time.monotonic()

    def show(self) -> None:
        """Show the page repeatedly on a terminal; elsewhere print a line now and then."""
        if self._console.is_terminal and not self._console.is_dumb_terminal:
            self._show_page()
        else:
            self._print_lines()

    def show_once(self) -> bool:
        """Print the page once every topic has been received, else the missing ones; return whether all were."""
        while self._heard.silent_topics and not self._is_over():
            self._listener.listen(REFRESH_S)
        self._console.print(page(self._heard, self._width))
        self._tell_what_is_missing()
        return not self._heard.silent_topics

    def write_picture(self, path: AnyPath) -> None:
        """Write the page as SVG."""
        recorder = Console(record=True, width=MOST_WIDTH, file=io.StringIO(), force_terminal=True,
                           color_system='truecolor')
        recorder.print(page(self._heard, MOST_WIDTH))
        write_whole(path, recorder.export_svg(title='preheat monitor'))

    @property
    def _width(self) -> int:
        return min(self._console.width, MOST_WIDTH)

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._started_s

    def _is_over(self) -> bool:
        return self._signals.have_come or (
            self._seconds is not None and self._elapsed_s() >= self._seconds)

    def _show_page(self) -> None:
        # On the terminal's alternate screen: the page is redrawn as a whole, also after a change of size, and
        # the previous contents come back at the end.
        with Live(console=self._console, auto_refresh=False, screen=True) as live:
            while not self._is_over():
                live.update(self._view(), refresh=True)
                self._listener.listen(REFRESH_S)
        self._tell_what_is_missing()

    def _view(self) -> RenderableType:
        if not self._heard.latest and self._elapsed_s() > MISSING_AFTER_S:
            return self._waiting()
        return page(self._heard, self._width, self._console.height)

    def _print_lines(self) -> None:
        next_s = min(MISSING_AFTER_S, LINE_PERIOD_S)
        while not self._is_over():
            self._listener.listen(REFRESH_S)
            if self._elapsed_s() >= next_s:
                self._console.print(Text(line(self._heard)) if self._heard.latest
                                    else self._waiting(), soft_wrap=True)
                next_s += LINE_PERIOD_S

    def _tell_what_is_missing(self) -> None:
        if self._heard.silent_topics:
            self._console.print(self._waiting(), soft_wrap=True)

    def _waiting(self) -> Text:
        return Text(waiting(self._heard, self._listener.node.count_publishers,
                            os.environ.get('ROS_DOMAIN_ID', '0')))
