# SPDX-License-Identifier: Apache-2.0
"""
Identify synthetic cars, and compare the estimates with the truth.

Prints the errors of each parameter and the coverage of its 90 % intervals.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from bev_preheat.commands.parser import Subparsers
from bev_preheat.commands.terminal import print_records
from bev_preheat.identification.identify import identify
from bev_preheat.identification.trips import trips_of
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.identification.synthetic_car import COOLANT_J_PER_K, draw_car, record_car
from bev_preheat_studies.study import add_study, check_study_arguments, Study

# Temperatures [deg C] at which the resistance is compared.
RESISTANCES_C = (-5, 5)
# Share of cars whose error is below the printed one.
SHARE = 0.95


@dataclass(frozen=True)
class Outcome:
    """One parameter of one car: relative error, whether the interval has the truth, and if it was identified."""

    name: str
    error: float
    is_covered: bool
    is_identified: bool
    structure: str
    left_out_rmse_k: float
    duration_s: float


@dataclass(frozen=True)
class CarResult:
    """The Outcomes of the car with the seed `number`."""

    number: int
    outcomes: tuple[Outcome, ...]


def add_parser(subparsers: Subparsers) -> None:
    """Add the study."""
    parser = add_study(subparsers, 'identification', run, __doc__, 'synthetic cars identified from their logs',
                       'cars')
    parser.add_argument('--vehicle', default='small_car', help='vehicle file around which cars are drawn')
    parser.add_argument('--without-heater', action='store_true', help='record no drive with the heater on')
    # That of the first car; the others follow.
    parser.set_defaults(seed=0)


def run(arguments: Namespace) -> int:
    """Run the study; returns 0."""
    check_study_arguments(arguments, [vehicle_file(arguments.vehicle)], 'cars')
    require('casadi', 'scipy')
    heats = not arguments.without_heater

    def show(console: Console, results: list[CarResult]) -> dict[str, Any]:
        cars = [result.outcomes for result in results]
        print_records(console, f'{len(cars)} synthetic cars around {arguments.vehicle}',
                      ('parameter', 'cars', 'median error', '95 % error', 'coverage', 'identified'),
                      [(row.name, f'{row.cars}', f'{100 * row.median:+.1f} %', f'{100 * row.most:.1f} %',
                        f'{100 * row.covered:.0f} %', f'{100 * row.identified:.0f} %') for row in summary(cars)],
                      ('left', *['right'] * 5))
        console.print(f'90 % intervals with the truth, all together: {100 * pooled_coverage(cars):.0f} %')
        return {}

    return Study(partial(car_result, arguments.vehicle, heats, arguments.seed), CarResult, arguments.cars, {
        'study': 'identification', 'vehicle': arguments.vehicle, 'heats': heats, 'seed': arguments.seed},
        what='cars').conduct(arguments, show)


def car_result(vehicle_name: str, heats: bool, seed: int, number: int) -> CarResult:
    """Return the CarResult of a car around that vehicle file; its own seed is `seed` + `number`."""
    generator = np.random.default_rng(seed + number)
    vehicle = load_vehicle(vehicle_name)
    car = draw_car(generator, vehicle)
    # The structures that no vehicle file can hold change no estimate.
    trips = trips_of(record_car(car, generator, heats), vehicle)
    found = identify(vehicle, trips, f'car {seed + number}', structures_tried=('one mass', 'one mass, sensor lag'))
    truth = {
        # Coolant warms with the battery and belongs to it.
        'heat_capacity': car.heat_capacity_j_per_k + COOLANT_J_PER_K, 'leakage': car.leakage_w_per_k,
        'leakage_with_speed': car.leakage_w_per_k_per_mps, 'drivetrain_heat': car.drivetrain_heat,
        'heater_efficiency': car.heater_efficiency, 'heat_lag': car.heat_lag_s, 'sensor_lag': car.sensor_lag_s,
        'capacity': car.capacity_ah}
    rest = found.structure, found.rmse_k, found.duration_s
    outcomes = [Outcome(item.name, item.estimate / truth[item.name] - 1.0,
                        item.low <= truth[item.name] <= item.high, item.is_identified, *rest)
                for item in found.estimates]
    curve = found.resistance
    for at_c in RESISTANCES_C:
        at, true_ohm = int(np.argmin(np.abs(curve.temperature_c - at_c))), car.resistance_at(at_c)
        outcomes.append(Outcome(f'resistance at {at_c} degC', float(curve.estimate_ohm[at]) / true_ohm - 1.0,
                                bool(curve.low_ohm[at] <= true_ohm <= curve.high_ohm[at]), True, *rest))
    return CarResult(number, tuple(outcomes))


@dataclass(frozen=True)
class ParameterFigures:
    """One parameter over all cars: median error, that of SHARE; shares of true intervals, of identified cars."""

    name: str
    cars: int
    median: float
    most: float
    covered: float
    identified: float


def summary(cars: Iterable[Iterable[Outcome]]) -> Iterator[ParameterFigures]:
    """Yield the ParameterFigures of each parameter."""
    by_name: dict[str, list[Outcome]] = {}
    for outcomes in cars:
        for outcome in outcomes:
            by_name.setdefault(outcome.name, []).append(outcome)
    for name, found in by_name.items():
        errors = np.array([outcome.error for outcome in found])
        yield ParameterFigures(
            name, len(found), float(np.median(errors)), float(np.quantile(np.abs(errors), SHARE)),
            *_shares(found))


def pooled_coverage(cars: Iterable[Iterable[Outcome]]) -> float:
    """Return the share of all 90 % intervals that have the truth."""
    return _shares([outcome for outcomes in cars for outcome in outcomes])[0]


def _shares(found: list[Outcome]) -> tuple[float, float]:
    return (float(np.mean([outcome.is_covered for outcome in found])),
            float(np.mean([outcome.is_identified for outcome in found])))
