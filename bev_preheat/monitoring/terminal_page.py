# SPDX-License-Identifier: Apache-2.0
"""The loop of `preheat monitor`: listen briefly, show the planner's Board as text, repeat."""

from __future__ import annotations

import io
import math
import os
import time
from typing import TYPE_CHECKING

from rich.columns import Columns
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bev_preheat.errors import one_line, shortened
from bev_preheat.files.output_files import write_whole
from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.planners import find_planners, Planners, PLANNERS_PERIOD_S
from bev_preheat.monitoring.seen import level_name
from bev_preheat.monitoring.view import LONGEST_SENTENCE, number, status_name
from bev_preheat.nodes.node import without_figures
from bev_preheat.planning.explanation import duration_text
from bev_preheat.vehicle.description import HVCH

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import RenderableType

    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.monitoring.end_signals import EndSignals
    from bev_preheat.nodes.listening import Listener

STYLES = {'OK': 'green', 'WARN': 'yellow', 'ERROR': 'bold red', 'STALE': 'red'}
UNKNOWN = '-'
# Instants further away are treated as unset [s].
LONGEST_LEFT_S = 1e7
LONGEST_TOLD = 300
NAME_WIDTH = 17
# The characters of a course, from low to high, and their number.
HEIGHTS = '▁▂▃▄▅▆▇█'
COURSE_PARTS = 24
LEAST_SPAN_K = 1.0


def page(board: Board, now_s: float, name: str, height: int | None = None) -> Panel:
    """Return the page of a Board; beyond `height` rows the bottom is cut off, which matters least."""
    banner = board.banner(now_s)
    parts: list[RenderableType] = [] if banner is None else [
        Text(banner.text, 'bold red' if banner.level == 'error' else 'bold yellow')]
    parts.append(Columns([_figure(*pair) for pair in figures(board)], padding=(0, 2), equal=True))
    if board.plan is not None:
        parts.append(Text.assemble((status_name(board.plan.status), 'bold'),
                                   f': {one_line(board.sentence) or UNKNOWN}'))
        reason = one_line(shortened(board.plan.target_reason, LONGEST_SENTENCE))
        if reason and reason not in board.sentence:
            parts.append(Text.assemble(('Target', 'bold'), f': {reason}'))
    parts += [*_courses(board), *_source_courses(board), _diagnostics(board), _ages(board, now_s)]
    return Panel(Group(*parts), title=name, height=height)


def line(board: Board) -> str:
    """Return the same data in one line of text, for an output that is not a terminal."""
    plan = board.plan
    told = 'no plan yet' if plan is None else f'{status_name(plan.status)}: {one_line(board.sentence)}'
    others = ''.join(f'{one_line(name)} {_number(power_w, "W", 0)}  ' for name, power_w in board.sources_w.items()
                     if name != HVCH)
    return (f'battery {_number(board.temperature_c, "degC")}  arrival {_prediction(board)}  '
            f'heater {_number(board.power_w, "W", 0)}  {others}{told}')


def figures(board: Board) -> list[tuple[str, str]]:
    """Return the names and texts of the figures, current and predicted ones alternating."""
    plan, departure = board.plan, board.diagnosis.departure
    arrival_soc = math.nan if plan is None else plan.arrival_soc
    reserve = math.nan if board.reserve is None else board.reserve
    return [
        ('Battery', _number(board.temperature_c, 'degC')), ('State of charge', _percent(board.soc)),
        ('Target', _number(None if plan is None else plan.target_c, 'degC')),
        ('On arrival', _percent(arrival_soc)), ('Predicted', _prediction(board)),
        ('Reserve', f'{_percent(reserve)}, spare {_percent(arrival_soc - reserve)}'),
        ('Heater', _command(board)), ('Heating', _heating(board)),
        ('Delivered', _number(board.delivered_w(board.at_s), 'W', 0)),
        ('Arrival', _until(None if plan is None else plan.arrival_s, board.at_s)),
        *([] if plan is None or not plan.sessions else zip(('Charging', 'Unheated'), plan.sessions)),
        *([] if departure is None else [('Departure', one_line(departure.next_words) or UNKNOWN),
                                        ('Preparation', one_line(departure.state) or UNKNOWN)])]


def _figure(name: str, text: str) -> Text:
    return Text.assemble((f'{name:<{NAME_WIDTH}}', 'bold'), text)


def _command(board: Board) -> str:
    text = _number(board.power_w, 'W', 0)
    lease_s = math.inf if board.at_s is None else board.until_s - board.at_s
    return f'{text}, lease {lease_s:.1f} s' if abs(lease_s) < LONGEST_LEFT_S else text


def _heating(board: Board) -> str:
    plan = board.plan
    if plan is None or plan.heating_start_s is None:
        return UNKNOWN if plan is None else 'none planned'
    if max(0.0, board.power_w, *board.sources_w.values()) > 0.0:
        return f'on; ends {_until(plan.heating_end_s, board.at_s)}'
    return f'starts {_until(plan.heating_start_s, board.at_s)}'


def _until(instant_s: float | None, now_s: float | None) -> str:
    left_s = math.inf if instant_s is None or now_s is None else instant_s - now_s
    if not abs(left_s) < LONGEST_LEFT_S:
        return UNKNOWN
    return f'in {duration_text(left_s)}' if left_s >= 0.0 else f'{duration_text(-left_s)} ago'


def _prediction(board: Board) -> str:
    if board.plan is None:
        return UNKNOWN
    text, deviation_k = _number(board.plan.predicted_c, 'degC'), board.plan.deviation_k
    return f'{text} +- {deviation_k:.1f}' if math.isfinite(deviation_k) and deviation_k > 0.0 else text


def _number(value: float | None, unit: str, digits: int = 1) -> str:
    return UNKNOWN if value is None or not math.isfinite(value) else f'{value:.{digits}f} {unit}'


def _percent(share: float) -> str:
    return _number(100.0 * share, '%')


def _courses(board: Board) -> list[Text]:
    """Return the battery's course until now, and as planned until arrival, both on one scale; [] without."""
    measured = [_drawable(row[1]) for row in board.temperatures.since(0)]
    planned = [] if board.plan is None else [_drawable(value_c) for value_c in board.plan.temperatures_c]
    known = [value_c for value_c in (*measured, *planned) if not math.isnan(value_c)]
    if not known:
        return []
    low_c, span_k = min(known), max(max(known) - min(known), LEAST_SPAN_K)
    return [_figure(name, f'{course(values, low_c, span_k)}  {values[0]:.1f} to {values[-1]:.1f} degC')
            for name, values in (('Until now', measured), ('Planned', planned)) if len(values) > 1]


def _source_courses(board: Board) -> list[Text]:
    """Return the planned power of each heat source in use until arrival, on one scale, and its command."""
    plans_w = {} if board.plan is None else board.plan.sources_w
    planned_w = {name: [max(number(power_w) or 0.0, 0.0) for power_w in plans_w.get(name, ())]
                 for name in board.sources_w}
    most_w = max([1.0, *(power_w for powers_w in planned_w.values() for power_w in powers_w)])
    return [_figure(one_line(name), f'{course(planned_w[name], 0.0, most_w)}  {_number(power_w, "W", 0)} now')
            for name, power_w in board.sources_w.items() if power_w > 0.0 or any(planned_w[name])]


def _drawable(value_c: float) -> float:
    """Return a temperature; NaN if it is that of no battery."""
    return math.nan if number(value_c) is None else value_c


def course(values: Sequence[float], low: float, span: float) -> str:
    """Return values as characters of rising height, at most COURSE_PARTS; a blank stands for an unknown value."""
    count = min(len(values), COURSE_PARTS)
    chosen = [values[round(part * (len(values) - 1) / max(count - 1, 1))] for part in range(count)]
    return ''.join(HEIGHTS[round((value - low) / span * (len(HEIGHTS) - 1))] if not math.isnan(value) else ' '
                   for value in chosen)


def _diagnostics(board: Board) -> Table:
    table = Table.grid(padding=(0, 2))
    # Written up to a second apart, they differ in the time left until arrival.
    shown = None if board.plan is None else without_figures(f'{status_name(board.plan.status)}: {board.sentence}')
    for entry in board.diagnosis.entries:
        level = level_name(entry.level)
        table.add_row(one_line(entry.name), Text(level, STYLES[level]), Text(
            'as above' if without_figures(entry.message) == shown else one_line(entry.message[:LONGEST_TOLD])))
    return table


def _ages(board: Board, now_s: float) -> Text:
    text, late = Text('Heard: '), board.late(now_s)
    for topic, age_s in board.ages_s(now_s).items():
        text.append(f'{topic} never  ' if age_s is None else f'{topic} {age_s:.1f} s  ',
                    'red' if age_s is None or topic in late else 'dim')
    return text


REFRESH_S = 0.25
LINE_PERIOD_S = 15.0
# A missing planner is reported after this time [s].
PATIENCE_S = 3.0
MOST_WIDTH = 110


class LiveView:
    """Listens to a planner by full name, and shows it in the same thread, until a signal or for `seconds`."""

    def __init__(self, listener: Listener, planner: str, console: Console, signals: EndSignals,
                 seconds: float | None = None) -> None:
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
            if time.monotonic() >= next_s:
                told = self._waiting() if self._board is None else Text(line(self._board))
                self._console.print(told, soft_wrap=True)
                next_s += LINE_PERIOD_S

    def _waiting(self) -> Text:
        domain = f'ROS domain {os.environ.get("ROS_DOMAIN_ID", "0")}'
        if self._board is not None:
            return Text(f'{self._planner} in {domain}: no message yet of {", ".join(self._missing())}.')
        others = sorted(find_planners(self._listener.node, {}))
        return Text(f'Waiting for {self._planner} in {domain}; ' + (
            f'there: {", ".join(others)} (--namespace, --node).' if others else 'there is no planner.'))
