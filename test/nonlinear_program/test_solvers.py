# SPDX-License-Identifier: Apache-2.0
"""Which solver answers, from which start, and which answers of FATROP are rejected."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from bev_preheat.nonlinear_program import attempt as attempts
from bev_preheat.nonlinear_program.attempt import Problem, SUCCESS
from bev_preheat.nonlinear_program.program import build_program, Give
from bev_preheat.nonlinear_program.program_solvers import FATROP, IPOPT
from bev_preheat.nonlinear_program.solve import solve_optimum
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.variants import Corrections

pytestmark = [pytest.mark.costly, pytest.mark.needs('casadi')]

REFERENCE = load_vehicle('reference')
# Level, then downhill with a battery too cold for the regeneration, then level.
ROUTE = make_route({
    'duration_s': [60.0], 'speed_mps': [20.0], 'ambient_temperature_c': [-11.0],
    'propulsion_power_w': [15e3] * 6 + [-28e3] * 8 + [13e3] * 9}, REFERENCE.defaults)
STATE, GOAL = BatteryState(-11.0, 0.82), Goal(9.0)
SITUATION = REFERENCE, ROUTE, STATE, GOAL
has_fatrop = pytest.mark.skipif(not casadi.has_nlpsol('fatrop'), reason='this CasADi has no FATROP')


@pytest.fixture(scope='module')
def problem():
    return Problem(REFERENCE, Corrections(), make_trip(REFERENCE, ROUTE), STATE, GOAL)


@pytest.fixture(scope='module')
def optimum():
    return solve_optimum(*SITUATION)


@has_fatrop
def test_the_result_says_that_fatrop_answered(optimum):
    assert (optimum.solver, optimum.solver_status) == (FATROP, SUCCESS)
    assert optimum.as_dictionary()['solver'] == FATROP
    # Limits are active here: the friction brake takes part.
    assert optimum.plan.friction_brake_power_w.max() > 100.0


def test_without_fatrop_ipopt_finds_the_same(optimum, monkeypatch):
    monkeypatch.setattr(attempts, 'has_fatrop', lambda: False)
    other = solve_optimum(*SITUATION)
    assert (other.solver, other.solver_status) == (IPOPT, SUCCESS)
    assert other.plan.energy_wh.battery_total == pytest.approx(
        optimum.plan.energy_wh.battery_total, abs=1e-4)
    np.testing.assert_allclose(other.plan.battery_temperature_c, optimum.plan.battery_temperature_c,
                               atol=1e-4)
    assert other.marginal_cost_wh_per_k == pytest.approx(optimum.marginal_cost_wh_per_k, rel=1e-4)


@has_fatrop
def test_where_an_answer_of_fatrop_is_not_sound_ipopt_is_asked(optimum, monkeypatch):
    monkeypatch.setattr(attempts, 'is_sound', lambda *arguments: False)
    other = solve_optimum(*SITUATION)
    assert (other.solver, other.solver_status) == (IPOPT, SUCCESS)
    # FATROP's unsuccessful effort counts, too.
    assert other.iterations > optimum.iterations


def bounded(problem):
    """Program, parameters, and a point within its bounds: the trip unheated, with the brake."""
    program = build_program(REFERENCE, len(ROUTE), True, Give.NOTHING)
    point = program.variables.pack(attempts.driven_start(
        drive_as_planned(problem.trip, STATE, np.zeros(len(ROUTE)))))
    goal = replace(GOAL, target_temperature_c=-30.0)
    return (program, attempts.parameters_of(replace(problem, goal=goal)), point,
            [point - 0.5, point + 0.5],
            [program.constraints.pack(values) for values in attempts.constraint_bounds(problem)])


def test_an_answer_that_keeps_everything_is_sound(problem):
    program, parameters, point, bounds, bounds_g = bounded(problem)
    assert attempts.is_sound(program, parameters, point, point, bounds, bounds_g)


@pytest.mark.parametrize('name, change', [
    ('soc', 1e-6), ('heater', 1e-3), ('temperature', np.nan)])
def test_an_answer_that_leaves_a_step_open_is_not_sound(problem, name, change):
    program, parameters, point, bounds, bounds_g = bounded(problem)
    found = point.copy()
    found[program.variables.places[name][4]] += change
    assert not attempts.is_sound(program, parameters, point, found, bounds, bounds_g)


def test_an_answer_beyond_its_bounds_is_not_sound(problem):
    program, parameters, point, bounds, bounds_g = bounded(problem)
    assert not attempts.is_sound(
        program, parameters, point, point, [point + 1e-6, bounds[1]], bounds_g)


def test_an_answer_that_costs_more_than_its_start_is_not_sound(problem):
    program, parameters, point, bounds, bounds_g = bounded(problem)
    heated = program.variables.pack(attempts.heated_start(problem))
    wide = [np.minimum(point, heated) - 1.0, np.maximum(point, heated) + 1.0]
    assert attempts.is_sound(program, parameters, heated, heated, wide, bounds_g)
    assert attempts.is_sound(program, parameters, heated, point, wide, bounds_g)
    assert not attempts.is_sound(program, parameters, point, heated, wide, bounds_g)


def made_run(monkeypatch, outcomes):
    """Make `_run` return outcomes, (status, energy) by (solver, start), and record the calls."""
    calls = []

    def run(problem, program, solver, guess):
        start = round(float(program.variables.unpack(guess)['heater'][0]))
        calls.append((solver, start))
        status, energy = outcomes[solver, start]
        return attempts.Attempt(program, guess, energy, 0.0, solver, status, 7, 0.25)

    monkeypatch.setattr(attempts, '_run', run)
    monkeypatch.setattr(attempts, 'has_fatrop', lambda: True)
    return calls


@pytest.fixture
def starts(problem):
    return [{**attempts.unheated_start(problem), 'heater': heater_w} for heater_w in (1.0, 2.0)]


def test_the_better_of_two_starts_counts(problem, starts, monkeypatch):
    calls = made_run(monkeypatch, {(FATROP, 1): (SUCCESS, 4.0), (FATROP, 2): (SUCCESS, 3.0)})
    best = attempts.attempt(problem, True, starts=starts)
    assert (best.energy, best.iterations, best.time_s) == (3.0, 14, 0.5)
    assert calls == [(FATROP, 1), (FATROP, 2)]


def test_a_start_that_fails_is_left_out(problem, starts, monkeypatch):
    made_run(monkeypatch, {(FATROP, 1): (SUCCESS, 4.0), (FATROP, 2): ('lost', 3.0)})
    best = attempts.attempt(problem, True, starts=starts)
    assert (best.energy, best.status) == (4.0, SUCCESS)


def test_ipopt_says_once_that_there_is_no_solution(problem, starts, monkeypatch):
    calls = made_run(monkeypatch, {
        (FATROP, 1): ('lost', 4.0), (FATROP, 2): ('lost', 3.0), (IPOPT, 1): ('none', 5.0)})
    failed = attempts.attempt(problem, True, starts=starts)
    assert (failed.solver, failed.status) == (IPOPT, 'none')
    assert calls == [(FATROP, 1), (FATROP, 2), (IPOPT, 1)]


def test_long_routes_are_for_ipopt(problem):
    long_trip = make_trip(REFERENCE, ROUTE.divided(1.0))
    assert attempts.available_solvers(long_trip) == (IPOPT,)
    assert attempts.available_solvers(problem.trip, Give.DEMANDS) == (IPOPT,)
