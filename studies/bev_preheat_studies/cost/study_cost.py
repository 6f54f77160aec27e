# SPDX-License-Identifier: Apache-2.0
"""Time of studies on two workers: drives in closed loop, and the efficiency for a fleet."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING

from bev_preheat.native.library import core
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.core_time import timed_core
from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.cost.planning_cost import GOAL, STATE
from bev_preheat_studies.fleet.fleet_study import run_fleet
from bev_preheat_studies.robustness.car_study import COMPARED, result_of, run_study
from bev_preheat_studies.robustness.drawn_cars import Conditions
from bev_preheat_studies.workers import Workers

if TYPE_CHECKING:
    from collections.abc import Callable

WORKERS = 2
# Drawn cars: the study's usual number, and the number driven here.
USUAL_CARS, CARS, MOST_S = 300, 60, 300.0
# Trips of a fleet, by one worker and by two alternately.
FLEET, TURNS, LEAST_EFFICIENCY = 100_000, 2, 0.9


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress. Empty without the core."""
    if core() is None:
        return []
    return [*_closed_loop(log), _efficiency(log)]


def _closed_loop(log: Callable[[str], object]) -> list[Figure]:
    vehicle = load_vehicle('reference')
    conditions = Conditions(vehicle, (load_route('reference', vehicle.defaults),), STATE, GOAL)
    started = perf_counter()
    with Workers(WORKERS) as workers:
        run_study(conditions, CARS, 1, workers, tuple(COMPARED), lambda result: log(
            f'closed loop, car {result.number}: {result.cpu_s:.2f} s of processor time'))
    taken_s = perf_counter() - started
    durations_s: list[float] = []
    with timed_core(durations_s):
        result_of(conditions, 1, tuple(COMPARED), 0)
    return [
        Figure(f'robustness, {USUAL_CARS} cars, {WORKERS} workers (from {CARS} cars, start of the workers '
               'included)', USUAL_CARS / CARS * taken_s, 's', MOST_S),
        # The time that would remain if Python took none.
        Figure('of this, in calls of the core (from one car)', USUAL_CARS / WORKERS * sum(durations_s), 's')]


def _efficiency(log: Callable[[str], object]) -> Figure:
    """Return the parallel efficiency of WORKERS workers over one, each with its start-up."""
    taken_s = {1: 0.0, WORKERS: 0.0}
    for _ in range(TURNS):
        for jobs in taken_s:
            started = perf_counter()
            with Workers(jobs) as workers:
                run_fleet(FLEET, 1, workers, lambda block: None)
            taken_s[jobs] += perf_counter() - started
            log(f'fleet, {jobs} workers: {perf_counter() - started:.1f} s')
    return Figure(f'fleet, {FLEET} trips: efficiency of {WORKERS} workers',
                  taken_s[1] / (WORKERS * taken_s[WORKERS]), '', LEAST_EFFICIENCY, '>=')
