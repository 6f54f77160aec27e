# SPDX-License-Identifier: Apache-2.0
"""Solves the nonlinear program for a situation; the result is a Plan with the solver's word."""

from __future__ import annotations

from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from io import StringIO
import math
import sys
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.model import make_runge_kutta_4
from bev_preheat.optimum.program import build_program, ENERGY_SCALE_J, Give, POWER_SCALE_W, Program, SOC_SCALE
from bev_preheat.optimum.symbols import FACTORS
from bev_preheat.planning.dynamics import JOULES_PER_WH
from bev_preheat.planning.limits import limits_hold, run_unheated
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import finish_plan, plan_without_heating
from bev_preheat.planning.safeguard import is_described
from bev_preheat.planning.schedule import HeldBack, Schedule, switched_on_s
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections
from bev_preheat.vehicle.description import Vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import Any

    from bev_preheat.arrays import FloatArray
    from bev_preheat.optimum.program import Slacks
    from bev_preheat.route import Route

METHOD = 'nlp'
AS_DESCRIBED = Corrections()
# Constraints that may be lacking something.
TARGET = 'target temperature'
ARRIVAL_SOC = 'state of charge on arrival'
LOWEST_SOC = 'lowest state of charge'
DISCHARGE_POWER = 'discharge power'
HIGHEST_SOC = 'highest state of charge'
HIGHEST_TEMPERATURE = 'highest battery temperature'
CHARGE = 'charge'
SUCCESS = 'Solve_Succeeded'
# What stands in place of the solver's word where it was not asked.
NOT_SOLVED = 'not solved: the charge does not carry the trip'
# Slacks below these are rounding, not constraints that cannot be kept.
TOLERANCE_K = 1e-5
SOC_TOLERANCE = 1e-7
TOLERANCE_W = 1e-2


class SolverFailure(RuntimeError):
    """The solver ended without a solution; the message carries its status."""


@dataclass(frozen=True)
class Lacking:
    """A constraint that cannot be kept, and by how much; `text` says it in words."""

    constraint: str
    amount: float
    unit: str
    text: str


@dataclass(frozen=True)
class Optimum:
    """
    The optimum, or the best that can be done.

    `solver_status` is IPOPT's word on the program itself; only 'Solve_Succeeded' is an optimum.
    `lacking` holds the constraints that cannot be kept; it is empty where `plan` is the optimum,
    and only there. `solve_time_s` is what IPOPT took, without the time to set its programs up.
    `marginal_cost_wh_per_k` is the multiplier of the target: what one more kelvin on arrival would
    cost (NaN where the target does not bind or cannot be met).
    """

    plan: Plan
    solver_status: str
    iterations: int
    solve_time_s: float
    lacking: tuple[Lacking, ...]
    marginal_cost_wh_per_k: float

    @property
    def infeasible(self) -> tuple[str, ...]:
        """Sentences on the constraints that cannot be kept, with figures."""
        return tuple(item.text for item in self.lacking)

    def as_dictionary(self) -> dict[str, Any]:
        """Return the optimum as `preheat optimum --json` writes it."""
        return {**self.plan.as_dictionary(), 'solver_status': self.solver_status,
                'solve_time_s': self.solve_time_s, 'iterations': self.iterations,
                'infeasible': list(self.infeasible),
                'marginal_cost_wh_per_k': self.marginal_cost_wh_per_k}


@dataclass(frozen=True)
class _Problem:
    """
    What the programs of one optimum have in common.

    `vehicle` is as its file says, because programs are kept for it; that of `trip` is corrected.
    """

    vehicle: Vehicle
    corrections: Corrections
    trip: Trip
    state: BatteryState
    goal: Goal


def solve_optimum(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                  limited: bool = True, corrections: Corrections = AS_DESCRIBED) -> Optimum:
    """
    Return the Optimum for a vehicle with a battery state at the start of a route.

    `limited`: keep the battery's power limits (9i). The program is solved without them first: a
    solution that keeps them all the same is the optimum with them too, at half the cost. A trip that
    the charge does not carry is not given to the solver: there is no optimum, and the best that can
    be done is not to heat. `corrections` of the vehicle need no programs of their own, unlike a
    corrected vehicle. Raises InvalidInput as `plan_preheating` does, SolverFailure where IPOPT
    finds neither an optimum nor what cannot be kept.
    """
    started = perf_counter()
    corrected = _corrected(vehicle, corrections)
    check_situation(corrected, route, state, goal)
    trip = make_trip(corrected, route)
    unheated = plan_without_heating(trip, state)
    if not is_described(trip, unheated):
        unheated = run_unheated(trip, state)
    if unheated.empty_at_s is not None:
        return _stranded(trip, goal, unheated, started)
    problem, runs = _Problem(vehicle, corrections, trip, state, goal), []
    if limited:
        run = _run(problem, limited=False)
        if run.status == SUCCESS and limits_hold(trip, _schedule(trip, run)):
            return _optimum(trip, goal, [run], (), started)
    for give in Give:
        run = _run(problem, limited, give)
        runs.append(run)
        if run.status == SUCCESS:
            break
    else:
        raise SolverFailure(f'IPOPT ended with {runs[0].status}, and with '
                            f'{runs[1].status} and {runs[2].status} where constraints may give')
    lacking = tuple(_lacking(trip, run))
    if give and not lacking:
        # All constraints can be kept: it was the solver that failed, and from here it may not.
        run = _run(problem, limited, start=run)
        runs = [run, *runs]
        if run.status != SUCCESS:
            raise SolverFailure(f'IPOPT ended with {runs[1].status}, and with {run.status} when '
                                'started where all constraints are kept')
    return _optimum(trip, goal, runs, lacking, started)


def _stranded(trip: Trip, goal: Goal, unheated: Schedule, started: float) -> Optimum:
    """Return the Optimum of a trip whose charge runs out: none, and why."""
    plan = finish_plan(trip, goal, unheated, METHOD, started)
    assert plan.stranding is not None
    lacking = Lacking(
        CHARGE, plan.stranding.lacking_wh, 'Wh',
        f'charge: {plan.stranding.lacking_wh / 1e3:.2f} kWh are lacking to arrive; the battery is '
        f'empty at {plan.stranding.at_s:.0f} s')
    return Optimum(plan=plan, solver_status=NOT_SOLVED, iterations=0, solve_time_s=0.0,
                   lacking=(lacking,), marginal_cost_wh_per_k=math.nan)


def prepare_programs(vehicle: Vehicle, route: Route) -> None:
    """
    Build and keep the program that `solve_optimum` solves first for this route.

    It serves all routes with as many steps, and the vehicle with any corrections.
    """
    build_program(vehicle, len(make_trip(vehicle, route).route), False, Give.NOTHING)


def _corrected(vehicle: Vehicle, corrections: Corrections) -> Vehicle:
    # What others keep for a vehicle is not kept for its copy.
    return vehicle if corrections == AS_DESCRIBED else corrected_vehicle(vehicle, corrections)


def _optimum(trip: Trip, goal: Goal, runs: Sequence[_Run], lacking: tuple[Lacking, ...],
             started: float) -> Optimum:
    """Return the Optimum of the first of the runs, which all had to be made."""
    run, marginal_cost = runs[0] if not lacking else runs[-1], math.nan
    schedule = _schedule(trip, run)
    if schedule.soc[-1] - reserve_soc(trip.vehicle, goal) < SOC_TOLERANCE:
        schedule = replace(schedule, held_back=HeldBack.RESERVE)
    if not lacking and goal.charging_planned and run.target_multiplier > 1e-9:
        marginal_cost = run.target_multiplier * ENERGY_SCALE_J / JOULES_PER_WH
    return Optimum(
        plan=finish_plan(trip, goal, schedule, METHOD, started),
        solver_status=runs[0].status,
        iterations=sum(run.iterations for run in runs),
        solve_time_s=sum(run.time_s for run in runs),
        lacking=lacking,
        marginal_cost_wh_per_k=marginal_cost)


def _schedule(trip: Trip, run: _Run) -> Schedule:
    soc, temperature_c, heater_w, brake_w, _ = run.split()
    return Schedule(switched_on_s(trip, heater_w), heater_w, brake_w, soc, temperature_c,
                    make_runge_kutta_4)


@dataclass(frozen=True)
class _Run:
    """One call of the solver: its Program, the variables it ended with, its word, its effort."""

    program: Program
    variables: FloatArray
    target_multiplier: float
    status: str
    iterations: int
    time_s: float

    def split(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, Slacks]:
        """Return what Program.split makes of the variables."""
        return self.program.split(self.variables)


def _run(problem: _Problem, limited: bool, give: Give = Give.NOTHING,
         start: _Run | None = None) -> _Run:
    """Return the _Run of a program, from another one or, cold, from the trip without heating."""
    trip, state, goal, corrections = (
        problem.trip, problem.state, problem.goal, problem.corrections)
    route, battery, n = trip.route, trip.vehicle.battery, len(trip.route)
    program = build_program(problem.vehicle, n, limited, give)
    soc_low, soc_high = battery.soc_range
    cold_c, warm_c = battery.temperature_range_c
    # A battery that starts outside its range may stay there.
    soc_low, soc_high = min(soc_low, state.soc) / SOC_SCALE, max(soc_high, state.soc) / SOC_SCALE
    low = [np.full(n + 1, soc_low), np.full(n + 1, cold_c), np.zeros(2 * n + program.slack_count)]
    high = [np.full(n + 1, soc_high), np.full(n + 1, warm_c), trip.heater_limit_w / POWER_SCALE_W,
            np.maximum(-route.propulsion_power_w, 0.0) / POWER_SCALE_W * program.limited,
            np.full(program.slack_count, np.inf)]
    defects, limits = np.zeros(2 * n), np.zeros(2 * n * program.limited)
    low_g, high_g = [defects, limits], [defects, np.full(len(limits), np.inf)]
    # Where a range may give, its bounds become constraints with slacks.
    if program.give:
        low[0][:] = -np.inf
        low_g.append(np.full(n, soc_low))
        high_g.append(np.full(n, np.inf))
    if program.give is Give.RANGES:
        high[0][:] = high[1][:] = np.inf
        low_g.append(np.full(2 * n, -np.inf))
        high_g += [np.full(n, soc_high), np.full(n, warm_c)]
    low[0][0] = high[0][0] = state.soc / SOC_SCALE
    low[1][0] = high[1][0] = state.temperature_c
    if start is None:
        idle = plan_without_heating(trip, state)
        guess = [idle.soc / SOC_SCALE, idle.temperature_c, np.zeros(2 * n + program.slack_count)]
    else:
        guess = [start.variables[:4 * n + 2]]
    target_c = goal.target_temperature_c if goal.charging_planned else cold_c
    started = perf_counter()
    warnings = StringIO()
    # Where it is interrupted, CasADi warns of the KeyboardInterrupt that it raises.
    with redirect_stderr(warnings):
        result = program.solver(
            x0=np.concatenate(guess), lbx=np.concatenate(low), ubx=np.concatenate(high),
            lbg=np.concatenate([*low_g, np.zeros(2)]),
            ubg=np.concatenate([*high_g, np.full(2, np.inf)]),
            p=np.concatenate([
                np.vstack([route.duration_s, trip.idle_power_w, trip.power_variance_w2,
                           trip.idle_heat_w, trip.leakage_w_per_k]).ravel(order='F'),
                [target_c, reserve_soc(trip.vehicle, goal)],
                [getattr(corrections, factor) for factor in FACTORS],
                [trip.vehicle.hvch.efficiency]]))
    time_s = perf_counter() - started
    if warnings.getvalue():
        print(warnings.getvalue(), end='', file=sys.stderr)
    statistics = program.solver.stats()
    return _Run(program, np.asarray(result['x']).ravel(), -float(result['lam_g'][-2]),
                statistics['return_status'], int(statistics['iter_count']), time_s)


def _lacking(trip: Trip, run: _Run) -> Iterator[Lacking]:
    """Return what a solution lacks, as Lacking."""
    soc, _, _, _, slacks = run.split()
    if slacks.target_k > TOLERANCE_K:
        yield Lacking(TARGET, slacks.target_k, 'K',
                      f'target temperature: {slacks.target_k:.2f} K cannot be reached')
    if slacks.soc[-1] > SOC_TOLERANCE:
        percent = 100.0 * float(slacks.soc[-1])
        yield Lacking(ARRIVAL_SOC, percent, '%',
                      f'state of charge on arrival: {percent:.2f} % are lacking')
    at = int(np.argmax(slacks.soc))
    # Where the battery is emptiest on arrival, that has been said.
    if slacks.soc[at] > SOC_TOLERANCE and soc[at + 1] < soc[-1]:
        percent = 100.0 * float(slacks.soc[at])
        yield Lacking(LOWEST_SOC, percent, '%',
                      f'state of charge: {percent:.2f} % below its range at '
                      f'{trip.time_s[at + 1]:.0f} s')
    at = int(np.argmax(slacks.discharge_w))
    if slacks.discharge_w[at] > TOLERANCE_W:
        lacking_w = float(slacks.discharge_w[at])
        yield Lacking(DISCHARGE_POWER, lacking_w, 'W',
                      f'discharge power: {lacking_w / 1e3:.2f} kW cannot be delivered at '
                      f'{trip.time_s[at]:.0f} s')
    at = int(np.argmax(slacks.soc_above))
    if slacks.soc_above[at] > SOC_TOLERANCE:
        percent = 100.0 * float(slacks.soc_above[at])
        yield Lacking(HIGHEST_SOC, percent, '%',
                      f'state of charge: {percent:.2f} % above its range at '
                      f'{trip.time_s[at + 1]:.0f} s')
    at = int(np.argmax(slacks.above_k))
    if slacks.above_k[at] > TOLERANCE_K:
        above_k = float(slacks.above_k[at])
        yield Lacking(HIGHEST_TEMPERATURE, above_k, 'K',
                      f'battery temperature: {above_k:.2f} K above its range at '
                      f'{trip.time_s[at + 1]:.0f} s')
