# SPDX-License-Identifier: Apache-2.0
"""Runs many drawn trips on all cores."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
import multiprocessing
import os
from time import process_time

from bev_preheat.control.settings import Settings
from bev_preheat.robustness.closed_loop import Drive, drive_informed, drive_with_planner
from bev_preheat.robustness.trips import draw_trip
from bev_preheat.simulation.mismatch import Mismatch

# What is compared, by what the planner is set to.
METHODS = {
    # The paper's heuristic, planned again with each battery state from what is measured.
    'replanned_paper': Settings(method='paper', estimation=False, minimum_on_time_s=0.0,
                                minimum_off_time_s=0.0),
    'planner': Settings(),
}
# At long periods, commands and battery states are valid for so many of them.
LEASE_PERIODS = 2.5
TIMEOUT_PERIODS = 5.0


@dataclass(frozen=True)
class TripResult:
    """
    One trip: what the car really is, and the Drives of it.

    `informed` is the drive that knew the truth, `methods` those of METHODS by name, `cpu_s` the
    processor time of it all [s].
    """

    number: int
    mismatch: Mismatch
    informed: Drive
    methods: dict
    cpu_s: float


def settings_of(method, period_s):
    """Return the Settings of one of METHODS for battery states and commands every period [s]."""
    settings = METHODS[method]
    return replace(
        settings, command_period_s=period_s,
        lease_s=max(settings.lease_s, LEASE_PERIODS * period_s),
        battery_state_timeout_s=max(settings.battery_state_timeout_s,
                                    TIMEOUT_PERIODS * period_s))


def run_trip(conditions, seed, number, methods):
    """Return (TripResult, {method: Course}) of one drawn trip."""
    started = process_time()
    trip, goal = draw_trip(conditions, seed, number), conditions.goal
    try:
        informed = drive_informed(trip.car(), goal)
        drives = {method: drive_with_planner(
            trip.car(), goal, settings_of(method, conditions.period_s), conditions.period_s)
            for method in methods}
    except Exception as error:
        error.add_note(f'in trip {number} of seed {seed}')
        raise
    result = TripResult(
        number, trip.mismatch, informed,
        {method: drive for method, (drive, _) in drives.items()}, process_time() - started)
    return result, {method: course for method, (_, course) in drives.items()}


def run_study(conditions, trips, seed, jobs, methods, progress):
    """
    Return the TripResults of trips 0 … `trips` - 1 in order; they do not depend on `jobs`.

    `progress(done)` is called after each trip; `jobs` None means all cores.
    """
    results = []
    # A fork would take the terminal's state and the threads of others along.
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(jobs or os.cpu_count(), mp_context=context, initializer=_prepare,
                             initargs=(conditions, seed, methods)) as pool:
        for result in pool.map(_run_in_worker, range(trips)):
            results.append(result)
            progress(len(results))
    return results


_worker = {}


def _prepare(conditions, seed, methods):
    _worker.update(conditions=conditions, seed=seed, methods=methods)


def _run_in_worker(number):
    return run_trip(_worker['conditions'], _worker['seed'], number, _worker['methods'])[0]
