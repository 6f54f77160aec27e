# SPDX-License-Identifier: Apache-2.0
"""Solves the nonlinear program for a situation; the result is a Plan with the solver's word on it."""

from dataclasses import dataclass
import math
from time import perf_counter

import numpy as np

from bev_preheat.model import make_runge_kutta_4
from bev_preheat.optimum.program import (
    build_program, ENERGY_SCALE_J, POWER_SCALE_W, SOC_SCALE)
from bev_preheat.planning.plan import Plan
from bev_preheat.planning.planner import finish_plan, plan_without_heating
from bev_preheat.planning.schedule import Schedule, switched_on_s
from bev_preheat.planning.simulate import JOULES_PER_WH
from bev_preheat.planning.situation import check_situation
from bev_preheat.planning.trip import make_trip

METHOD = 'nlp'
# Constraints that may be lacking something.
TARGET = 'target temperature'
ARRIVAL_SOC = 'state of charge on arrival'
DISCHARGE_POWER = 'discharge power'
SUCCESS = 'Solve_Succeeded'
# A slack below this is rounding, not a constraint that cannot be kept: K, %, kW.
SLACK_TOLERANCE = 1e-5


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
    `lacking` holds the constraints that cannot be kept; empty: `plan` is the optimum. `marginal_cost_wh_per_k` is the multiplier of the target: what one more kelvin on
    arrival would cost (NaN where the target does not bind or cannot be met).
    """

    plan: Plan
    solver_status: str
    iterations: int
    solve_time_s: float
    lacking: tuple
    marginal_cost_wh_per_k: float

    @property
    def infeasible(self):
        """Sentences on the constraints that cannot be kept, with figures."""
        return tuple(item.text for item in self.lacking)

    def as_dictionary(self):
        """Return the optimum as `preheat optimum --json` writes it."""
        return {**self.plan.as_dictionary(), 'solver_status': self.solver_status,
                'solve_time_s': self.solve_time_s, 'iterations': self.iterations,
                'infeasible': list(self.infeasible),
                'marginal_cost_wh_per_k': self.marginal_cost_wh_per_k}


def solve_optimum(vehicle, route, state, goal, limited=True):
    """
    Return the Optimum for a vehicle with a battery state at the start of a route.

    `limited`: keep the battery's power limits (9i). Raises InvalidInput as `plan_preheating` does,
    SolverFailure where even the elastic program could not be solved.
    """
    started = perf_counter()
    check_situation(vehicle, route, state, goal)
    trip = make_trip(vehicle, route)
    program = build_program(vehicle, len(trip.route), limited)
    built = perf_counter()
    solution, statistics = _run(program, trip, state, goal)
    lacking, marginal_cost = (), math.nan
    solver_status, iterations = statistics['return_status'], statistics['iter_count']
    if solver_status == SUCCESS:
        multiplier = -float(solution['lam_g'][-2])
        if goal.charging_planned and multiplier > 1e-9:
            marginal_cost = multiplier * ENERGY_SCALE_J / JOULES_PER_WH
    else:
        program = build_program(vehicle, len(trip.route), limited, elastic=True)
        solution, statistics = _run(program, trip, state, goal)
        if statistics['return_status'] != SUCCESS:
            raise SolverFailure(f'IPOPT ended with {solver_status}, and with '
                                f'{statistics["return_status"]} where constraints may give')
        iterations += statistics['iter_count']
        lacking = tuple(_lacking(trip, program.split(solution['x'])[4]))
    soc, temperature_c, heater_w, brake_w, _ = program.split(solution['x'])
    solve_time_s = perf_counter() - built
    schedule = Schedule(switched_on_s(trip, heater_w), heater_w, brake_w, soc, temperature_c,
                        make_runge_kutta_4)
    return Optimum(
        plan=finish_plan(trip, goal, schedule, METHOD, started),
        solver_status=solver_status,
        iterations=int(iterations),
        solve_time_s=solve_time_s,
        lacking=lacking,
        marginal_cost_wh_per_k=marginal_cost)


def _run(program, trip, state, goal):
    """Call the solver, cold: from the run without heating."""
    route, battery, n = trip.route, trip.vehicle.battery, program.steps
    idle = plan_without_heating(trip, state)
    soc_low, soc_high = battery.soc_range
    cold_c, warm_c = battery.temperature_range_c
    low = [np.full(n + 1, min(soc_low, state.soc) / SOC_SCALE),
           np.full(n + 1, cold_c), np.zeros(n), np.zeros(n)]
    high = [np.full(n + 1, max(soc_high, state.soc) / SOC_SCALE),
            np.full(n + 1, warm_c), trip.heater_limit_w / POWER_SCALE_W,
            np.maximum(-route.propulsion_power_w, 0.0) / POWER_SCALE_W]
    low[0][0] = high[0][0] = state.soc / SOC_SCALE
    low[1][0] = high[1][0] = state.temperature_c
    guess = [idle.soc / SOC_SCALE, idle.temperature_c, np.zeros(n), np.zeros(n)]
    if not program.limited:
        high[3] = np.zeros(n)
    if program.elastic:
        slacks = n + 2
        # The state of charge may run below its range then; how far, the slack says.
        low[0][1:] = -np.inf
        low.append(np.zeros(slacks))
        high.append(np.full(slacks, np.inf))
        guess.append(np.zeros(slacks))
    at_least_zero = 2 * n * program.limited + 2
    final_soc = max(goal.minimum_arrival_soc, soc_low)
    target_c = goal.target_temperature_c if goal.charging_planned else cold_c
    result = program.solver(
        x0=np.concatenate(guess), lbx=np.concatenate(low), ubx=np.concatenate(high),
        lbg=np.zeros(2 * n + at_least_zero),
        ubg=np.concatenate([np.zeros(2 * n), np.full(at_least_zero, np.inf)]),
        p=np.concatenate([
            np.vstack([route.duration_s, trip.idle_power_w, trip.power_variance_w2,
                       trip.idle_heat_w, trip.leakage_w_per_k]).ravel(order='F'),
            [target_c, final_soc]]))
    return result, program.solver.stats()


def _lacking(trip, slacks):
    """What the elastic solution lacks, as Lacking."""
    target_k, soc_percent, discharge_kw = slacks[0], slacks[1], slacks[2:]
    if target_k > SLACK_TOLERANCE:
        yield Lacking(TARGET, float(target_k), 'K',
                      f'target temperature: {target_k:.2f} K cannot be reached')
    if soc_percent > SLACK_TOLERANCE:
        yield Lacking(ARRIVAL_SOC, float(soc_percent), '%',
                      f'state of charge on arrival: {soc_percent:.2f} % are lacking')
    if discharge_kw.max() > SLACK_TOLERANCE:
        at = int(np.argmax(discharge_kw))
        yield Lacking(DISCHARGE_POWER, 1e3 * float(discharge_kw[at]), 'W',
                      f'discharge power: {discharge_kw[at]:.2f} kW cannot be delivered at '
                      f'{trip.time_s[at]:.0f} s')
