# SPDX-License-Identifier: Apache-2.0
"""Solves the nonlinear program: a Plan with the solver's status, and the constraints that cannot be kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
import math
from time import perf_counter

import numpy as np

from bev_preheat.nonlinear_program.drive_steps import ENERGY_SCALE_J, power_row
from bev_preheat.nonlinear_program.program import Attempt, attempt, driven_start, Give, Problem, SUCCESS
from bev_preheat.nonlinear_program.symbols import smoothed_a_little
from bev_preheat.numerics import ARRAYS, FloatArray, JOULES_PER_WH
from bev_preheat.planning.dynamics import is_described
from bev_preheat.planning.engine import run_without_heating
from bev_preheat.planning.heat_run import along_states
from bev_preheat.planning.limits import drive_as_planned, limits_hold, run_unheated
from bev_preheat.planning.plan import Optimum, StepDeficit
from bev_preheat.planning.planner import finish_plan
from bev_preheat.planning.schedule import HeldBack, Schedule, switched_on_s
from bev_preheat.planning.situation import BatteryState, check_situation, Goal, reserve_soc
from bev_preheat.planning.trip import make_trip, Trip
from bev_preheat.route import Route
from bev_preheat.tunables import HOTTEST_BEYOND_RANGE_K
from bev_preheat.vehicle.description import Vehicle
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

METHOD = 'nlp'
AS_DESCRIBED = Corrections()
# Status if no solver was asked.
NOT_SOLVED = 'not solved: the charge is not enough for the trip'
# A battery this close to its highest temperature is held there by the bound.
NEAR_HIGHEST_K = 1e-3
# Constraints that may have a deficit.
TARGET = 'target temperature'
ARRIVAL_SOC = 'state of charge on arrival'
LOWEST_SOC = 'lowest state of charge'
DISCHARGE_POWER = 'discharge power'
HIGHEST_SOC = 'highest state of charge'
HIGHEST_TEMPERATURE = 'highest battery temperature'
CHARGE = 'charge'
# Slacks below these are rounding.
TOLERANCE_K = 1e-5
SLACK_SOC_TOLERANCE = 1e-7
TOLERANCE_W = 1e-2


class SolverFailure(RuntimeError):
    """The solver ended without a solution; the message carries its status."""


def solve_optimum(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal,
                  limited: bool = True, corrections: Corrections = AS_DESCRIBED,
                  heating_price: float = 0.0) -> Optimum:
    """
    Return the Optimum for a vehicle with a battery state at the start of a route.

    `limited`: keep the battery's power limits (9i). If the unheated trip keeps them, the program is solved without
    limits first: a solution that keeps them anyway is also the optimum with limits, at half the cost. With active
    limits the program may have several optima, so it is solved from the unheated trip and from the trip heated
    throughout, and the better result counts. If the charge is not enough for the trip, no solver is asked: there
    is no optimum, and not heating is the best possible. If the drive's power is short only because of the highest
    temperature, the battery may get warmer. If the solvers do not converge, corners of the maps are rounded
    minimally; limits then hold within 10 W. `corrections` of the vehicle need no programs of their
    own, unlike a corrected vehicle. `heating_price` is that of a Problem. Raises InvalidInput as `plan_preheating`
    does, SolverFailure if IPOPT finds neither an optimum nor the constraints that cannot be kept.
    """
    started = perf_counter()
    # Results cached for a vehicle would not be found for its copy.
    corrected = vehicle if corrections == AS_DESCRIBED else corrected_vehicle(vehicle, corrections)
    check_situation(corrected, route, state, goal)
    trip = make_trip(corrected, route)
    without = unheated = run_without_heating(trip, state)
    if not is_described(trip, unheated):
        unheated = run_unheated(trip, state)
    if unheated.empty_at_s is not None:
        return _stranded(trip, goal, unheated, started)
    problem, runs = Problem(vehicle, corrections, trip, state, goal, heating_price), []
    # An optimum may lie at a corner of a map, where IPOPT does not converge.
    rounded = replace(problem, vehicle=smoothed_a_little(vehicle))
    # At a temperature from which a heat source works, it usually does.
    problem = rounded if vehicle.heat_sources else problem
    schedules = [without]
    if limited or vehicle.heat_sources:
        schedules.append(drive_as_planned(trip, state, trip.heater_limit_w))
    if vehicle.cools:
        schedules.append(drive_as_planned(trip, state, trip.most_cold_w))
    starts = [driven_start(trip, schedule) for schedule in schedules]
    if limited and limits_hold(trip, unheated):
        # Heat sources that begin at a temperature make several optima, too.
        run = attempt(problem, limited=False, starts=starts if vehicle.heat_sources else ())
        if run.status == SUCCESS and limits_hold(trip, _schedule(trip, run)):
            return _optimum(trip, goal, [run], (), started)
    for give in Give:
        # Elastic programs only determine the deficits; one start is enough.
        run = attempt(problem, limited, give, starts[:1] if give else starts)
        runs.append(run)
        if run.status == SUCCESS:
            break
    else:
        run = attempt(rounded, limited, give, starts[:1])
        if run.status != SUCCESS:
            raise SolverFailure(f'IPOPT ended with {runs[0].status}, and with '
                                f'{runs[1].status} and {runs[2].status} with relaxed constraints')
        runs.append(run)
    deficit = tuple(_find_deficits(trip, run.values))
    near_highest_c = trip.vehicle.battery.temperature_range_c[1] - NEAR_HIGHEST_K
    if (give is Give.DEMANDS and run.values['temperature'].max() > near_highest_c
            and run.undelivered_w > TOLERANCE_W):
        # Delivering the drive takes precedence over the range, as in plans: the car's cooling handles the heat.
        warmer = attempt(
            replace(problem, beyond_range_k=HOTTEST_BEYOND_RANGE_K), limited, give, [run.values])
        if warmer.status == SUCCESS and warmer.undelivered_w <= TOLERANCE_W:
            runs.append(warmer)
            deficit = tuple(_find_deficits(trip, warmer.values))
        else:
            runs.insert(1, warmer)
    if give and not deficit:
        # All constraints can be kept, so the solver failed; from this start it may succeed.
        for again in problem, rounded:
            run = attempt(again, limited, starts=[run.values])
            runs = [run, *runs]
            if run.status == SUCCESS:
                break
        else:
            raise SolverFailure(f'IPOPT ended with {runs[2].status}, and with {run.status} when '
                                'started from a feasible point')
    return _optimum(trip, goal, runs, deficit, started)


def _stranded(trip: Trip, goal: Goal, unheated: Schedule, started: float) -> Optimum:
    """Return the Optimum of a trip whose charge runs out: no optimum, and the reason."""
    plan = finish_plan(trip, goal, unheated, METHOD, started)
    assert plan.stranding is not None
    deficit = StepDeficit(
        CHARGE, plan.stranding.deficit_wh, 'Wh',
        f'charge: {plan.stranding.deficit_wh / 1e3:.2f} kWh short; the battery will be '
        f'empty at {plan.stranding.at_s:.0f} s')
    return Optimum(plan=plan, solver_status=NOT_SOLVED, iterations=0, solve_time_s=0.0,
                   deficit=(deficit,), marginal_cost_wh_per_k=math.nan)


def _optimum(trip: Trip, goal: Goal, runs: Sequence[Attempt], deficit: tuple[StepDeficit, ...],
             started: float) -> Optimum:
    """Return the Optimum of the first run, with deficits of the last one; the effort is that of all runs."""
    run, marginal_cost = runs[0] if not deficit else runs[-1], math.nan
    schedule = _schedule(trip, run)
    if schedule.soc[-1] - reserve_soc(trip.vehicle, goal) < SLACK_SOC_TOLERANCE:
        schedule = replace(schedule, held_back=HeldBack.RESERVE)
    if not deficit and goal.charging_planned and run.target_multiplier > 1e-9:
        marginal_cost = run.target_multiplier * ENERGY_SCALE_J / JOULES_PER_WH
    return Optimum(
        plan=finish_plan(trip, goal, schedule, METHOD, started),
        solver_status=runs[0].status,
        iterations=sum(run.iterations for run in runs),
        solve_time_s=sum(run.time_s for run in runs),
        deficit=deficit,
        marginal_cost_wh_per_k=marginal_cost)


def _find_deficits(trip: Trip, found: dict[str, FloatArray]) -> Iterator[StepDeficit]:
    """Yield the deficits of a solution."""
    # Demands at the first instant have no deficit.
    soc, short_soc, above_soc = found['soc'], found['deficit_soc'][1:], found['soc_above'][1:]
    target_k, short_w = float(found['deficit_k'][0] + found['excess_k'][0]), found['deficit_w']
    if target_k > TOLERANCE_K:
        yield StepDeficit(TARGET, target_k, 'K', f'target temperature: missed by {target_k:.2f} K')
    if short_soc[-1] > SLACK_SOC_TOLERANCE:
        percent = 100.0 * float(short_soc[-1])
        yield StepDeficit(ARRIVAL_SOC, percent, '%',
                          f'state of charge on arrival: {percent:.2f} % short')
    # A battery that is emptiest on arrival has been reported above. The range of temperatures may be relaxed, so
    # that it has no slack.
    for constraint, unit, scale, tolerance, excess, end, sentence in (
            (LOWEST_SOC, '%', 100.0, SLACK_SOC_TOLERANCE, np.where(soc[1:] < soc[-1], short_soc, 0.0), 1,
             'state of charge: {0:.2f} % below its range at {2:.0f} s'),
            (DISCHARGE_POWER, 'W', 1.0, TOLERANCE_W, short_w, 0,
             'discharge power: {1:.2f} kW cannot be delivered at {2:.0f} s'),
            (HIGHEST_SOC, '%', 100.0, SLACK_SOC_TOLERANCE, above_soc, 1,
             'state of charge: {0:.2f} % above its range at {2:.0f} s'),
            (HIGHEST_TEMPERATURE, 'K', 1.0, TOLERANCE_K,
             found['temperature'][1:] - trip.vehicle.battery.temperature_range_c[1], 1,
             'battery temperature: {0:.2f} K above its range at {2:.0f} s')):
        at = int(np.argmax(excess))
        if excess[at] > tolerance:
            amount = scale * float(excess[at])
            yield StepDeficit(constraint, amount, unit, sentence.format(
                amount, amount / 1e3, trip.time_s[at + end]))


def _schedule(trip: Trip, run: Attempt) -> Schedule:
    found = run.values
    # After scaling back, a power at its bound may exceed the bound by the last bit.
    heater_w = np.clip(found['heater'], 0.0, trip.heater_limit_w)
    drawn_w = heater_w
    for source in trip.vehicle.heat_sources:
        source_w = found[power_row(source)]
        drawn_w = drawn_w + source_w
        heater_w = heater_w + source_w * source.hvch_watts.function(ARRAYS)(
            trip.route.ambient_temperature_c, found['temperature'][:-1])
    brake_w = np.clip(found['brake'], 0.0, np.maximum(-trip.route.propulsion_power_w, 0.0))
    if trip.vehicle.heat_sources:
        # The program's own mix, not that of plans.
        states = found['soc'], found['temperature'], np.append(0.0, heater_w), found['coolant_excess']
        mixed = along_states(trip, states, heater_w, brake_w, switched_on_s(trip, heater_w))
        assert mixed.heat is not None
        return replace(mixed, heat=replace(mixed.heat, drawn_power_w=drawn_w))
    if not trip.vehicle.heat_path.is_direct:
        states = found['soc'], found['temperature'], found['heater_power'], found['coolant_excess']
        return along_states(trip, states, heater_w, brake_w, switched_on_s(trip, heater_w))
    return Schedule(switched_on_s(trip, heater_w), heater_w, brake_w, found['soc'], found['temperature'],
                    make_runge_kutta_4)
