# SPDX-License-Identifier: Apache-2.0
"""`preheat export-ecu`: the planner as C sources for one vehicle, with reference plans."""

from __future__ import annotations

from argparse import Namespace
import shlex

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from bev_preheat.code_generation.ecu_export import Export
from bev_preheat.code_generation.ecu_vectors import BAD_INPUT, METHODS, OK
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.situation import add_vehicle_argument
from bev_preheat.commands.terminal import progress_bar, result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat.vehicle.plausibility import assumption_warning

VECTORS, MOST_VECTORS = 100, 100_000


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'export-ecu', help='write the planner for one vehicle as C sources',
        description='Write the planner for one vehicle as C99 sources for a control unit: optimal_switch, '
        'value_function, the vehicle as constants, and reference plans of Python to test the compiled code.')
    add_vehicle_argument(parser)
    parser.add_argument('--output', required=True, metavar='DIR',
                        help='folder to write; replaces an earlier export')
    parser.add_argument('--vectors', type=int, default=VECTORS, metavar='N',
                        help='situations to compare (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, help='seed of the situations (default: %(default)s)')
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Write the folder and print its contents; returns the exit status."""
    if not 1 <= arguments.vectors <= MOST_VECTORS:
        raise InvalidInput(
            f'--vectors: {arguments.vectors} is not allowed; it must be 1 ... {MOST_VECTORS}')
    if arguments.seed < 0:
        raise InvalidInput(f'--seed: {arguments.seed} is not allowed; it must be 0 or more')
    vehicle, file = load_vehicle(arguments.vehicle), vehicle_file(arguments.vehicle)
    export = Export(vehicle, arguments.output, [file])
    with progress_bar(TextColumn('situations'), BarColumn(), MofNCompleteColumn()) as progress:
        task = progress.add_task('', total=arguments.vectors)
        vectors = export.write(arguments.vectors, arguments.seed, lambda: progress.advance(task))
    planned = ', '.join(
        f'{sum(vector.answers[n].status == OK for vector in vectors)} with a plan of {method}'
        for n, method in enumerate(METHODS))
    damaged = sum(vector.answers[0].status == BAD_INPUT for vector in vectors)
    console = result_console(soft_wrap=True)
    console.say(f'written: {arguments.output}: vehicle {vehicle.name}, {len(vectors)} situations: '
                f'{planned}, {damaged} with invalid numbers')
    warning = assumption_warning(vehicle, file)
    if warning:
        console.say(f'warning: {warning}')
    console.say(f'compile and compare: make -C {shlex.quote(arguments.output)} all check')
    return 0
