# SPDX-License-Identifier: Apache-2.0
"""Cost of a check in the solver's process: the first and later checks, with a new or a cached program."""

from __future__ import annotations

from statistics import median
from time import monotonic, sleep
from typing import TYPE_CHECKING

from bev_preheat.nonlinear_program.protocol import Question, SolverAnswer
from bev_preheat.nonlinear_program.solver_process import SolverProcess
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.cost.planning_cost import GOAL, STATE

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.nonlinear_program.protocol import Failure
    from bev_preheat.route import Route
    from bev_preheat.vehicle import Vehicle

ROUNDS = 5
PATIENCE_S = 300.0
POLL_S = 0.002
# Driving time between two checks [s]: the checker's own period.
DRIVEN_S = 60.0
# Example values of an estimate; they change from check to check.
FACTORS = (1.03, 0.96, 1.04, 0.99, 1.02)


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    rounds = []
    for number in range(ROUNDS):
        rounds.append(_one_round(vehicle, route))
        cold_s, prepared_s, new_s, kept_s, idle_mb, used_mb = rounds[-1]
        log(f'round {number + 1}: first check {cold_s:.2f} s, prepared {prepared_s:.2f} s; later '
            f'{new_s:.2f} s with a new number of steps, {kept_s:.2f} s with the same; '
            f'solver {idle_mb:.0f} MB before the first check, {used_mb:.0f} MB after {ROUNDS}')
    cold_s, prepared_s, new_s, kept_s, idle_mb, used_mb = map(median, zip(*rounds))
    return [
        Figure('check, solver not started before, median', cold_s, 's'),
        Figure('check, first of a prepared solver, median', prepared_s, 's'),
        Figure('check, later, new number of steps, median', new_s, 's'),
        Figure('check, later, same number of steps, median', kept_s, 's'),
        Figure('first check / later: solver not started before',
               median(row[0] / row[2] for row in rounds), ''),
        Figure('first check / later: prepared',
               median(row[1] / row[2] for row in rounds), '', 1.5),
        Figure('check, number of steps new / same', median(row[2] / row[3] for row in rounds), ''),
        Figure('resident memory: prepared solver', idle_mb, 'MB'),
        Figure(f'resident memory: solver after {ROUNDS} checks', used_mb, 'MB')]


def _one_round(vehicle: Vehicle, route: Route) -> tuple[float, float, float, float, float, float]:
    """Return durations of checks [s] (cold, prepared, new steps, same steps) and memory [MB]."""
    cold = SolverProcess(vehicle)
    prepared = SolverProcess(vehicle)
    try:
        cold_s = _check_s(cold, route)
        cold.close()
        prepared.prepare(route)
        while prepared.is_preparing:
            _poll(prepared)
        idle_mb = _memory_mb(prepared)
        prepared_s = _check_s(prepared, route)
        new_s, kept_s = [], []
        for number in range(1, ROUNDS + 1):
            ahead = route.after(number * DRIVEN_S)
            new_s.append(_check_s(prepared, ahead))
            kept_s.append(_check_s(prepared, ahead))
        return cold_s, prepared_s, median(new_s), median(kept_s), idle_mb, _memory_mb(prepared)
    finally:
        cold.close()
        prepared.close()


def _check_s(solver: SolverProcess, route: Route) -> float:
    started_s = monotonic()
    solver.ask(Question(route, STATE, GOAL, 'value_function', FACTORS), PATIENCE_S)
    while (answer := _poll(solver)) is None:
        pass
    if not isinstance(answer, SolverAnswer):
        raise RuntimeError(answer.explanation)
    return monotonic() - started_s


def _poll(solver: SolverProcess) -> SolverAnswer | Failure | None:
    sleep(POLL_S)
    return solver.poll()


def _memory_mb(solver: SolverProcess) -> float:
    import psutil
    return psutil.Process(solver.process_id).memory_info().rss / 2**20
