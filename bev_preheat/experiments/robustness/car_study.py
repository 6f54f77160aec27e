# SPDX-License-Identifier: Apache-2.0
"""Runs many drawn trips on all cores."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import process_time
from typing import Any, TYPE_CHECKING

from bev_preheat.experiments.robustness.drawn_cars import draw_car
from bev_preheat.experiments.robustness.drives import drive_informed, drive_with_planner, DriveOutcome
from bev_preheat.experiments.workers import Workers
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.supervision.settings import Settings
from bev_preheat.vehicle.heat_path import HeatPath

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bev_preheat.experiments.robustness.drawn_cars import Conditions
    from bev_preheat.experiments.robustness.drives import DriveTrace

# What is compared, by what the planner is set to.
COMPARED = {
    # The paper's heuristic, planned again with each battery state from what is measured.
    'replanned_paper': Settings(method='paper', estimation=False, minimum_on_time_s=0.0,
                                minimum_off_time_s=0.0),
    'planner': Settings(),
}
# At long periods, commands and battery states are valid for so many of them.
LEASE_PERIODS = 2.5
TIMEOUT_PERIODS = 5.0


@dataclass(frozen=True)
class CarResult:
    """
    One trip: what the car really is, and the DriveOutcomes of it.

    `informed` is the drive that knew the truth, `methods` those of COMPARED by name, `cpu_s` the
    processor time of it all [s]. The trip takes `pace` times as long as its route says.
    """

    number: int
    mismatch: Mismatch
    heat_path: HeatPath
    informed: DriveOutcome
    methods: dict[str, DriveOutcome]
    cpu_s: float
    pace: float = 1.0


def settings_of_compared(method: str, period_s: float) -> Settings:
    """Return the Settings of one of COMPARED for battery states and commands every period [s]."""
    settings = COMPARED[method]
    return replace(
        settings, command_period_s=period_s,
        lease_s=max(settings.lease_s, LEASE_PERIODS * period_s),
        battery_state_timeout_s=max(settings.battery_state_timeout_s,
                                    TIMEOUT_PERIODS * period_s))


def drive_car(conditions: Conditions, seed: int, number: int,
              methods: Iterable[str]) -> tuple[CarResult, dict[str, DriveTrace]]:
    """Return (CarResult, {method: DriveTrace}) of one drawn trip."""
    started = process_time()
    trip, goal = draw_car(conditions, seed, number), conditions.goal
    try:
        informed = drive_informed(trip.car(), goal)
        drives = {method: drive_with_planner(
            trip.car(), goal, settings_of_compared(method, conditions.period_s))
            for method in methods}
    except Exception as error:
        error.add_note(f'in trip {number} of seed {seed}')
        raise
    result = CarResult(
        number, trip.mismatch, trip.heat_path, informed,
        {method: drive for method, (drive, _) in drives.items()}, process_time() - started,
        trip.pace)
    return result, {method: course for method, (_, course) in drives.items()}


def run_study(conditions: Conditions, trips: int, seed: int, jobs: int | None,
              methods: Sequence[str], report: Callable[[CarResult], object]) -> list[CarResult]:
    """
    Return the CarResults of trips 0 … `trips` - 1 in order; they do not depend on `jobs`.

    `report(result)` is called with each as soon as it and all before it are done, so that an
    interrupted study leaves what is finished. `jobs` None means all cores. Raises WorkerLost where
    a process dies.
    """
    results = []
    with Workers(jobs, _prepare, (conditions, seed, methods)) as workers:
        for future in [workers.submit(_run_in_worker, number) for number in range(trips)]:
            results.append(workers.result(future))
            report(results[-1])
    return results


_worker: dict[str, Any] = {}


def _prepare(conditions: Conditions, seed: int, methods: Sequence[str]) -> None:
    _worker.update(conditions=conditions, seed=seed, methods=methods)


def _run_in_worker(number: int) -> CarResult:
    return drive_car(_worker['conditions'], _worker['seed'], number, _worker['methods'])[0]
