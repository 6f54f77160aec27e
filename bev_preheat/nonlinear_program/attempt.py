# SPDX-License-Identifier: Apache-2.0
"""One call of IPOPT: bounds and parameters of a program, its start, and its result."""

from __future__ import annotations

from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from io import StringIO
import sys
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.nonlinear_program.drive_steps import drive_parameters
from bev_preheat.nonlinear_program.program import build_program, Give
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import Trip
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import Corrections

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.nonlinear_program.blocks import Values
    from bev_preheat.nonlinear_program.program import NonlinearProgram
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.schedule import Schedule

SUCCESS = 'Solve_Succeeded'


@dataclass(frozen=True)
class Problem:
    """
    The common part of the programs of one optimum.

    `vehicle` is as in its file, because programs are cached for it; that of `trip` is corrected. The battery may
    get `beyond_range_k` warmer than the highest temperature of its range.
    """

    vehicle: Vehicle
    corrections: Corrections
    trip: Trip
    state: BatteryState
    goal: Goal
    beyond_range_k: float = 0.0


@dataclass(frozen=True)
class Attempt:
    """
    IPOPT's result for a program: the variables by name, in SI units, its status, and the effort of all starts.

    `energy` is the program's, in its scale; `target_multiplier` is its increase per kelvin of the target.
    """

    values: dict[str, FloatArray]
    energy: float
    target_multiplier: float
    status: str
    iterations: int
    time_s: float


def attempt(problem: Problem, limited: bool, give: Give = Give.NOTHING,
            starts: Sequence[Values] = ()) -> Attempt:
    """Return the best Attempt at a program, from each of the given starts or, cold, from the trip unheated."""
    program = build_program(problem.vehicle, len(problem.trip.route), limited, give)
    runs: list[Attempt] = []
    for start in starts or [unheated_start(problem)]:
        runs.append(_run(problem, program, program.variables.pack(start)))
        if runs[-1].status != SUCCESS:
            # IPOPT is slow to prove infeasibility, so it is not retried from other starts.
            break
    best = min((run for run in runs if run.status == SUCCESS), key=lambda run: run.energy, default=runs[-1])
    return replace(best, iterations=sum(run.iterations for run in runs),
                   time_s=sum(run.time_s for run in runs))


def driven_start(schedule: Schedule) -> Values:
    """Return the variables of a Schedule; all deficits are 0."""
    heat = schedule.heat
    return {'soc': schedule.soc, 'temperature': schedule.temperature_c,
            'heater': schedule.heater_power_w, 'brake': schedule.brake_power_w,
            'heater_power': 0.0 if heat is None else heat.heater_power_w,
            'coolant_excess': 0.0 if heat is None else heat.coolant_excess_k,
            'deficit_k': 0.0, 'deficit_soc': 0.0, 'deficit_w': 0.0, 'soc_above': 0.0,
            'k_above': 0.0}


def unheated_start(problem: Problem) -> Values:
    """Return the variables of the trip without heating, ignoring limits."""
    return driven_start(plan_without_heating(problem.trip, problem.state))


def heated_start(problem: Problem) -> Values:
    """Return the variables of the trip heated throughout, as far as the limits allow."""
    return driven_start(drive_as_planned(
        problem.trip, problem.state, problem.trip.heater_limit_w))


def _run(problem: Problem, program: NonlinearProgram, guess: FloatArray) -> Attempt:
    """Return the Attempt from one start."""
    bounds, bounds_g = _variable_bounds(problem, program), _constraint_bounds(problem, program)
    started = perf_counter()
    warnings = StringIO()
    # If interrupted, CasADi warns of the KeyboardInterrupt that it raises.
    with redirect_stderr(warnings):
        result = program.solver(x0=guess, lbx=bounds[0], ubx=bounds[1], lbg=bounds_g[0], ubg=bounds_g[1],
                                p=_parameters_of(problem))
    time_s = perf_counter() - started
    if warnings.getvalue():
        print(warnings.getvalue(), end='', file=sys.stderr)
    statistics = program.solver.stats()
    multiplier = program.constraints.unpack(np.asarray(result['lam_g']).ravel())['target'][0]
    return Attempt(program.values(np.asarray(result['x']).ravel()), float(result['f']), -float(multiplier),
                   statistics['return_status'], int(statistics['iter_count']), time_s)


def _ranges(problem: Problem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (lowest, highest) state of charge, and temperature [deg C]."""
    battery, state = problem.trip.vehicle.battery, problem.state
    lowest_soc, highest_soc = battery.soc_range
    coldest_c, warmest_c = battery.temperature_range_c
    # A battery that starts outside its range may stay there.
    return ((min(lowest_soc, state.soc), max(highest_soc, state.soc)),
            (coldest_c, warmest_c + problem.beyond_range_k))


def _variable_bounds(problem: Problem, program: NonlinearProgram) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of the variables (scaled); a range with slack is not a bound."""
    trip, state, give = problem.trip, problem.state, program.give
    (lowest_soc, highest_soc), (coldest_c, warmest_c) = _ranges(problem)
    if give:
        lowest_soc = -np.inf
    if give is Give.RANGES:
        highest_soc = warmest_c = np.inf
    low, high = state_bounds(trip, state, (lowest_soc, highest_soc), (coldest_c, warmest_c))
    return program.variables.pack(low, otherwise=0.0), program.variables.pack(high, otherwise=np.inf)


def state_bounds(trip: Trip, state: BatteryState, soc_range: tuple[float, float],
                 temperature_range_c: tuple[float, float]) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Return the lower bounds of the states of a drive, and the upper bounds of states and controls."""
    def from_start(low_soc: float, low_c: float, others: float) -> dict[str, FloatArray]:
        return {name: np.append(start, np.full(len(trip.route), later)) for name, start, later in (
            ('soc', state.soc, low_soc), ('temperature', state.temperature_c, low_c),
            ('heater_power', state.heater_power_w, others), ('coolant_excess', state.coolant_excess_k, others))}

    low, high = (from_start(soc_range[end], temperature_range_c[end], others) for end, others in (
        (0, -np.inf), (1, np.inf)))
    return low, {**high, 'heater': trip.heater_limit_w, 'brake': np.maximum(-trip.route.propulsion_power_w, 0.0)}


def _constraint_bounds(problem: Problem, program: NonlinearProgram) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of the constraints (scaled): defects are 0, margins at least 0."""
    (lowest_soc, highest_soc), (_, warmest_c) = _ranges(problem)
    defects = {name: 0.0 for name in program.constraints.names if name.endswith('_defect')}
    return (program.constraints.pack({'lowest_soc': lowest_soc, 'highest_soc': -np.inf,
                                      'highest_temperature': -np.inf}, otherwise=0.0),
            program.constraints.pack({**defects, 'highest_soc': highest_soc,
                                      'highest_temperature': warmest_c}, otherwise=np.inf))


def _parameters_of(problem: Problem) -> FloatArray:
    """Return the program's parameters, in its order."""
    trip, goal = problem.trip, problem.goal
    coldest_c = trip.vehicle.battery.temperature_range_c[0]
    return np.append(drive_parameters(trip, problem.corrections), [
        goal.target_temperature_c if goal.charging_planned else coldest_c, reserve_soc(trip.vehicle, goal)])
