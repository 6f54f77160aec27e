# SPDX-License-Identifier: Apache-2.0
"""Output of the subcommands: tables of plans side by side, JSON."""

from __future__ import annotations

from argparse import _ArgumentGroup as ArgumentGroup
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Sequence
from functools import partial
import json
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.commands.program import write_output
from bev_preheat.commands.terminal import print_figures, result_console, ResultConsole
from bev_preheat.drawing.figure import save_figure
from bev_preheat.files.output_files import (
    check_outputs,
    OutputFile,
    PICTURE_SUFFIXES,
    STANDARD_OUTPUT,
    write_whole,
)
from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.explanation import duration_text

if TYPE_CHECKING:
    from rich.console import Console

    from bev_preheat.drawing.figure import Figure
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.planning.plan import Plan

    # JSON values: dictionaries, lists, texts, numbers, None.
    Json = Any

# Rows of the table: heading, function that reads the figure from a plan.
ENERGY_ROWS = (
    ('Joule heat [Wh]', 'joule'),
    ('Drivetrain heat [Wh]', 'drivetrain_heat'),
    ('HVCH heat [Wh]', 'hvch_heat'),
    ('HVCH electric [Wh]', 'hvch_electric'),
    ('Leakage [Wh]', 'leakage'),
    ('Battery total [Wh]', 'battery_total'),
)


def add_output_arguments(parser: ArgumentParser) -> None:
    """Add `--json` and `--plot`."""
    add_json_argument(parser)
    parser.add_argument('--plot', metavar='FILE', help='draw the result (PNG, SVG, PDF)')


def add_json_argument(parser: ArgumentParser | ArgumentGroup) -> None:
    """Add `--json`."""
    parser.add_argument('--json', metavar='FILE',
                        help='write the result as JSON; - is standard output, and tables then go to '
                        'standard error')


def json_output(path: AnyPath | None, make_folder: bool = False) -> OutputFile:
    """Return the OutputFile of `--json`, which may be '-'."""
    return OutputFile('--json', None if path == STANDARD_OUTPUT else path, make_folder=make_folder)


def check_output_arguments(arguments: Namespace, inputs: Sequence[AnyPath],
                           others: Sequence[OutputFile] = ()) -> None:
    """Check `--json`, `--plot` and others before anything is computed; raise InvalidInput, also for an input."""
    check_outputs([json_output(arguments.json),
                   OutputFile('--plot', arguments.plot, PICTURE_SUFFIXES), *others], inputs)


def write_json(path: AnyPath, contents: Json, make_folder: bool = False) -> None:
    """Write JSON; `-` is standard output. NaN and infinity, which JSON cannot represent, become null."""
    text = json.dumps(_without_nan(contents), indent=2, allow_nan=False) + '\n'
    if path == STANDARD_OUTPUT:
        write_output(text)
    else:
        write_whole(path, text, make_folder)


def write_results(arguments: Namespace, contents: Callable[[], Json],
                  draw: Callable[[], Figure]) -> ResultConsole:
    """Write `--json`, and `--plot` as `draw` draws it, if requested; return the console for tables."""
    if arguments.json:
        write_json(arguments.json, contents())
    if arguments.plot:
        save_figure(draw(), arguments.plot)
    return result_console(arguments.json)


def _without_nan(value: Json) -> Json:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_plans(console: Console, plans: Sequence[Plan], title: str,
                headings: Sequence[str] | None = None,
                more_rows: Iterable[Sequence[str]] = ()) -> None:
    """Print a table with a column for each plan, its heading or its method above, `more_rows` below."""
    rows: list[tuple[str, Callable[[Plan], str]]] = [
        ('Status', lambda plan: plan.status.name),
        ('Heating starts after', lambda plan: _text(plan.heating_start_s)),
        ('… before arrival', lambda plan: _text(
            None if plan.heating_start_s is None
            else plan.arrival_time_s - plan.heating_start_s)),
        ('Arrival after', lambda plan: duration_text(plan.arrival_time_s)),
        ('Arrival temp. [degC]', lambda plan: f'{plan.arrival_temperature_c:.2f}'),
        ('Target [degC]', lambda plan: f'{plan.target_temperature_c:.2f}' + (
            '' if math.isinf(plan.maximum_arrival_temperature_c) else
            f' … {plan.maximum_arrival_temperature_c:.2f}')),
        ('Arrival SoC [%]', lambda plan: f'{100 * plan.arrival_soc:.2f}')]
    if any(plan.cooling_start_s is not None for plan in plans):
        rows.insert(1, ('Cooling starts after', lambda plan: _text(plan.cooling_start_s)))
    names = dict.fromkeys(name for plan in plans for name in plan.source_power_w)
    for heading, field in ENERGY_ROWS:
        rows.append((heading.replace('HVCH', 'Sources:') if names else heading, _energy_text(field)))
        if field == 'hvch_electric':
            rows += [(f'… {name} [Wh]', partial(_source_text, name)) for name in names]
    rows.append(('Planning time [ms]', lambda plan: f'{1e3 * plan.planning_time_s:.2f}'))
    print_figures(
        console, title, ['', *(headings or [plan.method for plan in plans])],
        [(heading, *map(figure, plans)) for heading, figure in rows] + list(more_rows))


def _energy_text(field: str) -> Callable[[Plan], str]:
    return lambda plan: f'{getattr(plan.energy_wh, field):.1f}'


def _source_text(name: str, plan: Plan) -> str:
    power_w = plan.source_power_w.get(name)
    return '–' if power_w is None else f'{float(power_w @ np.diff(plan.time_s)) / JOULES_PER_WH:.1f}'


def _text(seconds: float | None) -> str:
    return 'never' if seconds is None else duration_text(seconds)
