# SPDX-License-Identifier: Apache-2.0
"""
The best target within a range of arrival temperatures against a scan of starts of heating.

Each route is driven at full heater power from each start until arrival, and scored by charging time and heating
energy: the points of time times t_0/t, plus the points of energy times E_0/E, where t_0 and E_0 belong to the
latest start that reaches the range. The planner's target is weighted by the slope of that score. One simulation in
short steps judges both. A folder gives car and routes of another task; further routes are drawn.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from bev_preheat.charging.stop import CHARGER_RANGE_W, stop_after, USUAL_DEPARTURE_SOC
from bev_preheat.charging.target_range import (
    AfterArrival,
    by_session,
    by_table,
    read_charging_times,
    targets_in_range,
)
from bev_preheat.charging.target_worth import Prices
from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_figures
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FloatArray, JOULES_PER_WH, S_PER_H, WH_PER_KWH
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.route.for_vehicle import route_for
from bev_preheat.route.segments import make_route, Route
from bev_preheat.tunables import LONGEST_ROW_S
from bev_preheat.vehicle import load_vehicle, Vehicle
from bev_preheat_studies.study import add_study, check_study_arguments, distribution, MOST_SITUATIONS, Study

CAR, TIMES = 'car.yaml', 'charging_times.csv'
USUAL_CAR = 'crossover_800v'
# Steps of the simulation that judges, and between starts of the scan, coarse and around its best start [s].
STEP_S, COARSE_S, FINE_S = 5.0, 5.0, 0.5
# Arrivals this much colder than the range count as within it, for both [K].
BELOW_K = 1e-4
# Scores that differ by less are equal.
SAME_POINTS = 0.002
# Ranges of drawn routes: segments, lengths [km], speeds [km/h], air [degC], battery above the air [K], charge.
SEGMENTS, KM, KMH = (4, 9), (2.0, 12.0), (20.0, 110.0)
AIR_C, WARMER_K, SOC = (-15.0, 5.0), (0.0, 12.0), (0.6, 0.95)
# Power of the drivetrain [kW] at rest and for each km/h, and its spread; assumed: a car of middle size in winter.
POWER_KW, KW_PER_KMH, SPREAD = 9.0, 0.26, 0.1
PERCENTILES = {'least': 0.0, 'median': 50.0, 'most': 100.0}


class Task(NamedTuple):
    """A task: range [deg C], reserve and departure (0 ... 1), points of time and energy; folder of its files."""

    folder: Path | None
    range_c: tuple[float, float]
    reserve: float
    departure_soc: float
    points: tuple[float, float]
    state: BatteryState
    seed: int

    @property
    def routes(self) -> list[Path]:
        """The folder's route files."""
        return [] if self.folder is None else sorted(
            path for path in self.folder.glob('*.csv') if path.name != TIMES)


class Judged(NamedTuple):
    """A drive in short steps: its arrival, heating energy [Wh] and charging time [s]; infinite if not allowed."""

    arrival: BatteryState
    heater_wh: float
    time_s: float


@dataclass(frozen=True)
class RangeResult:
    """One route: scores of scan and target in points, and both temperatures on arrival [deg C]; or why not."""

    number: int
    route: str
    left_out: str = ''
    scan_points: float = math.nan
    points: float = math.nan
    scan_c: float = math.nan
    arrival_c: float = math.nan


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    parser = add_study(subparsers, 'arrival_range', run, __doc__,
                       'the best target within a range against a scan of starts')
    parser.add_argument('--folder', metavar='FOLDER',
                        help=f'car ({CAR}), routes (*.csv) and, if given, charging times ({TIMES}) of a task')
    parser.add_argument('--temperature', type=float, default=0.0, metavar='degC', help='of its routes: battery')
    parser.add_argument('--soc', type=float, default=0.65, metavar='0..1', help='of its routes: state of charge')
    parser.add_argument('--target-range', nargs=2, type=float, default=[20.0, 25.0], metavar='degC')
    parser.add_argument('--min-soc', type=float, default=0.1, metavar='0..1', help='charge on arrival')
    parser.add_argument('--departure-soc', type=float, default=USUAL_DEPARTURE_SOC, metavar='0..1')
    parser.add_argument('--points', nargs=2, type=float, default=[30.0, 20.0], metavar='POINTS',
                        help='for charging time and heating energy')


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments, trips=(0, MOST_SITUATIONS))
    folder = None if arguments.folder is None else Path(arguments.folder)
    task = Task(folder, tuple(arguments.target_range), arguments.min_soc, arguments.departure_soc,
                tuple(arguments.points), BatteryState(arguments.temperature, arguments.soc), arguments.seed)
    identity = {'study': 'arrival_range', **task._asdict(), 'folder': arguments.folder, 'state': vars(task.state)}
    return Study(partial(solve, task), RangeResult, len(task.routes) + arguments.trips, identity,
                 lambda result: not result.left_out).conduct(arguments, _show)


def solve(task: Task, number: int) -> RangeResult:
    """Return the RangeResult of a file of the folder, or of a drawn route."""
    vehicle = load_vehicle(USUAL_CAR if task.folder is None else str(task.folder / CAR))
    files = task.routes
    if number < len(files):
        name, state = files[number].name, task.state
        route = route_for(files[number], vehicle).route
    else:
        name = f'drawn {number - len(files)}'
        route, state = draw_route(np.random.default_rng([task.seed, number - len(files)]), vehicle)
    try:
        return _solved(task, RangeResult(number, name), vehicle, route, state)
    except InvalidInput as error:
        return RangeResult(number, name, str(error))


def _solved(task: Task, result: RangeResult, vehicle: Vehicle, route: Route, state: BatteryState) -> RangeResult:
    route = route.divided(LONGEST_ROW_S)
    stop = stop_after(route, CHARGER_RANGE_W[1], task.departure_soc)
    times = None if task.folder is None else task.folder / TIMES
    # The score is no cost, so the car's own heating at the charger is weighed at the usual prices.
    after = (by_table(vehicle, read_charging_times(times), task.departure_soc)
             if times is not None and times.exists() else by_session(vehicle, stop, Prices(0.6, 10.0)))
    trip = make_trip(vehicle, route.divided(STEP_S))
    judge = partial(_judge, task, trip, state, after)
    scanned = scan_starts(trip, judge)
    first = next((drive for drive in reversed(scanned) if math.isfinite(drive.time_s)), None)
    if first is None or first.heater_wh <= 0.0:
        return replace(result, left_out='no start arrives within the range' if first is None else 'arrives warm')

    def points(drive: Judged) -> float:
        if math.isinf(drive.time_s):
            return 0.0
        return (task.points[0] * first.time_s / drive.time_s + task.points[1] * first.heater_wh / drive.heater_wh)

    best = max(scanned, key=points)
    # Around the best of the coarse starts.
    start_s = route.total_duration_s - COARSE_S * (len(scanned) - 1 - scanned.index(best))
    best = max([best, *(judge(maximum_between(trip, at_s, trip.time_s[-1])) for at_s in np.arange(
        max(start_s - COARSE_S, 0.0), min(start_s + COARSE_S, trip.time_s[-1]), FINE_S))], key=points)
    prices = Prices(task.points[1] / first.heater_wh * WH_PER_KWH, task.points[0] / first.time_s * S_PER_H)
    goal = Goal(task.range_c[0], task.reserve, heats_until_arrival=True)
    found = targets_in_range(vehicle, route, state, goal, task.range_c, after, prices)[0]
    plan = plan_preheating(vehicle, route, state, replace(goal, target_temperature_c=found.target_c))
    # Without regeneration the heater is at full power in all intervals.
    drive = judge(sum((maximum_between(trip, part.start_s, part.end_s) for part in plan.intervals), np.zeros(
        len(trip.route))))
    return replace(result, scan_points=points(best), points=points(drive), scan_c=best.arrival.temperature_c,
                   arrival_c=drive.arrival.temperature_c)


def scan_starts(trip: Trip, judge: Callable[[FloatArray], Judged]) -> list[Judged]:
    """Return the drives heated from each start until arrival, the latest start last."""
    end_s = float(trip.time_s[-1])
    starts_s = np.arange(end_s, -COARSE_S, -COARSE_S)[::-1]
    return [judge(maximum_between(trip, max(start_s, 0.0), end_s)) for start_s in starts_s.tolist()]


def _judge(task: Task, trip: Trip, state: BatteryState, after: Callable[[BatteryState], AfterArrival],
           heater_w: FloatArray) -> Judged:
    schedule = drive_as_planned(trip, state, heater_w)
    arrival = BatteryState(float(schedule.temperature_c[-1]), max(float(schedule.soc[-1]), 0.0))
    low_c, high_c = task.range_c
    heater_wh = float(trip.route.duration_s @ schedule.heater_power_w) / JOULES_PER_WH
    is_allowed = low_c - BELOW_K <= arrival.temperature_c <= high_c + BELOW_K and arrival.soc >= task.reserve
    return Judged(arrival, heater_wh, after(arrival).time_s if is_allowed else math.inf)


def draw_route(random: np.random.Generator, vehicle: Vehicle) -> tuple[Route, BatteryState]:
    """Return a drawn route of few long segments, and the BatteryState at its start."""
    count = int(random.integers(*SEGMENTS))
    kmh, air_c = random.uniform(*KMH, count), random.uniform(*AIR_C)
    power_kw = (POWER_KW + KW_PER_KMH * kmh) * random.uniform(1.0 - SPREAD, 1.0 + SPREAD, count)
    route = make_route({
        'duration_s': random.uniform(*KM, count) / kmh * S_PER_H, 'speed_mps': kmh / 3.6,
        'propulsion_power_w': 1e3 * power_kw, 'ambient_temperature_c': air_c + random.uniform(-1.0, 1.0, count)},
        vehicle.defaults)
    return route, BatteryState(air_c + random.uniform(*WARMER_K), random.uniform(*SOC))


def summarise(results: Sequence[RangeResult]) -> dict[str, Any]:
    """Return counts, and the points of the target above the scan."""
    solved = [result for result in results if not result.left_out]
    above = [result.points - result.scan_points for result in solved]
    return {'routes': len(results), 'solved': len(solved),
            'not_worse': sum(value >= -SAME_POINTS for value in above), 'above_scan': distribution(
                above, **PERCENTILES)}


def _show(console: Console, results: list[RangeResult]) -> dict[str, Any]:
    summary = summarise(results)
    console.print(f'{summary["routes"]} routes, {summary["solved"]} arrive within the range by heating; on '
                  f'{summary["not_worse"]} the target scores no less than the scan', soft_wrap=True)
    if summary['solved']:
        print_figures(console, 'Points above the scan', ('', *PERCENTILES), [
            ('target within the range', *(f'{summary["above_scan"][key]:+.4f}' for key in PERCENTILES))])
    for result in results:
        if not result.left_out and (not result.route.startswith('drawn')
                                    or result.points < result.scan_points - SAME_POINTS):
            console.print(f'{result.route}: {result.points:.4f} points at {result.arrival_c:.2f} degC, scan '
                          f'{result.scan_points:.4f} at {result.scan_c:.2f} degC', soft_wrap=True)
    return {'summary': summary}
