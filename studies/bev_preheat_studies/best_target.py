# SPDX-License-Identifier: Apache-2.0
"""
`python3 -m bev_preheat_studies.best_target`: the best target against the joint program of drive and session.

Draws random drives to a charger, finds the best target of each as `preheat worth` does, and solves the
joint nonlinear program from several starts. Drives and charges both plans with the same simulation, and
reports the extra cost of the best target. Ctrl-C ends the study with a summary of the finished trips.
--only shows one trip, start by start; --reference shows the cases of the reference trip.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('best_target')

from argparse import RawDescriptionHelpFormatter
from dataclasses import asdict
import math
import sys

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.charging.stop import stop_after
from bev_preheat.charging.worth import minima
from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_figures, print_records, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile
from bev_preheat.optional_packages import require
from bev_preheat_studies.charging_worth import cases, DEPARTURE_SOC, PRICES, trip_of
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.optimality.charging_trips import ChargingTrip, draw_charging_trip
from bev_preheat_studies.optimality.worth_gap import (
    compare,
    COMPARED,
    PERCENTILES,
    result_from,
    run_worth_study,
    solve_both,
    summarise,
)

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence
    from typing import Any

    from rich.console import Console

    from bev_preheat.charging.worth import Worth
    from bev_preheat.nonlinear_program.charging_program import ChargingOptimum
    from bev_preheat_studies.charging_worth import WorthCase
    from bev_preheat_studies.optimality.worth_gap import WorthGap

# Trips listed by number: gaps above this share of the cost.
LISTED_GAP = 1e-3
ROWS = (('all trips', 'gap'), ('… program not started from the best target', 'blind_gap'),
        ('heated, heat arrives at once', 'heated_gap'), ('heated, with a heat path', 'heat_path_gap'),
        ('the car cools at the charger', 'cooled_gap'))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and report it; returns the exit status."""
    return run_program('best_target', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.best_target', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--trips', type=int, default=100, metavar='N',
                        help='draw until N trips are compared (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    parser.add_argument('--only', type=int, metavar='NUMBER', help='show this trip of the study')
    parser.add_argument('--reference', action='store_true', help='show the cases of the reference trip')
    parser.add_argument('--results', metavar='FILE',
                        help='append each result to this file (JSON lines); if the file exists, the study '
                        'resumes from it')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('trips', 1, 100_000), ('seed', 0, 2**31), ('jobs', 1, 1024),
                            ('only', 0, 100_000)):
        value = getattr(parsed, name)
        if value is not None and not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    check_outputs([json_output(parsed.json), OutputFile('--results', parsed.results)], ())
    shows = parsed.only is not None or parsed.reference
    if shows and (parsed.json or parsed.results or (parsed.only is not None and parsed.reference)):
        raise InvalidInput('--only, --reference: not allowed together, nor with --json or --results')
    require('casadi')
    if shows:
        return lambda: _show(parsed)
    return lambda: _study(parsed)


def _study(arguments: Namespace) -> int:
    results: list[WorthGap] = []
    study = {'study': 'best_target', 'seed': arguments.seed}
    with (keeping_what_is_finished() as ending,
          kept_results(arguments.results, study, result_from) as kept,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('compared trips', total=arguments.trips)

        def report(result: WorthGap) -> None:
            results.append(result)
            progress.update(task, advance=result.outcome == COMPARED)

        run_worth_study(arguments.trips, arguments.seed, arguments.jobs, report, kept)
    if results:
        summary = summarise(results)
        if arguments.json:
            write_json(arguments.json, {
                'seed': arguments.seed, 'complete': ending.is_complete, 'summary': summary,
                'results': [{**asdict(result), 'gap': result.gap, 'blind_gap': result.blind_gap}
                            for result in results]})
        console = result_console(arguments.json)
        if not ending.is_complete:
            console.print('Interrupted: only part of the study has run.')
        print_summary(console, summary, results)
    ending.tell(sum(result.outcome == COMPARED for result in results), arguments.trips, 'trips',
                (arguments.json,), arguments.results)
    return 0


def _show(arguments: Namespace) -> int:
    console = result_console()
    if arguments.reference:
        print_cases(console, [(case, compare(reference_trip(case))) for case in cases()])
        return 0
    trip = draw_charging_trip(arguments.seed, arguments.only)
    print_trip(console, trip, *solve_both(trip))
    return 0


def reference_trip(case: WorthCase) -> ChargingTrip:
    """Return a case of the reference trip as a trip of the study."""
    vehicle, route, state, goal = trip_of(case)
    return ChargingTrip(0, 0, vehicle, route, state, goal,
                        stop_after(route, case.charger_w, DEPARTURE_SOC), PRICES)


def print_cases(console: Console, compared: Sequence[tuple[WorthCase, WorthGap]]) -> None:
    """Print the comparison on the reference trip."""
    print_records(
        console, 'Reference trip: the best target and the joint program',
        ('charger [kW]', 'air [degC]', 'arrival [%]', 'best [degC]', 'program [degC]', 'cost',
         'program', 'gap [%]'),
        [(f'{case.charger_w / 1000.0:.0f}', f'{case.ambient_c:.0f}', f'{100.0 * case.arrival_soc:.0f}',
          f'{result.arrival_c:.1f}', f'{result.program_arrival_c:.1f}', f'{result.cost:.4f}',
          f'{result.program_cost:.4f}', f'{100.0 * result.gap:.4f}')
         for case, result in compared if result.gap is not None], ('right',) * 8)


def print_trip(console: Console, trip: ChargingTrip, worth: Worth, optimum: ChargingOptimum) -> None:
    """Print the minima of the cost over the target, and where IPOPT ends from each start."""
    by_target = [target for target in worth.targets if math.isfinite(target.cost)]
    print_records(
        console, f'Trip {trip.number}, {trip.vehicle.name}',
        ('minimum of the cost over the target: arrival [degC]', 'cost'),
        [(f'{by_target[place].arrival_temperature_c:.2f}', f'{by_target[place].cost:.4f}')
         for place in minima([target.cost for target in by_target])], ('right',) * 2)
    print_records(
        console, 'IPOPT from each start', ('start costs', 'status', 'iterations', 'program takes it for',
                                           'as simulated', 'arrival [degC]'),
        [(f'{attempt.start:.4f}', attempt.status, str(attempt.iterations), f'{attempt.program_cost:.4f}',
          *(('–', '–') if attempt.driven is None else (
              f'{attempt.driven.cost:.4f}', f'{attempt.driven.plan.arrival_temperature_c:.2f}')))
         for attempt in optimum.attempts], ('right', 'left', *('right',) * 4))


def print_summary(console: Console, summary: dict[str, Any], results: Sequence[WorthGap]) -> None:
    """Print the table of a summary, and the trips with a large gap."""
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items() if count)
    console.print(f'{summary["trips"]} trips: {outcomes}; {summary["heated"]} are heated, '
                  f'{summary["heated_by_heat_path"]} with a heat path; in {summary["cooled"]} the car cools its '
                  'battery at the charger', soft_wrap=True)
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
