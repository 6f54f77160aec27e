# SPDX-License-Identifier: Apache-2.0
"""Text page for a terminal with the data received from a planner."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from rich.console import Console, Group
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from bev_preheat.console.program import one_line
from bev_preheat.errors import shortened
from bev_preheat.messages.preheat_plan import session_texts
from bev_preheat.monitoring.chart import chart
from bev_preheat.monitoring.heard import stamp_s, TOPICS
from bev_preheat.nodes.news import without_figures
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import PreheatPlan

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from builtin_interfaces.msg import Time
    from rich.console import RenderableType

    from bev_preheat.monitoring.heard import Heard
    from bev_preheat_msgs.msg import HvchCommand

    # Two pairs of name and text per row.
    Rows = Sequence[tuple[str, str, str, str]]

LEVELS = {DiagnosticStatus.OK: ('OK', 'green'), DiagnosticStatus.WARN: ('WARN', 'yellow'),
          DiagnosticStatus.ERROR: ('ERROR', 'bold red'), DiagnosticStatus.STALE: ('STALE', 'red')}
UNKNOWN = '-'
# Instants beyond this are treated as unset [s].
LONGEST_S = 1e7
# Limits messages from any publisher, so that they do not fill the screen.
LONGEST_EXPLANATION, LONGEST_VALUE = 2000, 100
# Columns and rows of the frame; below this inner width the figures are a list.
FRAME_COLUMNS, FRAME_ROWS = 4, 2
LEAST_TABLE_WIDTH = 64


def page(heard: Heard, width: int = 100, height: int | None = None) -> Panel:
    """
    Return the page of a Heard, `width` columns wide.

    It has at most `height` rows (None: unlimited). Parts without room are left out: the chart
    first, then from the bottom.
    """
    inside = width - FRAME_COLUMNS
    plan, command = heard.latest.get('preheat_plan'), heard.latest.get('hvch_command')
    figures = _figures(heard, plan, command)
    above: list[RenderableType] = [
        _table(figures) if inside >= LEAST_TABLE_WIDTH else _list(figures)]
    if plan is not None:
        above.append(Text.from_markup(f'[bold]{_status_name(plan.status)}[/bold]: '
                                      f'{escape(_told(plan)) or UNKNOWN}'))
        reason = one_line(shortened(plan.target_reason, LONGEST_EXPLANATION))
        if plan.target_source == PreheatPlan.TARGET_CHOSEN and reason not in _told(plan):
            above.append(Text.assemble(('Target: ', 'bold'), reason))
    below: list[RenderableType] = [_diagnostics(heard, plan), _ages(heard)]
    if height is None:
        middle, rows = [chart(heard, inside)], None
    else:
        room = height - FRAME_ROWS - _rows(Group(*above, *below), inside)
        middle = [chart(heard, inside, room)]
        rows = min(height, FRAME_ROWS + _rows(Group(*above, *middle, *below), inside))
    return Panel(Group(*above, *(part for part in middle if part), *below),
                 title='planner', width=width, height=rows)


def _rows(renderable: RenderableType, width: int) -> int:
    """Return the number of rows of a renderable."""
    console = Console(width=width, file=io.StringIO())
    return len(console.render_lines(renderable, pad=False))


def line(heard: Heard) -> str:
    """Return the same data in one line of text, for an output that is not a terminal."""
    plan, command = heard.latest.get('preheat_plan'), heard.latest.get('hvch_command')
    battery = heard.latest.get('battery_state')
    return '  '.join((
        f'battery {_number(battery and battery.temperature, "degC")}',
        f'arrival {_prediction(heard, plan)}',
        f'heater {_number(command and command.battery_heating_power, "W", 0)}',
        f'{_status_name(plan.status)}: {_told(plan)}' if plan else 'no plan yet'))


def waiting(heard: Heard, publishers: Callable[[str], int], domain_id: str) -> str:
    """Return the topics still missing; `publishers` returns the number of publishers of a topic."""
    lines = [f'Waiting for {"silent topics" if heard.latest else "a planner"} in ROS domain {domain_id}.']
    for topic in heard.silent_topics:
        count = publishers(topic)
        lines.append(f'  {topic}: ' + ('no publisher' if count == 0 else
                                       f'{count} publisher{"s" * (count > 1)}, no message yet'))
    return '\n'.join(lines)


def _figures(heard: Heard, plan: PreheatPlan | None, command: HvchCommand | None) -> Rows:
    """Return the figures as pairs of name and text, current and predicted figures alternating."""
    battery, route = heard.latest.get('battery_state'), heard.latest.get('route_plan')
    now_s = stamp_s(battery.header.stamp) if battery else math.nan
    # A cancellation has no segments.
    reserve = route.minimum_arrival_soc if route and route.segment_duration else math.nan
    spare = (plan.predicted_arrival_soc if plan else math.nan) - reserve
    sessions = session_texts(plan) if plan else None
    return (
        ('Battery', _number(battery and battery.temperature, 'degC'),
         'State of charge', _percent(battery and battery.percentage)),
        ('Target', _target(plan),
         'On arrival', _percent(plan and plan.predicted_arrival_soc)),
        ('Predicted', _prediction(heard, plan),
         'Reserve', f'{_percent(reserve)}, spare {_percent(spare)}'),
        ('Heater', _command(command), 'Heating', _heating(plan, command, now_s)),
        ('Reason', _status_name(command.reason) if command else UNKNOWN,
         'Arrival', _until(plan.arrival if plan else None, now_s)),
        *([] if sessions is None else [('Charging', sessions[0], 'Unheated', sessions[1])]),
        *_departure(heard))


def _departure(heard: Heard) -> Rows:
    """Return the row on the next departure; () without departures."""
    entry = next((entry for name, entry in heard.entries.items() if name.endswith(': departures')), None)
    if entry is None:
        return ()
    values = {item.key: one_line(item.value[:LONGEST_VALUE]) for item in entry.values}
    return (('Departure', values.get('next departure') or UNKNOWN,
             'Preparation', values.get('state') or UNKNOWN),)


def _target(plan: PreheatPlan | None) -> str:
    text = _number(plan and plan.target_battery_temperature, 'degC')
    return f'{text}, chosen' if plan and plan.target_source == PreheatPlan.TARGET_CHOSEN else text


def _table(figures: Rows) -> Table:
    grid = Table.grid(padding=(0, 2))
    for style in ('bold', None, 'bold', None):
        grid.add_column(style=style)
    for row in figures:
        grid.add_row(*row)
    return grid


def _list(figures: Rows) -> Table:
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style='bold')
    grid.add_column()
    for row in figures:
        grid.add_row(*row[:2])
        grid.add_row(*row[2:])
    return grid


def _told(plan: PreheatPlan) -> str:
    return one_line(shortened(plan.explanation, LONGEST_EXPLANATION))


def _command(command: HvchCommand | None) -> str:
    if command is None:
        return UNKNOWN
    lease_s = stamp_s(command.valid_until) - stamp_s(command.header.stamp)
    text = _number(command.battery_heating_power, 'W', 0)
    return f'{text}, lease {lease_s:.1f} s' if abs(lease_s) < LONGEST_S else text


def _heating(plan: PreheatPlan | None, command: HvchCommand | None, now_s: float) -> str:
    if plan is None or not plan.heating_planned:
        return 'none planned' if plan is not None else UNKNOWN
    if command is not None and command.battery_heating_power > 0.0:
        return f'on; ends {_until(plan.heating_end, now_s)}'
    return f'starts {_until(plan.heating_start, now_s)}'


def _until(instant: Time | None, now_s: float) -> str:
    if instant is None or (instant.sec, instant.nanosec) == (0, 0):
        return UNKNOWN
    left_s = stamp_s(instant) - now_s
    if not abs(left_s) < LONGEST_S:
        return UNKNOWN
    return f'in {duration_text(left_s)}' if left_s >= 0.0 else f'{duration_text(-left_s)} ago'


def _prediction(heard: Heard, plan: PreheatPlan | None) -> str:
    text = _number(plan and plan.predicted_arrival_temperature, 'degC')
    message = heard.latest.get('predicted_arrival_temperature')
    if message is not None and math.isfinite(message.variance) and message.variance > 0.0:
        text += f' +- {math.sqrt(message.variance):.1f}'
    return text


def _number(value: float | None, unit: str, digits: int = 1) -> str:
    return UNKNOWN if value is None or not math.isfinite(value) else f'{value:.{digits}f} {unit}'


def _percent(value: float | None) -> str:
    return _number(None if value is None else 100.0 * value, '%')


def _status_name(number: int) -> str:
    try:
        return Status(number).name
    except ValueError:
        return f'status {number}'


def _diagnostics(heard: Heard, plan: PreheatPlan | None) -> Table:
    table = Table.grid(padding=(0, 2))
    shown = plan and f'{_status_name(plan.status)}: {plan.explanation}'
    for name, status in sorted(heard.entries.items()):
        text, style = LEVELS.get(status.level, (repr(status.level), 'red'))
        message = 'as above' if _says_the_same(status.message, shown) else one_line(status.message[:300])
        table.add_row(Text(one_line(name)), Text(text, style=style), Text(message))
    return table


def _says_the_same(sentence: str, shown: str | None) -> bool:
    # Written up to a second apart, they differ in the time left until arrival.
    return shown is not None and without_figures(sentence) == without_figures(shown)


def _ages(heard: Heard) -> Text:
    text = Text('Heard: ')
    for topic, (_, _, limit_s) in TOPICS.items():
        if topic not in heard.latest:
            text.append(f'{topic} never  ', style='bold red')
            continue
        age_s = heard.age_s(topic)
        late = limit_s is not None and age_s > limit_s
        text.append(f'{topic} {age_s:.1f} s  ', style='red' if late else 'dim')
    return text
