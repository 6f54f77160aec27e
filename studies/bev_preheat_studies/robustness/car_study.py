# SPDX-License-Identifier: Apache-2.0
"""Run many drawn trips on any executor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Any, TYPE_CHECKING

from bev_preheat.control.settings import Settings
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.numbered import run_numbered
from bev_preheat_studies.robustness.drawn_cars import draw_car
from bev_preheat_studies.robustness.drives import (
    drive_informed,
    drive_noting,
    drive_with_planner,
    DriveOutcome,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from concurrent.futures import Executor

    from bev_preheat.simulation.imperfect_car import ImperfectCar
    from bev_preheat_studies.robustness.drawn_cars import Conditions
    from bev_preheat_studies.robustness.drives import DriveTrace

# The compared planners, by the method they are set to.
COMPARED = {
    # The paper's heuristic, re-planned from the measured state on each battery state.
    'replanned_paper': Settings(method='paper', estimation=False, minimum_on_time_s=0.0,
                                minimum_off_time_s=0.0),
    'planner': Settings(),
}
# With long periods, commands and battery states are valid for this number of periods.
LEASE_PERIODS = 2.5
TIMEOUT_PERIODS = 5.0


@dataclass(frozen=True)
class CarResult:
    """
    One trip: the true car, and its DriveOutcomes.

    `informed` is the drive planned with the true car, `methods` holds the COMPARED drives by name, `cpu_s` is
    the processor time of all drives [s]. `pace` is the trip's duration as a multiple of the route's.
    """

    number: int
    mismatch: Mismatch
    heat_path: HeatPath
    informed: DriveOutcome
    methods: dict[str, DriveOutcome]
    cpu_s: float
    pace: float = 1.0


def settings_of_compared(method: str, period_s: float) -> Settings:
    """Return the Settings of a name in COMPARED or of a planning method, for a period [s]."""
    settings = COMPARED[method] if method in COMPARED else Settings(method=method)
    return replace(
        settings, command_period_s=period_s,
        lease_s=max(settings.lease_s, LEASE_PERIODS * period_s),
        battery_state_timeout_s=max(settings.battery_state_timeout_s,
                                    TIMEOUT_PERIODS * period_s))


def drive_car(conditions: Conditions, seed: int, number: int,
              methods: Iterable[str]) -> tuple[CarResult, dict[str, DriveTrace]]:
    """Return (CarResult, {method: DriveTrace}) of one drawn trip."""
    courses = {}

    def drive(method: str, car: ImperfectCar, settings: Settings) -> DriveOutcome:
        outcome, courses[method] = drive_with_planner(car, conditions.goal, settings)
        return outcome

    return _driven(conditions, seed, number, methods, drive), courses


def result_of(conditions: Conditions, seed: int, methods: Sequence[str], number: int) -> CarResult:
    """Return the CarResult of one drawn trip."""
    return _driven(conditions, seed, number, methods, lambda _, car, settings: drive_noting(
        car, conditions.goal, settings, None))


def _driven(conditions: Conditions, seed: int, number: int, methods: Iterable[str],
            drive: Callable[[str, ImperfectCar, Settings], DriveOutcome]) -> CarResult:
    """Return the CarResult of a drawn trip; `drive(method, car, settings)` drives its car by a method."""
    started = process_time()
    trip = draw_car(conditions, seed, number)
    try:
        informed = drive_informed(trip.car(), conditions.goal)
        drives = {method: drive(method, trip.car(), settings_of_compared(method, conditions.period_s))
                  for method in methods}
    except Exception as error:
        error.add_note(f'in trip {number} of seed {seed}')
        raise
    return CarResult(number, trip.mismatch, trip.heat_path, informed, drives, process_time() - started,
                     trip.pace)


def run_study(conditions: Conditions, trips: int, seed: int, executor: Executor,
              methods: Sequence[str], report: Callable[[CarResult], object],
              finished: Mapping[int, CarResult] | None = None,
              keep: Callable[[int, CarResult], object] | None = None) -> list[CarResult]:
    """
    Return the CarResults of trips 0 … `trips` - 1 in order; they do not depend on the executor.

    `report(result)` is called with each result once it and all earlier ones are finished, so that an
    interrupted study keeps its results. `finished` and `keep` are passed to `run_numbered`. Raises WorkerLost
    if a process dies.
    """
    results = []
    for result in run_numbered(executor, partial(result_of, conditions, seed, tuple(methods)),
                               range(trips), finished, keep):
        results.append(result)
        report(result)
    return results


def result_from(record: dict[str, Any]) -> CarResult:
    """Return the CarResult of a dictionary made by `asdict`, read back from JSON."""
    return CarResult(**{
        **record, 'mismatch': Mismatch(**record['mismatch']),
        'heat_path': HeatPath(**record['heat_path']), 'informed': _drive_from(record['informed']),
        'methods': {method: _drive_from(drive) for method, drive in record['methods'].items()}})


def _drive_from(record: dict[str, Any]) -> DriveOutcome:
    return DriveOutcome(**{**record, 'verdicts': tuple(record['verdicts'])})
