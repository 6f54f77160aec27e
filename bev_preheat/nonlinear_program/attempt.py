# SPDX-License-Identifier: Apache-2.0
"""One call of the solver: bounds and parameters of a program, its start, and its result."""

from __future__ import annotations

from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from io import StringIO
import sys
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.nonlinear_program.drive_step import RESERVES
from bev_preheat.nonlinear_program.program import build_program, Give, NonlinearProgram, ProgramSolution
from bev_preheat.nonlinear_program.program_solvers import FATROP, has_fatrop, IPOPT
from bev_preheat.nonlinear_program.symbols import FACTORS
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import Trip
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.variants import Corrections

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.nonlinear_program.layout import Values
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule

SUCCESS = 'Solve_Succeeded'
# Set up within 0.2 s; 10 000 steps would take 17 s.
MOST_STEPS_OF_FATROP = 1000
# Largest violation of a scaled bound or constraint by an answer, and largest excess of its cost over the start's.
SOUND = 1e-7


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
    The solvers' result for a program: final variables (scaled), one solver's status, and the effort of all.

    `solver` is the successful solver, or the last that failed. `energy` is the program's, in its scale;
    `target_multiplier` is its increase per kelvin of the target.
    """

    program: NonlinearProgram
    variables: FloatArray
    energy: float
    target_multiplier: float
    solver: str
    status: str
    iterations: int
    time_s: float

    @property
    def solution(self) -> ProgramSolution:
        """The solution given by the variables."""
        return self.program.solution(self.variables)

    @property
    def values(self) -> Values:
        """The variables by name, in SI units."""
        return self.program.variables.unpack(self.variables)


def attempt(problem: Problem, limited: bool, give: Give = Give.NOTHING,
            starts: Sequence[Values] = (), solvers: Sequence[str] | None = None) -> Attempt:
    """
    Return the best Attempt at a program, from each of the given starts or, cold, from the trip unheated.

    `solvers` are tried in order until one succeeds; None: FATROP, if available, and IPOPT.
    """
    program = build_program(problem.vehicle, len(problem.trip.route), limited, give)
    runs: list[Attempt] = []
    for solver in available_solvers(problem.trip, give) if solvers is None else solvers:
        for start in starts or [unheated_start(problem)]:
            runs.append(_run(problem, program, solver, program.variables.pack(start)))
            if solver == IPOPT and runs[-1].status != SUCCESS:
                # IPOPT is slow to prove infeasibility, so it is not retried from other starts.
                break
        if any(run.status == SUCCESS for run in runs):
            break
    found = [run for run in runs if run.status == SUCCESS]
    best = min(found, key=lambda run: run.energy) if found else runs[-1]
    return replace(best, iterations=sum(run.iterations for run in runs),
                   time_s=sum(run.time_s for run in runs))


def available_solvers(trip: Trip, give: Give = Give.NOTHING) -> tuple[str, ...]:
    """
    Return the solvers for a program of a trip, in order of preference.

    FATROP relaxes bounds slightly, which the prices of slacks turn into watt-hours, and its setup time in CasADi
    grows with the square of the number of steps.
    """
    if has_fatrop() and give is Give.NOTHING and len(trip.route) <= MOST_STEPS_OF_FATROP:
        return FATROP, IPOPT
    return (IPOPT,)


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


def _run(problem: Problem, program: NonlinearProgram, name: str, guess: FloatArray) -> Attempt:
    """Return the Attempt of one solver."""
    solver = program.solver(name)
    variables, constraints = program.variables, program.constraints
    bounds = [variables.pack(values) for values in _variable_bounds(problem, program)]
    bounds_g = [constraints.pack(values) for values in constraint_bounds(problem)]
    parameters = parameters_of(problem)
    started = perf_counter()
    warnings = StringIO()
    # If interrupted, CasADi warns of the KeyboardInterrupt that it raises.
    with redirect_stderr(warnings):
        result = solver(x0=guess, lbx=bounds[0], ubx=bounds[1], lbg=bounds_g[0], ubg=bounds_g[1],
                        p=parameters)
    time_s = perf_counter() - started
    if warnings.getvalue():
        print(warnings.getvalue(), end='', file=sys.stderr)
    statistics = solver.stats()
    found, energy = np.asarray(result['x']).ravel(), float(result['f'])
    status = statistics['return_status']
    if name == FATROP:
        # FATROP's status is a number.
        status = f'FATROP ended with {status}'
        if statistics['success'] and is_sound(program, parameters, guess, found, bounds, bounds_g):
            status, found = SUCCESS, np.clip(found, *bounds)
    multiplier = constraints.unpack(np.asarray(result['lam_g']).ravel())['target'][0]
    return Attempt(program, found, energy, -float(multiplier), name, status,
                   int(statistics['iter_count']), time_s)


def is_sound(program: NonlinearProgram, parameters: FloatArray, guess: FloatArray, found: FloatArray,
             bounds: Sequence[FloatArray], bounds_g: Sequence[FloatArray]) -> bool:
    """Return whether an answer keeps bounds and constraints, and costs no more than a start that keeps them."""
    def costs(variables: FloatArray) -> float:
        """Return the energy; inf if a bound or constraint is violated."""
        energy, values = program.staged.problem(variables, parameters)
        beyond = max(_beyond(variables, *bounds), _beyond(np.asarray(values).ravel(), *bounds_g))
        # NaN counts as a violation.
        return float(energy) if beyond <= SOUND else np.inf

    energy = costs(found)
    return bool(np.isfinite(energy) and energy <= costs(guess) + SOUND)


def _beyond(values: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """Return the largest violation of the bounds; NaN if a value is NaN."""
    return float(np.max(np.maximum(low - values, values - high)))


def _ranges(problem: Problem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (lowest, highest) state of charge, and temperature [deg C]."""
    battery, state = problem.trip.vehicle.battery, problem.state
    lowest_soc, highest_soc = battery.soc_range
    coldest_c, warmest_c = battery.temperature_range_c
    # A battery that starts outside its range may stay there.
    return ((min(lowest_soc, state.soc), max(highest_soc, state.soc)),
            (coldest_c, warmest_c + problem.beyond_range_k))


def _variable_bounds(problem: Problem, program: NonlinearProgram) -> tuple[Values, Values]:
    """Return the lower and upper bounds of the variables; a range with slack is not a bound."""
    trip, state, give = problem.trip, problem.state, program.give
    (lowest_soc, highest_soc), (coldest_c, warmest_c) = _ranges(problem)
    if give:
        lowest_soc = -np.inf
    if give is Give.RANGES:
        highest_soc = warmest_c = np.inf

    def from_start(start: float, later: float) -> FloatArray:
        return np.append(start, np.full(len(trip.route), later))

    slacks = ('deficit_k', 'deficit_soc', 'deficit_w', 'soc_above', 'k_above')
    low: Values = {
        'soc': from_start(state.soc, lowest_soc),
        'temperature': from_start(state.temperature_c, coldest_c),
        'heater_power': from_start(state.heater_power_w, -np.inf),
        'coolant_excess': from_start(state.coolant_excess_k, -np.inf),
        'heater': 0.0, 'brake': 0.0, **dict.fromkeys(slacks, 0.0)}
    high: Values = {
        'soc': from_start(state.soc, highest_soc),
        'temperature': from_start(state.temperature_c, warmest_c),
        'heater_power': from_start(state.heater_power_w, np.inf),
        'coolant_excess': from_start(state.coolant_excess_k, np.inf),
        'heater': trip.heater_limit_w,
        'brake': np.maximum(-trip.route.propulsion_power_w, 0.0),
        **dict.fromkeys(slacks, np.inf)}
    return low, high


def constraint_bounds(problem: Problem) -> tuple[Values, Values]:
    """Return the lower and upper bounds of the constraints."""
    (lowest_soc, highest_soc), (_, warmest_c) = _ranges(problem)
    reserves = [reserve.name for reserve in RESERVES]
    low: Values = {
        'soc_defect': 0.0, 'temperature_defect': 0.0, 'heater_power_defect': 0.0,
        'coolant_excess_defect': 0.0, **dict.fromkeys(reserves, 0.0),
        'lowest_soc': lowest_soc, 'highest_soc': -np.inf, 'highest_temperature': -np.inf,
        'target': 0.0, 'final_soc': 0.0}
    high: Values = {
        'soc_defect': 0.0, 'temperature_defect': 0.0, 'heater_power_defect': 0.0,
        'coolant_excess_defect': 0.0, **dict.fromkeys(reserves, np.inf),
        'lowest_soc': np.inf, 'highest_soc': highest_soc, 'highest_temperature': warmest_c,
        'target': np.inf, 'final_soc': np.inf}
    return low, high


def parameters_of(problem: Problem) -> FloatArray:
    """Return the program's parameters, in its order."""
    trip, goal = problem.trip, problem.goal
    coldest_c = trip.vehicle.battery.temperature_range_c[0]
    target_c = goal.target_temperature_c if goal.charging_planned else coldest_c
    return np.concatenate([
        np.vstack([trip.route.duration_s, trip.idle_power_w, trip.power_variance_w2,
                   trip.idle_heat_w, trip.leakage_w_per_k]).ravel(order='F'),
        [target_c, reserve_soc(trip.vehicle, goal)],
        [getattr(problem.corrections, factor) for factor in FACTORS],
        [trip.vehicle.hvch.efficiency]])
