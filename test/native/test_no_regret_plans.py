# SPDX-License-Identifier: Apache-2.0
"""Plans held back by a reserve or by a power deficit: a single call of the core compared with Python's search."""

from collections import Counter
from ctypes import addressof
from dataclasses import replace
import math

import drawn_situations
import numpy as np
import pytest
from test_early_heating import assert_same

from bev_preheat.native.library import core, without_core
from bev_preheat.native.structs import room, SafeGoalStruct, SafePlanStruct
from bev_preheat.planning import planner
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.no_regret import checked_by_core
from bev_preheat.planning.planner import plan_preheating, plan_unheated, plan_without_heating
from bev_preheat.planning.rows import states_of
from bev_preheat.planning.schedule import HeldBack
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.uncertainty_margin import UncertaintyMargin
from bev_preheat.route import load_route
from bev_preheat.vehicle.heat_path import HeatPath

BAD_ARGUMENT, BAD_INPUT = -1, -3


def draw(number, most_steps):
    """Return (trip, state, goal, Caution) of a situation in which charge or power may not be enough."""
    vehicle, route, state, goal, _, _ = drawn_situations.draw(number, most_steps)
    uncertainty_margin, share, lag_s = drawn_situations.draw_margin(number)
    random = np.random.default_rng([31, number])
    trip = make_trip(vehicle, route, share, lag_s if vehicle.heat_path.is_direct else 0.0)
    reserve = 0.0
    if random.random() < 0.3:
        state = replace(state, soc=float(random.uniform(0.05, 0.3)))
    else:
        # About the charge left by a plan.
        goal = replace(goal, minimum_arrival_soc=0.0)
        without, heated = (plan(vehicle, route, state, goal).arrival_soc
                           for plan in (plan_unheated, plan_preheating))
        reserve = without + float(random.uniform(-0.2, 1.4)) * (heated - without)
    return (trip, state, replace(goal, minimum_arrival_soc=min(max(reserve, 0.0), 1.0)),
            None if random.random() < 0.4 else uncertainty_margin)


def schedule_of(trip, state, goal, uncertainty_margin):
    """Return the Schedule that the planner makes."""
    return planner.schedule_trip(
        trip, state, goal, planner.built_in_ways('merit_order'), uncertainty_margin, True, {},
        plan_without_heating(trip, state))


def check(numbers, most_steps, monkeypatch):
    """Compare with the search in Python over plans of the core; return how often which kind of plan came."""
    seen = Counter()
    for number in numbers:
        trip, state, goal, uncertainty_margin = draw(number, most_steps)
        unheated = plan_without_heating(trip, state)
        asked = goal if goal.heating_pays else replace(
            goal, target_temperature_c=trip.vehicle.battery.temperature_range_c[0])
        seen['in Python'] += checked_by_core(trip, state, asked, uncertainty_margin, unheated) is None
        found = schedule_of(trip, state, goal, uncertainty_margin)
        with monkeypatch.context() as patched:
            patched.setattr(planner, 'checked_by_core', lambda *arguments: None)
            expected = schedule_of(trip, state, goal, uncertainty_margin)
        assert found.held_back is expected.held_back, number
        assert_same(trip, found, expected, number)
        seen[found.held_back] += 1
        seen['heats less'] += found.held_back is not None and found.heating_start_s is not None
        seen['late'] += found.heat is not None
        seen['stranded'] += found.empty_at_s is not None
    return seen


@pytest.mark.costly
def test_plans_are_held_back_by_the_same(monkeypatch):
    seen = check(range(120), 15, monkeypatch)
    assert seen[HeldBack.RESERVE] > 20 and seen[None] > 20 and seen['heats less'] > 15
    assert seen['late'] > 20 and seen['stranded'] > 0 and seen['in Python'] < 5


def test_a_power_deficit_holds_a_plan_back(monkeypatch):
    seen = check([229, 359, 512, 963], 40, monkeypatch)
    assert seen[HeldBack.POWER] == seen['heats less'] == 4 and not seen['in Python']


@pytest.mark.deep
@pytest.mark.parametrize('part', range(5))
def test_plans_of_5_000_situations_are_held_back_by_the_same(part, monkeypatch):
    assert check(range(1000 * part, 1000 * (part + 1)), 60, monkeypatch)['in Python'] < 20


@pytest.mark.costly
@pytest.mark.parametrize('number', [
    pytest.param(number, marks=[pytest.mark.deep] * (number >= 6)) for number in range(30)])
def test_what_is_held_back_is_what_python_alone_plans(number):
    trip, state, goal, uncertainty_margin = draw(number, 8)
    found = schedule_of(trip, state, goal, uncertainty_margin)
    with without_core():
        assert_same(trip, found, schedule_of(trip, state, goal, uncertainty_margin), number)


def no_regret_call(path):
    """Return the arguments of bev_plan_no_regret over the pass, with a reserve that binds, and their arrays."""
    vehicle = replace(drawn_situations.car('reference'), heat_path=path)
    trip = make_trip(vehicle, load_route('alpine_pass', vehicle.defaults))
    idle_states = states_of(plan_without_heating(trip, BatteryState(-7.0, 0.9)))
    rows, steps = len(idle_states), trip.native.steps
    goal, uncertainty_margin = SafeGoalStruct(25.0, 0.1, 0.737, 0.1), UncertaintyMargin(lead_k=4.0).native
    states, powers_w = np.empty_like(idle_states), np.empty((rows, steps))
    watched = np.full(room('BEV_MERIT_BYTES', steps) + 64, 3, dtype=np.uint8)
    memory = np.full(room('BEV_NO_REGRET_MEMORY', steps) + 64, 7.25)
    order, plan = np.empty(steps, dtype=np.int32), SafePlanStruct()
    arrays = idle_states, states, powers_w, watched, order, memory
    arguments = [native_vehicle(vehicle).address, trip.native.address, addressof(goal),
                 addressof(uncertainty_margin), *(array.ctypes.data for array in arrays), addressof(plan)]
    return arguments, (trip, goal, uncertainty_margin, *arrays, plan)


@pytest.mark.parametrize('path', [HeatPath(), HeatPath(45.0, 16e3, 280.0)], ids=['at once', 'late'])
def test_it_needs_each_argument_but_the_margin_and_no_more_memory_than_it_asks_for(path):
    arguments, kept = no_regret_call(path)
    for missing in range(len(arguments)):
        if missing != 3:
            assert core().bev_plan_no_regret(
                *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing
    *_, states, _, watched, _, memory, plan = kept
    assert core().bev_plan_no_regret(*arguments) == 0
    assert (plan.is_unheated, plan.held_back) == (0, 1) and states[0, -1] == pytest.approx(0.737, abs=2e-5)
    assert (watched[-64:] == 3).all() and (memory[-64:] == 7.25).all()


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_what_is_no_number_is_refused(value):
    for name in ('target_c', 'margin_k', 'reserve_soc', 'lowest_soc', 'lead_k', 'idle'):
        arguments, (_, goal, uncertainty_margin, idle_states, *_) = no_regret_call(HeatPath())
        if name == 'idle':
            idle_states[1, 5] = value
        else:
            setattr(uncertainty_margin if name == 'lead_k' else goal, name, value)
        assert core().bev_plan_no_regret(*arguments) == BAD_INPUT, name
