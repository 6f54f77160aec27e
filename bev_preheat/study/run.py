# SPDX-License-Identifier: Apache-2.0
"""Runs the methods and the nonlinear program on many trips, on all cores."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import count
import multiprocessing
import os
from typing import Optional

from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.status import Status
from bev_preheat.study.trips import draw_trip
from bev_preheat.vehicle import load_vehicle

# Outcomes of a trip, told by the nonlinear program, not by the methods.
FEASIBLE = 'feasible'
NOT_NEEDED = 'not needed'
UNREACHABLE = 'unreachable'
BATTERY_EMPTY = 'battery empty'
SOLVER_FAILED = 'solver failed'
# A heater that the program does not use at all gives less than this.
NO_HEATING_WH = 0.01


@dataclass(frozen=True)
class MethodResult:
    """What one method made of one trip."""

    status: str
    arrival_temperature_c: float
    energy_wh: float
    gap_wh: Optional[float]
    planning_time_s: float


@dataclass(frozen=True)
class TripResult:
    """One trip: what it is, what the program says of it, and what the methods made of it."""

    number: int
    outcome: str
    detail: str
    duration_s: float
    target_c: float
    optimal_energy_wh: Optional[float]
    optimal_arrival_c: Optional[float]
    solve_time_s: Optional[float]
    methods: dict


def run_trip(vehicle, seed, number):
    """Return the TripResult of one drawn trip."""
    from bev_preheat.optimum.solve import SolverFailure, solve_optimum
    trip = draw_trip(vehicle, seed, number)
    inputs = trip.vehicle, trip.route, trip.state, trip.goal
    plans = {method: plan_preheating(*inputs, method) for method in METHODS}
    optimum, outcome, detail = None, SOLVER_FAILED, ''
    try:
        optimum = solve_optimum(*inputs, limited=False)
        outcome, detail = _outcome(optimum)
    except SolverFailure as error:
        detail = str(error)
    best = optimum.plan if optimum else None
    return TripResult(
        number=number, outcome=outcome, detail=detail,
        duration_s=trip.route.total_duration_s,
        target_c=trip.goal.target_temperature_c,
        optimal_energy_wh=best.energy_wh.battery_total if best else None,
        optimal_arrival_c=best.arrival_temperature_c if best else None,
        solve_time_s=optimum.solve_time_s if optimum else None,
        methods={method: MethodResult(
            status=plan.status.name,
            arrival_temperature_c=plan.arrival_temperature_c,
            energy_wh=plan.energy_wh.battery_total,
            gap_wh=plan.energy_wh.battery_total - best.energy_wh.battery_total if best else None,
            planning_time_s=plan.planning_time_s) for method, plan in plans.items()})


def _outcome(optimum):
    from bev_preheat.optimum.solve import TARGET
    if optimum.lacking:
        target_only = all(item.constraint == TARGET for item in optimum.lacking)
        return UNREACHABLE if target_only else BATTERY_EMPTY, '; '.join(optimum.infeasible)
    if optimum.plan.energy_wh.hvch_electric < NO_HEATING_WH:
        return NOT_NEEDED, ''
    return FEASIBLE, ''


# What the methods must say where the program says so.
EXPECTED = {
    NOT_NEEDED: (Status.NOT_NEEDED.name,),
    UNREACHABLE: (Status.TARGET_UNREACHABLE.name,),
    FEASIBLE: (Status.WAITING.name, Status.HEATING.name),
}


def disagreements(results, method):
    """Return the results in which a method's status contradicts the program."""
    return [result for result in results if result.outcome in EXPECTED
            and result.methods[method].status not in EXPECTED[result.outcome]]


def run_study(vehicle_name, feasible, seed, jobs, progress):
    """
    Run trips 0, 1, 2 … until `feasible` of them are feasible; returns their TripResults in order.

    Trips in between that are not are in the list too. `progress(feasible_so_far, results_so_far)`
    is called after each trip. Which trips are run does not depend on `jobs`.
    """
    results, found = [], 0
    # A fork would take the solver's threads and the terminal's state along.
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(jobs or os.cpu_count(), mp_context=context,
                             initializer=_prepare, initargs=(vehicle_name, seed)) as pool:
        numbers, waiting = count(), []
        while found < feasible:
            while len(waiting) < 3 * (jobs or os.cpu_count()):
                waiting.append(pool.submit(_run_in_worker, next(numbers)))
            result = waiting.pop(0).result()
            results.append(result)
            found += result.outcome == FEASIBLE
            progress(found, len(results))
        for future in waiting:
            future.cancel()
    return results


_worker = {}


def _prepare(vehicle_name, seed):
    _worker['vehicle'], _worker['seed'] = load_vehicle(vehicle_name), seed


def _run_in_worker(number):
    return run_trip(_worker['vehicle'], _worker['seed'], number)
