# SPDX-License-Identifier: Apache-2.0
"""`preheat sweep`: the methods against the nonlinear program on many random trips."""

from dataclasses import asdict

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_json
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.planner import METHODS
from bev_preheat.vehicle import vehicle_file

# Disagreements shown for a method; the JSON has all.
MOST_LISTED = 10


def add_parser(subparsers):
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'sweep', help='methods against the nonlinear program on random trips',
        description='Draws random trips, plans each with every method, solves each nonlinear '
        'program, and reports the distribution of what the methods cost more.')
    parser.add_argument('--feasible', type=int, default=300, metavar='N',
                        help='draw until N trips are feasible (default: %(default)s)')
    parser.add_argument('--trips', choices=('free', 'limits'), default='free',
                        help='free: no limit but the heater\'s is active; limits: descents, climbs, '
                        'tight reserves and a changing cabin demand (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='default: %(default)s')
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: all cores)')
    parser.add_argument('--vehicle', default='reference', metavar='NAME|FILE',
                        help='vehicle that is scaled (default: %(default)s)')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments):
    """Run the study; returns 0."""
    from bev_preheat.study.run import run_study
    from bev_preheat.study.summary import summarise
    for name, low, high in (('feasible', 1, 100_000), ('seed', 0, 2**31), ('jobs', 1, 1024)):
        value = getattr(arguments, name)
        if value is not None and not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    check_output_arguments(arguments, (vehicle_file(arguments.vehicle),))
    console = Console()
    with Progress(TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(),
                  TimeElapsedColumn(), console=console) as progress:
        task = progress.add_task('feasible trips', total=arguments.feasible)

        def report(found, drawn):
            progress.update(task, completed=found, description=f'feasible of {drawn} trips')

        results = run_study(arguments.vehicle, arguments.feasible, arguments.seed,
                            arguments.jobs, report, arguments.trips)
    summary = summarise(results, METHODS)
    print_summary(console, summary)
    if arguments.json:
        write_json(arguments.json, {'seed': arguments.seed, 'trips': arguments.trips,
                                    'vehicle': arguments.vehicle,
                                    'summary': summary,
                                    'results': [asdict(result) for result in results]})
    if arguments.plot:
        from bev_preheat.drawing.study_figure import draw_study
        draw_study(arguments.plot, results, METHODS)
    return 0


def print_summary(console, summary):
    """Print the tables of a summary."""
    outcomes = ', '.join(f'{count} {name}' for name, count in summary['outcomes'].items())
    console.print(f'{summary["trips"]} trips: {outcomes}', highlight=False)
    table = Table(title='Against the nonlinear program, on the feasible trips')
    for heading in ('', 'median', '95 %', 'worst'):
        table.add_column(heading, justify='right' if heading else 'left')
    for method, figures in summary['methods'].items():
        for heading, key, factor in (('energy gap (Wh)', 'gap_wh', 1.0),
                                     ('arrival error (K)', 'arrival_error_k', 1.0),
                                     ('limit broken by (%)', 'violation', 100.0),
                                     ('planning time (ms)', 'planning_time_s', 1e3)):
            table.add_row(f'{method}: {heading}', *(
                f'{factor * value:.4g}' for value in figures[key].values()))
    table.add_row('nlp: solve time (ms)', *(
        f'{1e3 * value:.4g}' for value in summary['solve_time_s'].values()))
    console.print(table)
    for method, figures in summary['methods'].items():
        console.print(f'{method}: worst gap in trip {figures["worst_trip"]}; '
                      f'{figures["plans_that_break_limits"]} plans break a limit and are shown as '
                      f'driven within it; '
                      f'{len(figures["disagreements"])} trips in which its status contradicts the '
                      'program', highlight=False)
        shown = figures['disagreements'][:MOST_LISTED]
        for item in shown:
            console.print(f'  trip {item["number"]}: the program says {item["outcome"]}, '
                          f'{method} says {item["status"]}', highlight=False)
        if len(figures['disagreements']) > len(shown):
            console.print(f'  … and {len(figures["disagreements"]) - len(shown)} more',
                          highlight=False)
    for failure in summary['solver_failures']:
        console.print(f'solver failed on trip {failure["number"]}: {failure["detail"]}',
                      highlight=False)
