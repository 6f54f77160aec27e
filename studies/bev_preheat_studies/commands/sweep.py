# SPDX-License-Identifier: Apache-2.0
"""`preheat sweep`: the methods on many random trips, compared with the nonlinear program or over a fleet."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.commands.completion import completed_by, VEHICLES
from bev_preheat.commands.method_argument import add_methods_argument
from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_output_arguments, write_json
from bev_preheat.console.terminal import print_figures, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require
from bev_preheat.planning.comparison import SAME_SHORTFALL_K
from bev_preheat.planning.planner import METHODS
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.commands.study_arguments import add_study_arguments, check_study_arguments, study_executor
from bev_preheat_studies.commands.sweep_fleet import run_fleet_sweep
from bev_preheat_studies.kept_results import kept_results
from bev_preheat_studies.optimality.gap_figures import PERCENTILES, summarise_gaps
from bev_preheat_studies.optimality.gap_study import FEASIBLE
from bev_preheat_studies.sources import digest_of

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from bev_preheat.commands.arguments import Subparsers
    from bev_preheat.console.finished import InterruptedEnding
    from bev_preheat_studies.optimality.gap_figures import Figures
    from bev_preheat_studies.optimality.gap_study import GapResult

# (low, high) that the options allow, and the defaults of the options that a fleet does not have.
LIMITS = {'feasible': (1, 100_000), 'seed': (0, 2**31), 'fleet': (1, 100_000_000)}
NOT_OF_FLEETS = {'feasible': 300, 'trips': 'free', 'vehicle': 'reference', 'methods': tuple(METHODS)}
# Most disagreements printed for a method; the JSON has all.
MOST_LISTED = 10


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'sweep', help='methods compared with the nonlinear program on random trips',
        description="Random trips: the distribution of each method's extra energy over the optimum of the "
        'nonlinear program, where the method reaches the same.')
    parser.add_argument('--feasible', type=int, metavar='N',
                        help='draw until N trips are feasible (default: 300)')
    parser.add_argument('--trips', choices=('free', 'limits'),
                        help="free: only the heater's limit is active; limits: descents, climbs, "
                        'tight reserves and a changing cabin demand (default: free)')
    parser.add_argument('--fleet', type=int, metavar='N',
                        help='instead, without the nonlinear program: N winter trips of different cars to '
                        'fast chargers, and the savings of each method at the charger compared with '
                        'no heating')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    add_methods_argument(parser, ', '.join(METHODS))
    add_study_arguments(parser)
    completed_by(VEHICLES, parser.add_argument(
        '--vehicle', metavar='NAME|FILE', help='vehicle to scale (default: reference)'))
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run the study; returns 0. An interrupted study is summarised up to that point."""
    given = [name for name in NOT_OF_FLEETS if getattr(arguments, name) is not None]
    if arguments.fleet is not None and given:
        raise InvalidInput(f'--{given[0]} does not go with --fleet, which draws cars and trips of its own')
    for name, value in NOT_OF_FLEETS.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)
    for name, (low, high) in LIMITS.items():
        value = getattr(arguments, name)
        if value is not None and not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    return run_fleet_sweep(arguments) if arguments.fleet is not None else _run_gaps(arguments)


def _run_gaps(arguments: Namespace) -> int:
    from bev_preheat_studies.optimality.gap_study import result_from, run_study
    check_study_arguments(arguments, (vehicle_file(arguments.vehicle),))
    require('casadi')
    vehicle = load_vehicle(arguments.vehicle)
    study = {'study': 'sweep', 'seed': arguments.seed, 'trips': arguments.trips,
             'vehicle': f'{vehicle.name} ({digest_of(vehicle)})'}
    methods = tuple(dict.fromkeys(arguments.methods))
    if methods != tuple(METHODS):
        study['methods'] = list(methods)
    results = []
    with (keeping_what_is_finished() as ending,
          kept_results(arguments.results, study, result_from) as kept,
          study_executor(arguments) as executor,
          progress_bar(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                       TimeElapsedColumn()) as progress):
        task = progress.add_task('feasible trips', total=arguments.feasible)

        def report(result: GapResult) -> None:
            results.append(result)
            progress.update(task, advance=result.outcome == FEASIBLE,
                            description=f'feasible of {len(results)} trips')

        run_study(vehicle, arguments.feasible, arguments.seed, executor, report, arguments.trips,
                  kept.finished, kept.keep, methods)
    if results:
        _give_out(arguments, results, methods, ending)
    ending.tell(sum(result.outcome == FEASIBLE for result in results), arguments.feasible,
                'feasible trips', (arguments.json, arguments.plot), arguments.results)
    return 0


def _give_out(arguments: Namespace, results: list[GapResult], methods: Sequence[str],
              ending: InterruptedEnding) -> None:
    summary = summarise_gaps(results, methods)
    if arguments.json:
        write_json(arguments.json, {'seed': arguments.seed, 'trips': arguments.trips,
                                    'vehicle': arguments.vehicle,
                                    'feasible': arguments.feasible,
                                    'complete': ending.is_complete,
                                    'summary': summary,
                                    'results': [asdict(result) for result in results]})
    if arguments.plot:
        from bev_preheat_studies.drawing.study_figure import draw_study
        draw_study(arguments.plot, results, methods)
    console = result_console(arguments.json)
    if not ending.is_complete:
        console.print('Interrupted: only part of the study has run.')
    print_summary(console, summary)


def print_summary(console: Console, summary: Figures) -> None:
    """Print the tables of a summary."""
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items())
    console.print(f'{summary["trips"]} trips: {outcomes}', soft_wrap=True)
    rows = []
    for method, figures in summary['methods'].items():
        for heading, key, factor in (('energy gap (Wh)', 'gap_wh', 1.0),
                                     ('arrival error (K)', 'arrival_error_k', 1.0),
                                     ('limit broken by (%)', 'violation', 100.0),
                                     ('planning time (ms)', 'planning_time_s', 1e3)):
            rows.append((f'{method}: {heading}', *_distribution(figures[key], factor)))
    rows.append(('nlp: solve time (ms)', *_distribution(summary['solve_time_s'], 1e3)))
    print_figures(console, 'Compared with the nonlinear program, on the feasible trips',
                  ('', *PERCENTILES), rows)
    feasible = summary['outcomes'].get(FEASIBLE, 0)
    for method, figures in summary['methods'].items():
        others = feasible - figures['compared_trips']
        console.print(
            f'{method}: worst gap in trip {figures["worst_trip"]}; ' +
            (f'{others} trips have no gap, as the method does not reach the same as the program '
             f'(to {SAME_SHORTFALL_K:g} K); ' if others else '') +
            f'{figures["plans_that_break_limits"]} plans break a limit and are shown as driven '
            f'within it; {len(figures["disagreements"])} trips in which its status contradicts '
            'the program', soft_wrap=True)
        shown = figures['disagreements'][:MOST_LISTED]
        for item in shown:
            console.print(f'  trip {item["number"]}: the program says {item["outcome"]}, '
                          f'{method} says {item["status"]}', soft_wrap=True)
        if len(figures['disagreements']) > len(shown):
            console.print(f'  … and {len(figures["disagreements"]) - len(shown)} more')
    for failure in summary['solver_failures']:
        console.print(f'solver failed on trip {failure["number"]}: {failure["detail"]}',
                      markup=False, soft_wrap=True)


def _distribution(values: Mapping[str, float], factor: float) -> list[str]:
    """Return the texts of a distribution, which is empty without trips."""
    return [f'{factor * values[name]:.4g}' if values else '–' for name in PERCENTILES]
