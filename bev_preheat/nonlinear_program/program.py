# SPDX-License-Identifier: Apache-2.0
"""
The nonlinear program (9a)-(9j), built once for a vehicle and a number of steps, and its solution by IPOPT.

Multiple shooting with the Runge-Kutta step of `model`, solved by IPOPT. Variables: state of charge and temperature
at each instant; in each step the heater's power and the power of the friction brake. With a heat path, heater and
coolant are states too, and the energy that a heater with lag draws after arrival is paid for. The brake is not in
the paper: if the battery cannot accept the drivetrain's regeneration (9i), the rest must go somewhere, or every
descent with a cold battery would make the program infeasible. The brake takes power from regeneration only. This
power no longer passes the drivetrain, whose heat decreases with it.

An elastic program adds slacks at a high price. It is solved if the program itself has no solution, to identify the
violated constraint and the best possible result. Demands on the battery are relaxed first: target, state of
charge, discharge limit. The battery's ranges are relaxed only if that is not enough: a long climb can heat the
battery beyond its highest temperature by Joule heat alone. But if power is short only because a battery that is
warm enough to deliver a climb overheats on it, the highest temperature is not a bound (`solve`).
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import lru_cache
from io import StringIO
import sys
from time import perf_counter
from typing import Any

import casadi
import numpy as np

from bev_preheat.nonlinear_program.drive_steps import (
    add_drive_steps,
    Blocks,
    drive_parameters,
    power_row,
    POWER_SCALE_W,
    SOC_SCALE,
    Values,
)
from bev_preheat.numerics import FloatArray
from bev_preheat.planning.engine import run_without_heating
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import Trip
from bev_preheat.vehicle.description import HVCH, STANDING_MPS, Vehicle
from bev_preheat.vehicle.variants import Corrections

# Options that CasADi takes by name; its own type hints omit many.
ByName = dict[str, Any]


# Prices of a kelvin, a per cent and a kilowatt of deficit, in scaled joules: more than heating could ever save,
# and charge before warmth.
TARGET_PRICE = 1e2
SOC_PRICE = 1e4
DISCHARGE_PRICE = 1e4
# At each instant, of a per cent above the highest state of charge and of a kelvin above the highest temperature;
# higher prices keep IPOPT from converging.
RANGE_PRICE = 1e3

TOLERANCE = 1e-9
IPOPT_OPTIONS: ByName = {
    'print_time': False,
    'ipopt.print_level': 0,
    'ipopt.sb': 'yes',
    'ipopt.max_iter': 500,
    # With a monotone barrier IPOPT may stall at a barrier value whose minimum lies at a corner of a limit's table.
    'ipopt.mu_strategy': 'adaptive',
    'ipopt.tol': TOLERANCE,
    'ipopt.constr_viol_tol': TOLERANCE,
    'ipopt.acceptable_iter': 0,
    # Bounds are strict: relaxed ones would let the heater exceed the power that the cabin leaves.
    'ipopt.bound_relax_factor': 0.0,
}


class Give(IntEnum):
    """Constraints with slacks; each level includes the slacks of the one before."""

    NOTHING = 0
    # Target; lowest state of charge, on the way and on arrival; discharge power.
    DEMANDS = 1
    # Highest state of charge, highest temperature.
    RANGES = 2


@dataclass(frozen=True)
class NonlinearProgram:
    """
    A nonlinear program, its solver, and its variables and constraints.

    Variables: `soc` and `temperature` at each instant; in each step `heater`, the `power_row` of each further heat
    source and, if limited, `brake`;
    `heater_power` and `coolant_excess` at each instant, if the vehicle's heat path has them; the slacks:
    `deficit_k` (of the target), `excess_k` (of the highest arrival, of a vehicle that cools), `deficit_soc` at
    each instant, `deficit_w` (of the discharge power) with Give.DEMANDS, `soc_above` and `k_above` with RANGES.
    Constraints: `soc_defect`, `temperature_defect`, and one for each state of a heat path; if limited, the
    RESERVES of each step; with DEMANDS `lowest_soc`, with RANGES `highest_soc` and `highest_temperature`, each
    with its slack; `target` and `final_soc`, the margin of either, the former with an upper bound for the highest
    arrival. Parameters: those of the DriveSteps, the target temperature [deg C], the lowest state of charge on
    arrival, the price of heating.
    """

    variables: Blocks
    constraints: Blocks
    solver: casadi.Function
    give: Give

    def values(self, variables: FloatArray) -> dict[str, FloatArray]:
        """Return the variables by name, in SI units; those that the program does not have are at rest."""
        found = self.variables.unpack(variables)
        in_steps, at_instants = np.zeros(len(found['heater'])), np.zeros(len(found['soc']))
        return {'brake': in_steps, 'deficit_w': in_steps, 'deficit_k': np.zeros(1), 'excess_k': np.zeros(1),
                **dict.fromkeys(('deficit_soc', 'soc_above', 'k_above', 'coolant_excess'), at_instants),
                # Without a lag the heater follows its command.
                'heater_power': np.append(found['heater'][:1], found['heater']), **found}


# As many as one trip may need: each takes some megabytes with its solver, and on a drive the number of steps only
# falls. Positional only, without defaults: for lru_cache f(1, 2) and f(1, b=2) are different calls.
@lru_cache(maxsize=4)
def build_program(vehicle: Vehicle, steps: int, limited: bool, give: Give) -> NonlinearProgram:
    """Return the program for a vehicle and a number of steps; `limited`: by (9i), `give`: elastic constraints."""
    variables, constraints = Blocks(), Blocks()
    deficit_w = variables.variable('deficit_w', steps, POWER_SCALE_W) if give else casadi.MX(0.0)
    drive = add_drive_steps(vehicle, steps, limited, variables, constraints, deficit_w)
    soc, temperature, goal = variables.row('soc'), variables.row('temperature'), casadi.MX.sym('goal', 3)
    cost = drive.energy + goal[2] * drive.heating
    beyond_k, beyond_soc = temperature[-1] - goal[0], soc[-1] - goal[1] / SOC_SCALE
    if give:
        deficit_soc, deficit_k = variables.variable('deficit_soc', steps + 1, SOC_SCALE), variables.variable(
            'deficit_k', 1)
        beyond_k, beyond_soc = beyond_k + deficit_k, beyond_soc + deficit_soc[-1]
        cost += (DISCHARGE_PRICE * casadi.sum2(deficit_w) + SOC_PRICE * casadi.sum2(deficit_soc)
                 + TARGET_PRICE * deficit_k)
        constraints.add('lowest_soc', soc + deficit_soc, SOC_SCALE)
        if vehicle.cools:
            excess_k = variables.variable('excess_k', 1)
            beyond_k, cost = beyond_k - excess_k, cost + TARGET_PRICE * excess_k
    if give is Give.RANGES:
        soc_above = variables.variable('soc_above', steps + 1, SOC_SCALE)
        k_above = variables.variable('k_above', steps + 1)
        cost += RANGE_PRICE * casadi.sum2(soc_above + k_above)
        constraints.add('highest_soc', soc - soc_above, SOC_SCALE)
        constraints.add('highest_temperature', temperature - k_above)
    constraints.add('target', beyond_k)
    constraints.add('final_soc', beyond_soc, SOC_SCALE)
    solver = casadi.nlpsol('optimum', 'ipopt', {
        'x': variables.vector(), 'p': casadi.vertcat(drive.parameters, goal), 'f': cost,
        'g': constraints.vector()}, IPOPT_OPTIONS)
    return NonlinearProgram(variables, constraints, solver, give)


SUCCESS = 'Solve_Succeeded'


@dataclass(frozen=True)
class Problem:
    """
    The common part of the programs of one optimum.

    `vehicle` is as in its file, because programs are cached for it; that of `trip` is corrected. The battery may
    get `beyond_range_k` warmer than the highest temperature of its range. `heating_price` is that of a joule which
    the heat sources take, beside its energy.
    """

    vehicle: Vehicle
    corrections: Corrections
    trip: Trip
    state: BatteryState
    goal: Goal
    heating_price: float = 0.0
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

    @property
    def undelivered_w(self) -> float:
        """The power that the battery cannot deliver in the worst step [W]."""
        return float(self.values['deficit_w'].max())


def attempt(problem: Problem, limited: bool, give: Give = Give.NOTHING,
            starts: Sequence[Values] = ()) -> Attempt:
    """Return the best Attempt at a program, from each of the given starts or, cold, from the trip unheated."""
    program = build_program(problem.vehicle, len(problem.trip.route), limited, give)
    runs: list[Attempt] = []
    for start in starts or [driven_start(problem.trip, run_without_heating(problem.trip, problem.state))]:
        runs.append(_run(problem, program, program.variables.pack(start)))
        if runs[-1].status != SUCCESS:
            # IPOPT is slow to prove infeasibility, so it is not retried from other starts.
            break
    best = min((run for run in runs if run.status == SUCCESS), key=lambda run: run.energy, default=runs[-1])
    return replace(best, iterations=sum(run.iterations for run in runs),
                   time_s=sum(run.time_s for run in runs))


def driven_start(trip: Trip, schedule: Schedule) -> Values:
    """Return the variables of a Schedule of a Trip; all deficits are 0."""
    heat, split_w = schedule.heat, trip.mix.split_w(schedule.heater_power_w, schedule.temperature_c[:-1])
    sources_w = {power_row(source): split_w[source.name] for source in trip.vehicle.heat_sources}
    return {**sources_w, 'soc': schedule.soc, 'temperature': schedule.temperature_c,
            'heater': split_w.get(HVCH, schedule.heater_power_w), 'brake': schedule.brake_power_w,
            'heater_power': 0.0 if heat is None else heat.heater_power_w,
            'coolant_excess': 0.0 if heat is None else heat.coolant_excess_k,
            **dict.fromkeys(('deficit_k', 'excess_k', 'deficit_soc', 'deficit_w', 'soc_above', 'k_above'), 0.0)}


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
    speed_mps, may_move = trip.route.speed_mps, not trip.vehicle.heating_gates.only_while_standing
    limits_w = {power_row(source): np.where(
        source.serves_at(speed_mps) & (may_move | (speed_mps < STANDING_MPS)), np.inf, 0.0)
        for source in trip.vehicle.heat_sources}
    limits_w['heater'] = trip.hvch_limit_w
    return low, {**high, **limits_w, 'brake': np.maximum(-trip.route.propulsion_power_w, 0.0)}


def _constraint_bounds(problem: Problem, program: NonlinearProgram) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of the constraints (scaled): defects are 0, margins at least 0."""
    (lowest_soc, highest_soc), (_, warmest_c) = _ranges(problem)
    defects = {name: 0.0 for name in program.constraints.names if name.endswith('_defect')}
    goal, most_k = problem.goal, np.inf
    if problem.vehicle.cools and goal.charging_planned:
        most_k = goal.highest_arrival_c - goal.target_temperature_c
    return (program.constraints.pack({'lowest_soc': lowest_soc, 'highest_soc': -np.inf,
                                      'highest_temperature': -np.inf}, otherwise=0.0),
            program.constraints.pack({**defects, 'highest_soc': highest_soc, 'target': most_k,
                                      'highest_temperature': warmest_c}, otherwise=np.inf))


def _parameters_of(problem: Problem) -> FloatArray:
    """Return the program's parameters, in its order."""
    trip, goal = problem.trip, problem.goal
    coldest_c = trip.vehicle.battery.temperature_range_c[0]
    return np.append(drive_parameters(trip, problem.corrections), [
        goal.target_temperature_c if goal.charging_planned else coldest_c, reserve_soc(trip.vehicle, goal),
        problem.heating_price])
