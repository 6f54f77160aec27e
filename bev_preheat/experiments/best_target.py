# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat.experiments.best_target`: the best target against the program of drive and session.

Draws random drives to a charger, finds the best target of each as `preheat worth` does, solves the
joint nonlinear program from several starts, drives and charges both plans with the same simulation, and
reports by how much the best target costs more. Ctrl-C ends the study; the summary is then of the trips
that are finished.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # What is loaded below takes a second, in which Ctrl-C may come.
    loading('best_target')

from argparse import RawDescriptionHelpFormatter
from dataclasses import asdict
import sys

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_figures, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.experiments.optimality.worth_gap import COMPARED, PERCENTILES, run_worth_study, summarise
from bev_preheat.files.output_files import check_outputs
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence
    from typing import Any

    from rich.console import Console

    from bev_preheat.experiments.optimality.worth_gap import WorthGap

# Trips that are listed: gaps above this share of the cost.
LISTED_GAP = 1e-3
ROWS = (('all trips', 'gap'), ('… program not shown the best target', 'blind_gap'),
        ('heated, heat arrives at once', 'heated_gap'), ('heated, with a heat path', 'heat_path_gap'))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and report it; returns the exit status."""
    return run_program('best_target', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat.experiments.best_target', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--trips', type=int, default=100, metavar='N',
                        help='draw until N trips are compared (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('trips', 1, 100_000), ('seed', 0, 2**31), ('jobs', 1, 1024)):
        value = getattr(parsed, name)
        if value is not None and not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    check_outputs([json_output(parsed.json)], ())
    require('casadi')
    return lambda: _study(parsed)


def _study(arguments: Namespace) -> int:
    results: list[WorthGap] = []
    with (keeping_what_is_finished() as ending,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('compared trips', total=arguments.trips)

        def report(result: WorthGap) -> None:
            results.append(result)
            progress.update(task, advance=result.outcome == COMPARED)

        run_worth_study(arguments.trips, arguments.seed, arguments.jobs, report)
    if results:
        summary = summarise(results)
        if arguments.json:
            write_json(arguments.json, {
                'seed': arguments.seed, 'complete': ending.is_complete, 'summary': summary,
                'results': [{**asdict(result), 'gap': result.gap, 'blind_gap': result.blind_gap}
                            for result in results]})
        console = result_console(arguments.json)
        if not ending.is_complete:
            console.print('Interrupted: this is a part of the study.')
        print_summary(console, summary, results)
    ending.tell(sum(result.outcome == COMPARED for result in results), arguments.trips, 'trips',
                (arguments.json,))
    return 0


def print_summary(console: Console, summary: dict[str, Any], results: Sequence[WorthGap]) -> None:
    """Print the table of a summary, and the trips that are worth a look."""
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items() if count)
    console.print(f'{summary["trips"]} trips: {outcomes}; {summary["heated"]} are heated, '
                  f'{summary["heated_by_heat_path"]} of them with a heat path', soft_wrap=True)
    columns = ('least', *PERCENTILES)
    print_figures(
        console, 'Cost of the best target above the joint program (%)', ('', *columns),
        [(heading, *(f'{100.0 * summary[key][name]:.4f}' if summary[key] else '–' for name in columns))
         for heading, key in ROWS])
    console.print(f'IPOPT failed in {summary["failed_calls"]} of {summary["calls"]} calls; it found '
                  f'optima of different cost in {len(summary["several_optima"])} trips', soft_wrap=True)
    for result in results:
        if (result.gap is not None and abs(result.gap) > LISTED_GAP) or (
                result.blind_gap is not None and result.blind_gap < -LISTED_GAP):
            console.print(
                f'trip {result.number}, {result.vehicle}: best target {result.arrival_c:.1f} degC costs '
                f'{result.cost:.3f}, program {result.program_arrival_c:.1f} degC '
                f'{result.program_cost:.3f}, without the start from the best target '
                + (f'{result.blind_cost:.3f}' if result.blind_cost is not None else 'none'),
                soft_wrap=True)


if __name__ == '__main__':
    sys.exit(main())
