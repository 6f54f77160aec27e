# SPDX-License-Identifier: Apache-2.0
"""`preheat vehicle published`: published charging times and battery temperatures of cars against computed ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.charging.published import computed_times, computed_warmth
from bev_preheat.commands.output import add_json_argument, json_output, write_json
from bev_preheat.commands.terminal import print_records, result_console
from bev_preheat.files.output_files import check_outputs

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from bev_preheat.charging.published import ComputedTime, ComputedWarmth
    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat.commands.terminal import ResultConsole


def add_published(actions: Subparsers) -> None:
    """Add the action to those of `preheat vehicle`."""
    parser = actions.add_parser(
        'published', help='published charging times and battery temperatures of cars against computed ones',
        description='Compare published figures of cars with those computed from their data sheets. Charging '
                    'times: from the data sheet alone, with the published curve, with the published time from 10 '
                    'to 80 %%, with the shipped file. Battery temperatures: heating runs and charging sessions.')
    parser.add_argument('--sources', action='store_true', help='print the source of each published figure')
    add_json_argument(parser)
    parser.set_defaults(run=run_published)


def run_published(arguments: Namespace) -> int:
    """Print the tables, write the requested file, and return the exit status."""
    check_outputs([json_output(arguments.json)])
    times = computed_times()
    runs, sessions = computed_warmth()
    if arguments.json:
        write_json(arguments.json, {
            'times': [time.as_dictionary() for time in times],
            'heating_runs': [run.as_dictionary() for run in runs],
            'sessions': [session.as_dictionary() for session in sessions]})
    console = result_console(arguments.json)
    _print_times(console, times)
    print_records(console, 'Battery heated by the car, in degC', (
        'car', 'from', 'min', 'published', 'computed', 'rise'), [
            (run.car, f'{run.start_c:g}', f'{run.minutes:g}', f'{run.published_c:g}', f'{run.computed_c:.1f}',
             f'{100.0 * run.deviation:+.0f} %') for run in runs], ('left', *('right',) * 5))
    print_records(console, 'Battery warmed by a charging session, in degC', (
        'car', 'span', 'from', 'published', 'computed', 'rise', 'kW at its end'), [
            (session.car, _span(session), f'{session.start_c:g}', f'{session.published_c:g}',
             f'{session.computed_c:.1f}',
             '' if session.not_comparable else f'{100.0 * session.deviation:+.0f} %',
             f'{session.end_power_kw:.0f}') for session in sessions], ('left', *('right',) * 6))
    for session in sessions:
        if session.not_comparable:
            console.say(f'{session.car}, {_span(session)}: not comparable: {session.not_comparable}.')
    if arguments.sources:
        _print_sources(console, times, runs, sessions)
    return 0


def _print_times(console: ResultConsole, times: Sequence[ComputedTime]) -> None:
    rows = []
    for time in times:
        def text(minutes: float | None, published_min: float = time.published_min) -> str:
            return '' if minutes is None else f'{minutes:.1f} {100.0 * (minutes / published_min - 1.0):+.0f} %'

        rows.append((time.car, _span(time), f'{time.published_min:.1f}',
                     text(time.data_sheet_min), text(time.curve_min),
                     'given' if time.is_fitted else text(time.fitted_min), text(time.shipped_min)))
    print_records(console, 'Charging times in min', (
        'car', 'span', 'published', 'data sheet', 'curve', 'time', 'shipped'), rows,
        ('left', 'right', 'right', 'right', 'right', 'right', 'right'))
    for time in times:
        if time.remark is not None:
            console.say(f'{time.car}, {_span(time)}: {time.remark}.')


def _print_sources(console: ResultConsole, times: Sequence[ComputedTime], runs: Sequence[ComputedWarmth],
                   sessions: Sequence[ComputedWarmth]) -> None:
    figures: list[ComputedTime | ComputedWarmth] = [*times, *sessions]
    for figure in figures:
        console.say(f'{figure.car}, {_span(figure)}: {figure.source}')
    for run in runs:
        console.say(f'{run.car}, heated for {run.minutes:g} min: {run.source}')


def _span(figure: ComputedTime | ComputedWarmth) -> str:
    assert figure.start_soc is not None and figure.end_soc is not None
    return f'{100 * figure.start_soc:g} ... {100 * figure.end_soc:g} %'
