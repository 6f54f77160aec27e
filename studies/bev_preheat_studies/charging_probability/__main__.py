# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.charging_probability`: plans if charging is uncertain.

Compares the best target of random drives with a search over start and end of heating, by expected cost. With
--closed-loop: drives under the planner, always heated, never heated, and by expected cost. With --tables: the
reference trip over the probability, over the deviation of the arrival time, and over the spread of the cells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('charging_probability')

from argparse import RawDescriptionHelpFormatter
from dataclasses import asdict
import sys

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_figures, print_records, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile
from bev_preheat_studies.charging_probability.brute_force import COMPARED, Gap, gap_from, run_gaps
from bev_preheat_studies.charging_probability.closed_loop import (
    difference,
    Driven,
    driven_from,
    PROBABILITIES,
    run_drives,
)
from bev_preheat_studies.charging_probability.reference_tables import print_tables
from bev_preheat_studies.kept_results import kept_results

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from rich.console import Console

COLUMNS = TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
# Drives listed by number: gaps above this share of the cost.
LISTED_GAP = 1e-3


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its tables; returns the exit status."""
    return run_program('charging_probability', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.charging_probability', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--drives', type=int, default=100, metavar='N', help='default: %(default)s')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    parser.add_argument('--closed-loop', action='store_true', help='drive under the planner')
    parser.add_argument('--tables', action='store_true', help='the tables of the reference trip')
    parser.add_argument('--results', metavar='FILE',
                        help='append each result to this file (JSON lines); if the file exists, the study '
                        'resumes from it')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('drives', 1, 100_000), ('seed', 0, 2**31), ('jobs', 1, 1024)):
        value = getattr(parsed, name)
        if value is not None and not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    if parsed.tables and (parsed.closed_loop or parsed.json or parsed.results):
        raise InvalidInput('--tables: not allowed with --closed-loop, --json and --results')
    check_outputs([json_output(parsed.json), OutputFile('--results', parsed.results)], ())
    return lambda: _tables() if parsed.tables else (_drive if parsed.closed_loop else _search)(parsed)


def _tables() -> int:
    print_tables(result_console())
    return 0


def _search(arguments: Namespace) -> int:
    gaps: list[Gap] = []
    study = {'study': 'charging_probability', 'seed': arguments.seed}
    with (keeping_what_is_finished() as ending, kept_results(arguments.results, study, gap_from) as kept,
          progress_bar(*COLUMNS) as progress):
        task = progress.add_task('compared drives', total=arguments.drives)

        def report(gap: Gap) -> None:
            gaps.append(gap)
            progress.update(task, advance=gap.outcome == COMPARED)

        run_gaps(arguments.drives, arguments.seed, arguments.jobs, report, kept)
    compared = [gap for gap in gaps if gap.outcome == COMPARED]
    if compared:
        if arguments.json:
            write_json(arguments.json, {'seed': arguments.seed, 'complete': ending.is_complete, 'drives': [
                {**asdict(gap), 'gap': gap.gap} for gap in compared]})
        print_gaps(result_console(arguments.json), gaps, compared)
    ending.tell(len(compared), arguments.drives, 'drives', (arguments.json,), arguments.results)
    return 0


def print_gaps(console: Console, gaps: Sequence[Gap], compared: Sequence[Gap]) -> None:
    """Print the table of the compared Gaps, and the drives with a large one."""
    console.print(f'{len(gaps)} drives: {len(compared)} compared, {len(gaps) - len(compared)} not driven',
                  soft_wrap=True)
    groups = (('all drives', compared),
              ('arrival time exact', [gap for gap in compared if gap.prospect.arrival_deviation_s == 0.0]),
              ('arrival time uncertain', [gap for gap in compared if gap.prospect.arrival_deviation_s > 0.0]),
              ('heat arrives at once', [gap for gap in compared if not gap.has_heat_path]),
              ('with a heat path', [gap for gap in compared if gap.has_heat_path]))
    rows = []
    for name, group in groups:
        values = [100.0 * gap.gap for gap in group] or [float('nan')]
        rows.append((name, str(len(group)),
                     *(f'{np.percentile(values, q):.4f}' for q in (0.0, 50.0, 95.0, 100.0))))
    print_figures(console, 'Expected cost of the best target above the best start and end of heating (%)',
                  ('', 'drives', 'least', 'median', '95 %', 'worst'), rows)
    worth = [100.0 * (1.0 - gap.cost / gap.certain_cost) for gap in compared]
    console.print(f'Compared with the best target for certain charging the expected cost is lower by '
                  f'{np.mean(worth):.2f} % in the mean, {max(worth):.2f} % at most.', soft_wrap=True)
    for gap in compared:
        if gap.gap > LISTED_GAP:
            prospect = gap.prospect
            console.print(f'drive {gap.number}: best target {gap.cost:.4f}, search {gap.searched_cost:.4f}, '
                          f'probability {prospect.probability:.2f}, arrival +-{prospect.arrival_deviation_s:.0f} '
                          f's, known {prospect.known_before_arrival_s:.0f} s before'
                          + (', heat path' if gap.has_heat_path else ''), soft_wrap=True)


def _drive(arguments: Namespace) -> int:
    drives: list[Driven] = []
    study = {'study': 'charging_probability --closed-loop', 'seed': arguments.seed}
    with (keeping_what_is_finished() as ending, kept_results(arguments.results, study, driven_from) as kept,
          progress_bar(*COLUMNS) as progress):
        task = progress.add_task('drives', total=arguments.drives)

        def report(driven: Driven) -> None:
            if driven.never is not None:
                drives.append(driven)
            progress.update(task, advance=driven.never is not None)

        run_drives(arguments.drives, arguments.seed, arguments.jobs, report, kept)
    if drives:
        if arguments.json:
            write_json(arguments.json, {'seed': arguments.seed, 'complete': ending.is_complete,
                                        'probabilities': PROBABILITIES,
                                        'drives': [asdict(each) for each in drives]})
        print_drives(result_console(arguments.json), drives)
    ending.tell(len(drives), arguments.drives, 'drives', (arguments.json,), arguments.results)
    return 0


def print_drives(console: Console, drives: Sequence[Driven]) -> None:
    """Print the mean costs over the probability, and their differences with confidence intervals."""
    rows = []
    for at, probability in enumerate(PROBABILITIES):
        always, never, expected = (
            [way.cost(probability) for way in ways if way is not None] for ways in (
                [each.always for each in drives], [each.never for each in drives],
                [each.expected[at] for each in drives]))
        rows.append((f'{100.0 * probability:.0f} %',
                     *(f'{np.mean(costs):.4f}' for costs in (always, never, expected)),
                     *('{:+.4f} +-{:.4f}'.format(*difference(expected, costs)) for costs in (always, never)),
                     str(max(each.expected[at].switch_ons for each in drives))))
    print_records(
        console, f'{len(drives)} drives under the planner: mean expected cost, and its differences (95 %)',
        ('chance', 'always', 'never', 'planned', 'planned - always', 'planned - never', 'most switch-ons'), rows,
        ('right',) * 7)


if __name__ == '__main__':
    sys.exit(main())
