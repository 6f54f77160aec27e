# SPDX-License-Identifier: Apache-2.0
"""
Cost of the planner: a plan and an update in process, and the planner's process beside an empty node.

Times of plans and updates are processor time on the computer that this runs on.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
import platform
from time import process_time

import numpy as np

from bev_preheat.commands.output import json_output, write_json
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.program import keeping_what_is_finished
from bev_preheat.commands.terminal import print_records, progress_console, result_console
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.files.output_files import check_outputs
from bev_preheat.optional_packages import require
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route, Route, route_file
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file

# The paper's trip, Table I.
STATE, GOAL = BatteryState(-7.0, 0.9), Goal(25.0)
ROUTE, PASS = 'reference', 'alpine_pass'
PLANS = 100
# Bounds: a plan and one over the pass; updates, median and 99 %, and over the pass, median and worst [ms].
PLAN_MS, PASS_PLAN_MS = 0.15, 20.0
UPDATE_MS, PASS_UPDATE_MS = (0.4, 1.0), (5.0, 20.0)
NOISE_K = 0.1


@dataclass(frozen=True)
class Figure:
    """A measured value, and its upper bound."""

    what: str
    value: float
    unit: str
    bound: float | None = None

    @property
    def within(self) -> str:
        """'yes' or 'NO', '' without a bound."""
        return '' if self.bound is None else 'yes' if self.value <= self.bound else 'NO'


def add_parser(subparsers: Subparsers) -> None:
    """Add the benchmark."""
    parser = subparsers.add_parser('cost', help='time and memory of the planner', description=__doc__)
    parser.add_argument('--only', choices=tuple(MEASUREMENTS), help='one group of measurements')
    parser.add_argument('--json', default='out/benchmark.json', metavar='FILE',
                        help='- is standard output (default: %(default)s)')
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run the measurements and report the figures; returns 0."""
    check_outputs([json_output(arguments.json, make_folder=True)],
                  [vehicle_file('reference'), *map(route_file, (ROUTE, PASS))])
    wanted = [name for name in MEASUREMENTS if arguments.only in (None, name)]
    if 'process' in wanted:
        require('psutil')
    progress, figures, finished = progress_console(), [], 0
    with keeping_what_is_finished() as ending:
        for name in wanted:
            with progress.status(f'measuring {name} …'):
                figures += MEASUREMENTS[name](progress.log)
            finished += 1
    if figures:
        write_json(arguments.json, {
            'machine': {'processor': platform.machine(), 'python': platform.python_version()},
            'complete': ending.is_complete, 'figures': [asdict(figure) for figure in figures]}, make_folder=True)
        console = result_console(arguments.json)
        print_records(console, 'Benchmark', ('what', 'figure', 'unit', 'at most', 'within'), [
            (figure.what, f'{figure.value:.4g}', figure.unit, '' if figure.bound is None else f'{figure.bound:g}',
             figure.within) for figure in figures], ('left', *['right'] * 4))
    ending.tell(finished, len(wanted), 'groups of measurements', (arguments.json,))
    return 0


def measure_plans(log: Callable[[str], object]) -> list[Figure]:
    """Return the median times of a plan without an active limit, and over the pass."""
    vehicle, figures = load_vehicle('reference'), []
    for name, bound_ms in ((ROUTE, PLAN_MS), (PASS, PASS_PLAN_MS)):
        route = load_route(name, vehicle.defaults)
        times_s = []
        # A copy of the route, as after the car has moved on: nothing of it is cached.
        for copy in [replace(route) for _ in range(PLANS)]:
            started = process_time()
            plan_preheating(vehicle, copy, STATE, GOAL)
            times_s.append(process_time() - started)
        figures.append(Figure(f'plan on {name}, {len(route)} segments, median', 1e3 * float(np.median(times_s)),
                              'ms', bound_ms))
        log(f'{name}: {PLANS} plans')
    return figures


def measure_updates(log: Callable[[str], object]) -> list[Figure]:
    """Return the times of updates along a whole drive, one a second; over the pass with a reserve that binds."""
    vehicle = load_vehicle('reference')
    usual, over_pass = (load_route(name, vehicle.defaults) for name in (ROUTE, PASS))
    heated, unheated = (plan(vehicle, over_pass, STATE, GOAL) for plan in (plan_preheating, plan_unheated))
    # Allows half of the wanted warming.
    reserve = 0.5 * float(heated.soc[-1] + unheated.soc[-1]) - Settings.arrival_soc_margin
    figures = []
    for name, route, goal, figure_of, bounds_ms in (
            (ROUTE, usual, GOAL, {'median': 50.0, '99 %': 99.0}, UPDATE_MS),
            (PASS, over_pass, replace(GOAL, minimum_arrival_soc=reserve), {'median': 50.0, 'worst': 100.0},
             PASS_UPDATE_MS)):
        times_ms = _updates_ms(vehicle, route, goal)
        figures += [Figure(f'update on {name}, {which}', float(np.percentile(times_ms, percent)), 'ms', bound_ms)
                    for (which, percent), bound_ms in zip(figure_of.items(), bounds_ms)]
        log(f'{name}: {len(times_ms)} updates')
    return figures


def _updates_ms(vehicle: Vehicle, route: Route, goal: Goal) -> list[float]:
    car = ImperfectCar(vehicle, DrivePhase(route, goal), STATE,
                       Imperfections(sensors=Sensors(temperature_noise_k=NOISE_K)))
    return [1e3 * moment.cpu_s for moment in moments(car, Supervisor(vehicle, Settings()), lambda: car.is_over)
            if moment.reading is not None]


def measure_process(log: Callable[[str], object]) -> list[Figure]:
    """Return latency, memory, start and restart of the planner's process."""
    # Needs ROS 2.
    from bev_preheat_studies.cost.process import measure
    return [Figure(*figure) for figure in measure(log)]


MEASUREMENTS = {'plan': measure_plans, 'update': measure_updates, 'process': measure_process}
