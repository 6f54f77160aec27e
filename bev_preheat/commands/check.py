# SPDX-License-Identifier: Apache-2.0
"""`preheat check`: how well a vehicle file predicts recorded drives."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING

from bev_preheat.commands.output import add_output_arguments, check_output_arguments, write_results
from bev_preheat.commands.situation import add_log_arguments, add_vehicle_argument, read_trips
from bev_preheat.commands.terminal import print_records, progress_bar, ResultConsole
from bev_preheat.drawing.identification_figures import check_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.identification.trips import common_remarks
from bev_preheat.vehicle import load_vehicle, vehicle_file

if TYPE_CHECKING:
    from bev_preheat.commands.parser import Subparsers
    from bev_preheat.identification.check import Check

BEYOND_BOUND = 1
LEAST_BOUND_K, MOST_BOUND_K = 0.0, 100.0


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'check', help='how well a vehicle file predicts recorded drives',
        description='Predict recorded drives, charging sessions and nights from their first reading and measured '
        'powers. Drives are also replayed to the planner, with its estimation and without. Exit status 1 if an '
        'arrival error exceeds --bound; 2 if an input is refused.')
    add_log_arguments(parser)
    add_vehicle_argument(parser)
    parser.add_argument('--bound', type=float, metavar='K',
                        help='largest allowed arrival error [K] (default: no bound)')
    parser.add_argument('--no-replay', action='store_true',
                        help='leave out the replays to the planner, which take about 0.3 ms per second of log')
    add_output_arguments(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Check, print, and write the requested files; returns the exit status."""
    bound_k = arguments.bound
    if bound_k is not None and not LEAST_BOUND_K <= bound_k <= MOST_BOUND_K:
        raise InvalidInput(f'--bound: {bound_k:g} K; it must be {LEAST_BOUND_K:g} ... {MOST_BOUND_K:g} K')
    check_output_arguments(arguments, [vehicle_file(arguments.vehicle), *arguments.logs])
    vehicle = load_vehicle(arguments.vehicle)
    trips = read_trips(arguments, vehicle)
    from bev_preheat.identification.check import check_trips
    with progress_bar() as bar:
        task = bar.add_task('', total=len(trips))

        def tell(name: str) -> None:
            bar.update(task, description=f'checking {name}')
            bar.advance(task)

        check = check_trips(vehicle, trips, not arguments.no_replay, tell)

    console = write_results(arguments, check.as_dictionary, lambda: check_figure(check))
    print_check(console, check)
    if bound_k is not None and check.worst_k > bound_k:
        console.say(f'worst arrival error {check.worst_k:.2f} K exceeds the bound of {bound_k:g} K')
        return BEYOND_BOUND
    return 0


def print_check(console: ResultConsole, check: Check) -> None:
    """Print a Check as tables."""
    print_records(
        console, f'Vehicle {check.vehicle.name}: predicted minus measured on arrival',
        ('trip', 'kind', 'min', 'start degC', 'arrival degC', 'error K', 'charge %', 'energy Wh'),
        [(trip.trip.name, trip.trip.kind, f'{len(trip.trip) / 60.0:.0f}', f'{trip.trip.start_c:.1f}',
          f'{trip.trip.arrival_c:.1f}', f'{trip.arrival_error_k:+.2f}', f'{100.0 * trip.arrival_soc_error:+.2f}',
          f'{trip.arrival_energy_error_wh:+.0f}') for trip in check.trips], ('left', 'left', *['right'] * 6))
    console.say(f'arrival temperature: RMSE {check.rmse_k:.2f} K, worst {check.worst_k:.2f} K; a battery that '
                f'keeps its temperature: RMSE {check.constant_rmse_k:.2f} K')
    for name, (measured, predicted) in check.heated_minutes.items():
        console.say(f'{name}: heated for {measured:.1f} min, predicted {predicted:.1f} min '
                    f'({100.0 * (predicted / measured - 1.0):+.1f} %)')
    if check.leads:
        print_records(
            console, 'Running planner, by time before arrival', (
                'lead s', 'file alone: RMSE K', 'worst K', 'with estimation: RMSE K', 'worst K'),
            [(f'{lead_s}', *(f'{figure:.2f}' for figure in figures)) for lead_s, figures in check.leads.items()],
            ['right'] * 5)
        console.say('the estimation is no worse than the file alone' if check.estimation_is_no_worse else
                    'warning: the estimation is worse than the file alone')
    console.say(*common_remarks(trip.trip for trip in check.trips))
