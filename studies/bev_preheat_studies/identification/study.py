# SPDX-License-Identifier: Apache-2.0
"""Identify synthetic cars, and compare estimates and intervals with the truth: errors and coverage."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from bev_preheat.identification.identify import identify
from bev_preheat.identification.parameters import IN_THE_FILE
from bev_preheat.identification.trips import trips_of
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.identification.bound import relative_bounds
from bev_preheat_studies.identification.synthetic_car import COOLANT_J_PER_K, draw_car, record_car

# Temperatures [deg C] at which the resistance is compared.
RESISTANCES_C = (-5, 5)
# Share of cars whose error is below the printed one.
SHARE = 0.95
# The same share of a normal distribution is within this many standard deviations.
SHARE_DEVIATIONS = 1.96


@dataclass(frozen=True)
class Outcome:
    """
    One parameter of one car.

    Relative error, its least standard deviation (`bound`; None: not computed), whether the interval has the
    truth, whether the parameter was identified.
    """

    name: str
    error: float
    bound: float | None
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


def result_from(record: dict[str, Any]) -> CarResult:
    """Return the CarResult of a record, the inverse of `asdict`."""
    return CarResult(record['number'], tuple(Outcome(**outcome) for outcome in record['outcomes']))


def study_car(vehicle_name: str, seed: int, heats: bool = True) -> list[Outcome]:
    """Return the Outcomes of the synthetic car with a seed, identified from the vehicle file of that name."""
    generator = np.random.default_rng(seed)
    vehicle = load_vehicle(vehicle_name)
    car = draw_car(generator, vehicle)
    # The structures that no vehicle file can hold change no estimate.
    trips = trips_of(record_car(car, generator, heats), vehicle)
    found = identify(vehicle, trips, f'car {seed}', structures_tried=IN_THE_FILE)
    bounds = relative_bounds(car, vehicle, trips)
    truth = {
        # Coolant warms with the battery and belongs to it.
        'heat_capacity': car.heat_capacity_j_per_k + COOLANT_J_PER_K, 'leakage': car.leakage_w_per_k,
        'leakage_with_speed': car.leakage_w_per_k_per_mps, 'drivetrain_heat': car.drivetrain_heat,
        'heater_efficiency': car.heater_efficiency, 'heat_lag': car.heat_lag_s, 'sensor_lag': car.sensor_lag_s,
        'capacity': car.capacity_ah}
    rest = found.structure, found.rmse_k, found.duration_s
    outcomes = [Outcome(item.name, item.estimate / truth[item.name] - 1.0, bounds.get(item.name),
                        item.low <= truth[item.name] <= item.high, item.is_identified, *rest)
                for item in found.estimates]
    curve = found.resistance
    for at_c in RESISTANCES_C:
        at, true_ohm = int(np.argmin(np.abs(curve.temperature_c - at_c))), car.resistance_at(at_c)
        outcomes.append(Outcome(f'resistance at {at_c} degC', float(curve.estimate_ohm[at]) / true_ohm - 1.0,
                                None, bool(curve.low_ohm[at] <= true_ohm <= curve.high_ohm[at]), True, *rest))
    return outcomes


@dataclass(frozen=True)
class ParameterFigures:
    """
    One parameter over all cars; errors are relative.

    Median error, error of SHARE of the cars, median of that error by the `bound` (None: not computed), the share
    of the 90 % intervals that have the truth, the share of the cars for which it was identified.
    """

    name: str
    cars: int
    median: float
    most: float
    bound: float | None
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
        bounds = [outcome.bound for outcome in found if outcome.bound is not None]
        yield ParameterFigures(
            name, len(found), float(np.median(errors)), float(np.quantile(np.abs(errors), SHARE)),
            SHARE_DEVIATIONS * float(np.median(bounds)) if bounds else None, *_shares(found))


def pooled_coverage(cars: Iterable[Iterable[Outcome]]) -> float:
    """Return the share of all 90 % intervals that have the truth."""
    return _shares([outcome for outcomes in cars for outcome in outcomes])[0]


def _shares(found: list[Outcome]) -> tuple[float, float]:
    return (float(np.mean([outcome.is_covered for outcome in found])),
            float(np.mean([outcome.is_identified for outcome in found])))
