# SPDX-License-Identifier: Apache-2.0
"""Live display of a drive, and its summary."""

from __future__ import annotations

from contextlib import contextmanager
import math
from typing import TYPE_CHECKING

from rich.console import Group
from rich.live import Live
from rich.markup import escape
from rich.progress_bar import ProgressBar
from rich.table import Table

from bev_preheat.console.output import ENERGY_ROWS
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.preheat_plan import charging_text, ENERGY_FIELDS
from bev_preheat.messages.simulated_drive import lost_commands_sentence
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console, RenderableType

    from bev_preheat.demo.observer import ObservedDrive
    from bev_preheat.messages.simulated_drive import SimulatedDriveReport

    Row = tuple[str, str, str]

# Simulated time between two lines if the output is not a terminal [s].
PLAIN_LINE_PERIOD_S = 120.0


@contextmanager
def shown(drive: ObservedDrive, console: Console) -> Iterator[Callable[[], None]]:
    """Yield a function that shows the state of an `ObservedDrive`; call it regularly."""
    if console.is_terminal:
        with Live(console=console, auto_refresh=False) as live:
            yield lambda: live.update(_picture_of_now(drive), refresh=True)
    else:
        yield _Lines(drive, console).show


class _Lines:
    """A line for each change of status, and one every few simulated minutes."""

    def __init__(self, drive: ObservedDrive, console: Console) -> None:
        self._drive = drive
        self._console = console
        self._next_s = 0.0
        self._status: Status | None = None

    def show(self) -> None:
        drive = self._drive
        if not (drive.states and drive.commands and drive.plan):
            return
        status = Status(drive.plan.status)
        if status is self._status and drive.time_s < self._next_s:
            return
        if status is not self._status:
            self._console.print(f'{duration_text(drive.time_s):>11}  {status.name}: '
                                f'{drive.plan.explanation}', markup=False, soft_wrap=True)
        self._status = status
        self._next_s = (drive.time_s // PLAIN_LINE_PERIOD_S + 1.0) * PLAIN_LINE_PERIOD_S
        figures = _figures(drive)
        self._console.print(
            f'{duration_text(drive.time_s):>11}  battery {figures["battery"]:>10}  '
            f'state of charge {figures["soc"]}  heater {figures["heater"]:>6}  '
            f'arrival at {figures["arrival"]}',
            soft_wrap=True)


def _figures(drive: ObservedDrive) -> dict[str, str]:
    """Return texts of the latest state, command and prediction."""
    _, temperature_c, soc = drive.states[-1]
    return {
        'battery': f'{temperature_c:.1f} degC',
        'soc': f'{100 * soc:.1f} %',
        'heater': f'{drive.commands[-1][1]:.0f} W' if drive.commands else '-',
        'arrival': f'{drive.predictions[-1][1]:.1f} degC' if drive.predictions else '-',
    }


def _picture_of_now(drive: ObservedDrive) -> RenderableType:
    """Return the display for a terminal."""
    if drive.route is None or not drive.states:
        return 'Waiting for the simulated vehicle and the planner ...'
    figures = _figures(drive)
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style='bold')
    grid.add_column(justify='right', min_width=10)
    grid.add_column()
    first_c, now_c = drive.states[0][1], drive.states[-1][1]
    grid.add_row('Trip', duration_text(drive.time_s), _bar(drive.time_s, drive.duration_s),
                 f'of {duration_text(drive.duration_s)}')
    if drive.target_c > first_c:
        grid.add_row('Battery', figures['battery'],
                     _bar(now_c - first_c, drive.target_c - first_c),
                     f'of {first_c:.1f} ... {drive.target_c:.1f} degC')
    else:
        grid.add_row('Battery', figures['battery'])
    grid.add_row('State of charge', figures['soc'], _bar(drive.states[-1][2], 1.0))
    grid.add_row('Heater command', figures['heater'])
    grid.add_row('Arrival predicted', figures['arrival'])
    if drive.plan is None:
        return grid
    charging = charging_text(drive.plan)
    if charging:
        grid.add_row('Charging predicted', charging)
    return Group(grid, f'[bold]{Status(drive.plan.status).name}[/bold]: '
                       f'{escape(drive.plan.explanation)}')


def _bar(value: float, total: float) -> ProgressBar:
    return ProgressBar(total=total, completed=max(0.0, value), width=40)


def summary_rows(drive: ObservedDrive) -> tuple[Row, list[Row]]:
    """Return (headings, rows) of a table: the first plan and the actual drive."""
    plan, outcome = drive.first_plan, _outcome(drive)
    instants_s = drive.switched_on_s
    planned_s = ((nanoseconds(plan.heating_start) - drive.start_ns) * 1e-9
                 if plan.heating_planned else None)
    _, temperature_c, soc = drive.states[-1]
    rows = [
        ('Heating starts', _instant_text(planned_s),
         _instant_text(instants_s[0] if instants_s else None)),
        ('Heater switched on [times]', str(int(plan.heating_planned)), str(len(instants_s))),
        ('No valid command [s]', '0.0', f'{outcome.without_command_s:.1f}'),
        ('Arrival temperature [degC]', f'{plan.predicted_arrival_temperature:.2f}',
         f'{temperature_c:.2f}'),
        ('Target [degC]', f'{plan.target_battery_temperature:.2f}',
         f'{drive.target_c:.2f}'),
        ('Arrival state of charge [%]', f'{100 * plan.predicted_arrival_soc:.2f}',
         f'{100 * soc:.2f}')]
    rows += [(heading, f'{getattr(plan, ENERGY_FIELDS[field]):.1f}',
              f'{getattr(outcome.energy_wh, field):.1f}') for heading, field in ENERGY_ROWS]
    return ('', 'planned at the start', 'actual'), rows


def _outcome(drive: ObservedDrive) -> SimulatedDriveReport:
    if drive.outcome is None:
        raise ValueError('the drive is not over')
    return drive.outcome


def charging_sentence(drive: ObservedDrive) -> str:
    """Return the sentence on the charging session predicted before any heating, or ''."""
    plan = drive.charging_plan
    if plan is None:
        return ''
    return f'At the charger, as predicted on the way: {charging_text(plan)}. {plan.target_reason}'


def _instant_text(instant_s: float | None) -> str:
    return 'never' if instant_s is None else f'after {duration_text(max(0.0, instant_s))}'


def verdict(drive: ObservedDrive, tolerance_k: float, speed_up: float | None) -> tuple[bool, str]:
    """
    Return (whether the drive is good, a sentence).

    It is if the battery arrived within `tolerance_k` of its target under valid commands all the way. `speed_up` is
    in simulated seconds per real second; None: in lockstep.
    """
    _, temperature_c, _ = drive.states[-1]
    if not drive.has_arrived:
        return False, f'{_outcome(drive).state} after {duration_text(drive.time_s)}: no arrival.'
    if math.isnan(drive.target_c):
        return False, 'the planner never had a target.'
    error_k = temperature_c - drive.target_c
    side = 'above' if error_k > 0.0 else 'below'
    sentence = (f'the battery arrived at {temperature_c:.2f} degC, {abs(error_k):.2f} K {side} '
                f'its target of {drive.target_c:.1f} degC')
    without_s = _outcome(drive).without_command_s
    if without_s > 0.0:
        return False, f'{sentence}, {lost_commands_sentence(without_s, speed_up)}.'
    if abs(error_k) <= tolerance_k:
        return True, f'{sentence}.'
    return False, (f'{sentence}; at most {tolerance_k:g} K is good. Planned at the start: '
                   f'{drive.first_plan.explanation}')
