# SPDX-License-Identifier: Apache-2.0
"""One call of the solver: the bounds and parameters of a program, its start, and what came of it."""

from __future__ import annotations

from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
import sys
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.optimum.program import build_program, Give, Program, Solution
from bev_preheat.optimum.symbols import FACTORS
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import Trip
from bev_preheat.vehicle.corrections import Corrections
from bev_preheat.vehicle.description import Vehicle

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.optimum.layout import Values

SUCCESS = 'Solve_Succeeded'


@dataclass(frozen=True)
class Problem:
    """
    What the programs of one optimum have in common.

    `vehicle` is as its file says, because programs are kept for it; that of `trip` is corrected.
    """

    vehicle: Vehicle
    corrections: Corrections
    trip: Trip
    state: BatteryState
    goal: Goal


@dataclass(frozen=True)
class Attempt:
    """
    One call of the solver: its Program, the variables it ended with (scaled), its word, its effort.

    `target_multiplier` is what the program's energy, in its scale, grows with a kelvin more of
    the target.
    """

    program: Program
    variables: FloatArray
    target_multiplier: float
    status: str
    iterations: int
    time_s: float

    @property
    def solution(self) -> Solution:
        """What the variables stand for."""
        return self.program.solution(self.variables)


def attempt(problem: Problem, limited: bool, give: Give = Give.NOTHING,
            start: Attempt | None = None) -> Attempt:
    """Return the Attempt at a program, from another one's end or, cold, from the trip unheated."""
    program = build_program(problem.vehicle, len(problem.trip.route), limited, give)
    low, high = _variable_bounds(problem, program)
    low_g, high_g = _constraint_bounds(problem)
    guess = (program.variables.pack(_unheated(problem)) if start is None
             else start.variables[:program.variables.size])
    started = perf_counter()
    warnings = StringIO()
    # Where it is interrupted, CasADi warns of the KeyboardInterrupt that it raises.
    with redirect_stderr(warnings):
        result = program.solver(
            x0=guess, lbx=program.variables.pack(low), ubx=program.variables.pack(high),
            lbg=program.constraints.pack(low_g), ubg=program.constraints.pack(high_g),
            p=_parameters(problem))
    time_s = perf_counter() - started
    if warnings.getvalue():
        print(warnings.getvalue(), end='', file=sys.stderr)
    statistics = program.solver.stats()
    multipliers = program.constraints.unpack(np.asarray(result['lam_g']).ravel())
    return Attempt(program, np.asarray(result['x']).ravel(), -float(multipliers['target'][0]),
                   statistics['return_status'], int(statistics['iter_count']), time_s)


def _ranges(problem: Problem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (lowest, highest) state of charge, and temperature [deg C]."""
    battery, state = problem.trip.vehicle.battery, problem.state
    lowest_soc, highest_soc = battery.soc_range
    # A battery that starts outside its range may stay there.
    return ((min(lowest_soc, state.soc), max(highest_soc, state.soc)), battery.temperature_range_c)


def _variable_bounds(problem: Problem, program: Program) -> tuple[Values, Values]:
    """Return what the variables may be at least and at most; a range that gives is no bound."""
    trip, state, give = problem.trip, problem.state, program.give
    (lowest_soc, highest_soc), (coldest_c, warmest_c) = _ranges(problem)
    if give:
        lowest_soc = -np.inf
    if give is Give.RANGES:
        highest_soc = warmest_c = np.inf

    def from_start(start: float, later: float) -> FloatArray:
        return np.append(start, np.full(len(trip.route), later))

    slacks = ('lacking_k', 'lacking_soc', 'lacking_w', 'soc_above', 'k_above')
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
        # Only where power limits count does the friction brake have anything to do.
        'brake': np.maximum(-trip.route.propulsion_power_w, 0.0) if program.limited else 0.0,
        **dict.fromkeys(slacks, np.inf)}
    return low, high


def _constraint_bounds(problem: Problem) -> tuple[Values, Values]:
    """Return what the constraints may be at least and at most."""
    (lowest_soc, highest_soc), (_, warmest_c) = _ranges(problem)
    low: Values = {
        'soc_defect': 0.0, 'temperature_defect': 0.0, 'heater_power_defect': 0.0,
        'coolant_excess_defect': 0.0, 'discharge': 0.0, 'charge': 0.0,
        'lowest_soc': lowest_soc, 'highest_soc': -np.inf, 'highest_temperature': -np.inf,
        'target': 0.0, 'final_soc': 0.0}
    high: Values = {
        'soc_defect': 0.0, 'temperature_defect': 0.0, 'heater_power_defect': 0.0,
        'coolant_excess_defect': 0.0, 'discharge': np.inf, 'charge': np.inf,
        'lowest_soc': np.inf, 'highest_soc': highest_soc, 'highest_temperature': warmest_c,
        'target': np.inf, 'final_soc': np.inf}
    return low, high


def _unheated(problem: Problem) -> Values:
    """Return the variables of the trip without heating."""
    idle = plan_without_heating(problem.trip, problem.state)
    heat = idle.heat
    return {'soc': idle.soc, 'temperature': idle.temperature_c, 'heater': 0.0, 'brake': 0.0,
            'heater_power': 0.0 if heat is None else heat.heater_power_w,
            'coolant_excess': 0.0 if heat is None else heat.coolant_excess_k,
            'lacking_k': 0.0, 'lacking_soc': 0.0, 'lacking_w': 0.0, 'soc_above': 0.0,
            'k_above': 0.0}


def _parameters(problem: Problem) -> FloatArray:
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
