# SPDX-License-Identifier: Apache-2.0
"""
Identify synthetic cars: python3 -m bev_preheat_studies.identification --help.

Prints for each parameter the errors, the least errors that the readings allow (Cramer-Rao bound), and the coverage
of the 90 % intervals. With --closed-loop it prints the arrival errors and heater energy of new drives under the
planner, with the data sheet's vehicle file and the identified one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('identification')

from argparse import RawDescriptionHelpFormatter
from dataclasses import asdict
import sys

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import add_json_argument, json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_figures, print_records, progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.kept_results import kept_results

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from rich.console import Console

    from bev_preheat_studies.identification.closed_loop import DriveResult, FileFigures
    from bev_preheat_studies.identification.study import Outcome

COLUMNS = TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and print its table; returns the exit status."""
    return run_program('identification', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python3 -m bev_preheat_studies.identification', description=__doc__,
                           formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument('--cars', type=int, default=100, metavar='N', help='default: %(default)s')
    parser.add_argument('--first', type=int, default=0, metavar='SEED', help='seed of the first car')
    parser.add_argument('--vehicle', default='small_car', help='vehicle file around which cars are drawn')
    parser.add_argument('--without-heater', action='store_true', help='record no drive with the heater on')
    parser.add_argument('--closed-loop', action='store_true', help='drive the cars under the planner')
    parser.add_argument('--drives', type=int, default=5, metavar='N',
                        help='new drives of each car with --closed-loop (default: %(default)s)')
    parser.add_argument('--without-estimation', action='store_true',
                        help='plan with the vehicle file alone, with --closed-loop')
    parser.add_argument('--results', metavar='FILE', help='file to which each identified car is appended; a car '
                        'that is in it is not identified again')
    add_json_argument(parser)
    parsed = parser.parse_args(arguments)
    for name, low, high in (('cars', 1, 100_000), ('first', 0, 2**31), ('drives', 1, 1000)):
        value = getattr(parsed, name)
        if not low <= value <= high:
            raise InvalidInput(f'--{name}: {value} is not allowed; it must be {low} ... {high}')
    path = vehicle_file(parsed.vehicle)
    load_vehicle(path)
    if parsed.closed_loop and parsed.results is not None:
        raise InvalidInput('--results: does not go with --closed-loop')
    check_outputs([json_output(parsed.json), OutputFile('--results', parsed.results)], [path])
    require('casadi', 'scipy')
    return lambda: (_drive if parsed.closed_loop else _identify)(parsed)


def _seeds(arguments: Namespace) -> range:
    return range(arguments.first, arguments.first + arguments.cars)


def _described(arguments: Namespace) -> dict[str, object]:
    return {'vehicle': arguments.vehicle, 'first': arguments.first, 'cars': arguments.cars,
            'without_heater': arguments.without_heater}


def _identify(arguments: Namespace) -> int:
    from bev_preheat_studies.identification.study import (
        CarResult,
        pooled_coverage,
        result_from,
        study_car,
        summary,
    )
    console = result_console(arguments.json)
    cars: list[Sequence[Outcome]] = []
    study = {'study': 'identification', 'vehicle': arguments.vehicle, 'without_heater': arguments.without_heater}
    with keeping_what_is_finished() as ending, kept_results(arguments.results, study, result_from) as kept:
        for seed in _seeds(arguments):
            car = kept.finished.get(seed)
            if car is None:
                car = CarResult(seed, tuple(study_car(arguments.vehicle, seed, not arguments.without_heater)))
                if kept.keep is not None:
                    kept.keep(seed, car)
            cars.append(car.outcomes)
            last = car.outcomes[0]
            console.print(f'car {seed}: {last.structure}, left out {last.left_out_rmse_k:.2f} K, '
                          f'{last.duration_s:.1f} s', markup=False)
    if arguments.json and cars:
        write_json(arguments.json, {
            **_described(arguments), 'complete': ending.is_complete,
            'results': [{'car': seed, **asdict(outcome)}
                        for seed, outcomes in zip(_seeds(arguments), cars) for outcome in outcomes]})
    if cars:
        print_records(console, f'{len(cars)} synthetic cars around {arguments.vehicle}',
                      ('parameter', 'cars', 'median error', '95 % error', 'bound', 'coverage', 'identified'),
                      [(row.name, f'{row.cars}', f'{100 * row.median:+.1f} %', f'{100 * row.most:.1f} %',
                        '' if row.bound is None else f'{100 * row.bound:.1f} %',
                        f'{100 * row.covered:.0f} %', f'{100 * row.identified:.0f} %')
                       for row in summary(cars)],
                      ('left', *['right'] * 6))
        console.print(f'90 % intervals with the truth, all together: {100 * pooled_coverage(cars):.0f} %',
                      markup=False)
    ending.tell(len(cars), arguments.cars, 'cars', (arguments.json,), arguments.results)
    return 0


def _drive(arguments: Namespace) -> int:
    from bev_preheat.control.settings import Settings
    from bev_preheat_studies.identification.closed_loop import closed_loop_summary, FILES, study_closed_loop
    results: list[DriveResult] = []
    wanted = arguments.cars * arguments.drives * len(FILES)
    with keeping_what_is_finished() as ending, progress_bar(*COLUMNS) as progress:
        task = progress.add_task('drives', total=wanted)

        def report(result: DriveResult) -> None:
            results.append(result)
            progress.update(task, advance=1)

        for seed in _seeds(arguments):
            study_closed_loop(arguments.vehicle, seed, arguments.drives, not arguments.without_heater,
                              Settings(estimation=not arguments.without_estimation), report)
    figures = closed_loop_summary(results)
    if arguments.json and results:
        write_json(arguments.json, {
            **_described(arguments), 'drives': arguments.drives, 'estimation': not arguments.without_estimation,
            'complete': ending.is_complete,
            'summary': [asdict(figure) for figure in figures], 'results': [asdict(result) for result in results]})
    if figures:
        _print_drives(result_console(arguments.json), figures, arguments)
    ending.tell(len(results), wanted, 'drives', (arguments.json,))
    return 0


def _print_drives(console: Console, figures: Sequence[FileFigures], arguments: Namespace) -> None:
    def row(heading: str, show: Callable[[FileFigures], str]) -> tuple[str, ...]:
        return heading, *map(show, figures)

    print_figures(
        console, f'{figures[0].drives} drives of synthetic cars around {arguments.vehicle} under the planner',
        row('vehicle file', lambda of: of.file),
        [row('arrival error, 5 % [K]', lambda of: f'{of.error_5_k:+.2f}'),
         row('… median [K]', lambda of: f'{of.error_50_k:+.2f}'),
         row('… 95 % [K]', lambda of: f'{of.error_95_k:+.2f}'),
         row('… worst [K]', lambda of: f'{of.worst_error_k:+.2f}'),
         row('… RMS [K]', lambda of: f'{of.rms_error_k:.2f}'),
         row('extra heater energy, median [%]', lambda of: f'{100.0 * of.energy_50:+.1f}'),
         row('… 95 % [%]', lambda of: f'{100.0 * of.energy_95:+.1f}'),
         row('switch-ons, mean', lambda of: f'{of.mean_switch_ons:.1f}'),
         row('… most', lambda of: f'{of.most_switch_ons}')])


if __name__ == '__main__':
    sys.exit(main())
