# SPDX-License-Identifier: Apache-2.0
"""`preheat vehicle times`: published charging times of cars against computed ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.charging.published_cars import computed_times
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.terminal import print_records, result_console
from bev_preheat.files.output_files import check_outputs

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.commands.arguments import Subparsers


def add_times(actions: Subparsers) -> None:
    """Add the action to those of `preheat vehicle`."""
    parser = actions.add_parser(
        'times', help='published charging times of cars against computed ones',
        description='Print published charging times of cars, and the times of charging sessions of the same cars, '
                    'described from their data sheets: from the data sheet alone, with the published charging '
                    'curve, with the published time from 10 to 80 %%, and with the file that comes with the '
                    'package.')
    parser.add_argument('--sources', action='store_true', help='print the source of each published time')
    add_json_argument(parser)
    parser.set_defaults(run=run_times)


def run_times(arguments: Namespace) -> int:
    """Print the table, write the requested file, and return the exit status."""
    check_outputs([json_output(arguments.json)])
    times = computed_times()
    if arguments.json:
        write_json(arguments.json, {'times': [time.as_dictionary() for time in times]})
    console = result_console(arguments.json)
    rows = []
    for time in times:
        def text(minutes: float | None, published_min: float = time.published_min) -> str:
            return '' if minutes is None else f'{minutes:.1f} {100.0 * (minutes / published_min - 1.0):+.0f} %'

        span = f'{100 * time.start_soc:g} ... {100 * time.end_soc:g} %'
        rows.append((time.car, span, f'{time.published_min:.1f}',
                     text(time.data_sheet_min), text(time.curve_min),
                     'given' if time.is_fitted else text(time.fitted_min), text(time.shipped_min)))
    print_records(console, 'Charging times in min', (
        'car', 'span', 'published', 'data sheet', 'curve', 'time', 'shipped'), rows,
        ('left', 'right', 'right', 'right', 'right', 'right', 'right'))
    if arguments.sources:
        for time in times:
            console.print(f'{time.car}, {100 * time.start_soc:g} ... {100 * time.end_soc:g} %: {time.source}',
                          markup=False, soft_wrap=True)
    return 0
