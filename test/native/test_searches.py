# SPDX-License-Identifier: Apache-2.0
"""Searches of the native core compared with Python's, and their refusals."""

from ctypes import addressof, byref
from dataclasses import replace

import drawn_situations
import numpy as np
import pytest
import short_stretches

from bev_preheat.native import library as library_module
from bev_preheat.native import searches
from bev_preheat.native.library import core, core_in_words, without_core
from bev_preheat.native.runs import Heating
from bev_preheat.native.structs import (
    CurveRangeStruct,
    MeritPlanStruct,
    room,
    ROOMS,
    SettlingStruct,
    StrandingStruct,
)
from bev_preheat.planning import merit_order
from bev_preheat.planning.charge_acceptance import find_acceptance_loss, no_acceptance_loss
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.limits import drive_as_planned, limits_hold, run_unheated, watch_limits
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.strides import make_strides
from bev_preheat.planning.threshold_search import ThresholdSearch
from bev_preheat.planning.thresholds import find_thresholds
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip, draw_trip

PATHS = HeatPath(), HeatPath(40.0), HeatPath(0.0, 15e3, 300.0), HeatPath(45.0, 16e3, 280.0)
# What Python's and the core's searches differ by where a sum is taken in another order.
SAME = {'rtol': 1e-9, 'atol': 1e-7}
BAD_ARGUMENT, BAD_INPUT = -1, -3


def situation(number):
    """Return (trip, state, goal) in which limits matter, each second one with a heat path."""
    drawn = draw_limit_trip(drawn_situations.car('reference'), 15, number)
    path = PATHS[number // 2 % len(PATHS)] if number % 2 else HeatPath()
    return make_trip(replace(drawn.vehicle, heat_path=path), drawn.route), drawn.state, drawn.goal


def assert_same_schedule(found, expected):
    for name in ('soc', 'temperature_c', 'heater_power_w', 'brake_power_w'):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), **SAME)
    assert found.heating_start_s == pytest.approx(expected.heating_start_s, abs=1e-3)
    assert found.heating_end_s == expected.heating_end_s
    assert (found.heat is None) == (expected.heat is None)
    if found.heat is not None:
        for name in ('heater_power_w', 'coolant_excess_k', 'drawn_power_w', 'arriving_heat_w'):
            np.testing.assert_allclose(getattr(found.heat, name), getattr(expected.heat, name), **SAME)


def threshold_search(number):
    """Return a ThresholdSearch of a situation, and its goal."""
    trip, state, goal = situation(number)
    run = run_unheated(trip, state)
    watch = watch_limits(trip, run.soc, run.temperature_c)
    lumped = replace(trip, vehicle=replace(trip.vehicle, heat_path=HeatPath()))
    loss = no_acceptance_loss(trip).blended(find_acceptance_loss(trip, watch, run))
    thresholds = find_thresholds(lumped, watch, run, goal.target_temperature_c, loss)
    return ThresholdSearch(trip, state, watch, thresholds, trip.heater_limit_w), goal


# One case daily, as no whole plan calls this search of the core alone.
@pytest.mark.parametrize('serves_climbs', [True, pytest.param(False, marks=pytest.mark.deep)])
@pytest.mark.parametrize('number', [
    4, *(pytest.param(number, marks=pytest.mark.deep) for number in (1, 7, 8, 9, 11))])
def test_thresholds_are_moved_by_the_same(number, serves_climbs, monkeypatch):
    search, goal = threshold_search(number)
    with monkeypatch.context() as patched:
        # It is the core that answers.
        patched.setattr(ThresholdSearch, '_settled', None)
        found = search.settle(goal.target_temperature_c, serves_climbs)
    with without_core():
        assert_same_schedule(found, search.settle(goal.target_temperature_c, serves_climbs))


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('number', [1, 2, 4, 6, 7, 9, 11, 13])
def test_heating_by_merit_is_the_same(number, monkeypatch):
    trip, state, goal = situation(number)
    with monkeypatch.context() as patched:
        # It is the core that answers.
        patched.setattr(merit_order, '_passes', None)
        found = plan_merit_order(trip, state, goal)
    with without_core():
        assert_same_schedule(found, plan_merit_order(trip, state, goal))


# Their charge runs out in the second half of the trip, with the heating of the first plan and without any.
# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('number, soc', [(1, 0.3), (3, 0.2), (5, 0.05)])
def test_heating_by_merit_is_the_same_where_the_charge_runs_out(number, soc, monkeypatch):
    trip, state, goal = situation(number)
    nearly_empty = replace(state, soc=soc)
    with monkeypatch.context() as patched:
        patched.setattr(merit_order, '_passes', None)
        found = plan_merit_order(trip, nearly_empty, goal)
    with without_core():
        expected = plan_merit_order(trip, nearly_empty, goal)
    assert_same_schedule(found, expected)
    assert found.empty_at_s == pytest.approx(expected.empty_at_s, abs=1e-6)
    np.testing.assert_allclose(found.driven_share, expected.driven_share, atol=1e-12)


def settling_call(number=4, **changes):
    """Return the arguments of bev_settle for a situation, in a dictionary, and the arrays behind them."""
    (search, goal), asked = threshold_search(number), []
    with pytest.MonkeyPatch.context() as patched:
        # The call as the search makes it.
        patched.setattr(searches, 'settle', lambda *arguments: asked.append(arguments))
        search.settle(goal.target_temperature_c)
    (_, native_trip, heating, _, start), = asked
    trip, _, _ = situation(number)
    states, powers_w = np.empty((2, len(trip.route) + 1)), np.empty((2, len(trip.route)))
    states[:, 0] = start
    memory = np.empty(room('BEV_SETTLE_MEMORY', len(trip.route)))
    goal = SettlingStruct(True, goal.target_temperature_c)
    stranding = StrandingStruct()
    kept = native_trip, heating, states, powers_w, memory, goal, stranding, trip
    return {'vehicle': native_vehicle(trip.vehicle).address, 'trip': native_trip.address,
            'heating': addressof(heating.struct), 'goal': addressof(goal),
            'states': states.ctypes.data, 'powers_w': powers_w.ctypes.data,
            'stranding': addressof(stranding),
            'memory': memory.ctypes.data} | changes, kept


@pytest.mark.parametrize('name', ['vehicle', 'trip', 'heating', 'goal', 'states', 'powers_w', 'stranding',
                                  'memory'])
def test_a_search_without_an_argument_is_refused(name):
    arguments, _ = settling_call(**{name: None})
    assert core().bev_settle(*arguments.values()) == BAD_ARGUMENT


def test_a_search_without_thresholds_is_refused():
    arguments, kept = settling_call()
    trip = kept[-1]
    steps = np.ones(len(trip.route), dtype=bool)
    heating = Heating(trip.heater_limit_w, None, steps, steps, True)
    arguments['heating'] = addressof(heating.struct)
    assert core().bev_settle(*arguments.values()) == BAD_ARGUMENT


@pytest.mark.parametrize('value', [np.nan, np.inf])
def test_a_search_from_what_is_no_number_is_refused(value):
    arguments, kept = settling_call()
    states, goal = kept[2], kept[5]
    assert core().bev_settle(*arguments.values()) == 0
    states[1, 0] = value
    assert core().bev_settle(*arguments.values()) == BAD_INPUT
    states[1, 0] = 3.0
    goal.target_c = value
    assert core().bev_settle(*arguments.values()) == BAD_INPUT


def test_a_search_says_where_the_charge_runs_out():
    arguments, kept = settling_call()
    states, stranding = kept[2], kept[6]
    assert core().bev_settle(*arguments.values()) == 0 and stranding.step == -1
    states[0, 0] = 0.001
    assert core().bev_settle(*arguments.values()) == 0
    assert 0 <= stranding.step < 3 and 0.0 < stranding.driven_share < 1.0
    assert (states[0, stranding.step + 1:] == 0.0).all()


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('number', [1, 3, 5])
def test_a_run_whose_charge_runs_out_ends_the_same(number):
    trip, state, _ = situation(number)
    nearly_empty = replace(state, soc=0.1)
    found = run_unheated(trip, nearly_empty)
    with without_core():
        expected = run_unheated(trip, nearly_empty)
    assert_same_schedule(found, expected)
    assert found.empty_at_s == pytest.approx(expected.empty_at_s, abs=1e-9)


@pytest.mark.parametrize('step, value', [(-1, 0.5), (10**6, 0.5), (3, np.nan)])
def test_standing_from_where_it_makes_no_sense_is_refused(step, value):
    trip, *_ = situation(4)
    states, powers_w = np.full((2, len(trip.route) + 1), value), np.zeros((2, len(trip.route)))
    stranding = StrandingStruct(step)
    assert core().bev_stand(
        native_vehicle(trip.vehicle).address, trip.native.address,
        states.ctypes.data, powers_w.ctypes.data,
        byref(stranding)) == (BAD_ARGUMENT if value == 0.5 else BAD_INPUT)


def merit_call():
    """Return the arguments of bev_merit_order for a situation, and the arrays behind them."""
    trip, state, goal = situation(4)
    steps = len(trip.route)
    run = run_unheated(trip, state)
    states = np.array((run.soc, run.temperature_c))
    powers_w = np.array((run.heater_power_w, run.brake_power_w))
    settling = SettlingStruct(True, goal.target_temperature_c)
    stranding, watched = StrandingStruct(), np.empty((ROOMS['BEV_MERIT_BYTES'][0], steps), dtype=bool)
    memory = np.empty(room('BEV_MERIT_MEMORY', steps))
    vehicle = native_vehicle(trip.vehicle).address
    return [vehicle, vehicle, trip.native.address, addressof(settling),
            trip.heater_limit_w.ctypes.data, states.ctypes.data, powers_w.ctypes.data,
            addressof(stranding), watched.ctypes.data, memory.ctypes.data], (
                trip, states, powers_w, settling, stranding, watched, memory)


def test_heating_by_merit_without_an_argument_is_refused():
    arguments, kept = merit_call()
    for missing in range(len(arguments)):
        assert core().bev_merit_order(
            *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing
    assert core().bev_merit_order(*arguments) == 0
    kept[1][0, 5] = np.nan
    assert core().bev_merit_order(*arguments) == BAD_INPUT


def test_nothing_is_written_beyond_the_memory_that_is_asked_for():
    arguments, kept = merit_call()
    *_, watched, memory = kept
    guarded, guarded_bytes = np.full(len(memory) + 64, 7.25), np.full(watched.size + 64, 3, dtype=np.uint8)
    arguments[-2:] = guarded_bytes.ctypes.data, guarded.ctypes.data
    assert core().bev_merit_order(*arguments) == 0
    assert (guarded[len(memory):] == 7.25).all() and (guarded_bytes[watched.size:] == 3).all()


def rows_of(schedule):
    """Return states (S, N + 1) and powers (S, N) of a Schedule, as the core has them."""
    states, powers_w = (schedule.soc, schedule.temperature_c), (schedule.heater_power_w, schedule.brake_power_w)
    if schedule.heat is not None:
        states += schedule.heat.heater_power_w, schedule.heat.coolant_excess_k
        powers_w += schedule.heat.drawn_power_w, schedule.heat.arriving_heat_w
    return np.array(states), np.array(powers_w)


def merit_plan(trip, state, goal):
    """Return the core's whole plan by merit order."""
    idle_states, _ = rows_of(plan_without_heating(trip, state))
    return searches.plan_merit_order(
        native_vehicle(trip.vehicle), trip.native, SettlingStruct(True, goal.target_temperature_c),
        idle_states)


# In the odd ones heat arrives late. Of the last ones the charge runs out on the way, or, with a target of
# -20 degC, nothing is paid for.
@pytest.mark.parametrize('number, soc, target_c', [
    (4, None, None), (7, None, None), (4, 0.05, None), (7, None, -20.0), *(
        pytest.param(*case, marks=pytest.mark.deep) for case in (
            *((number, None, None) for number in (1, 2, 6, 9, 11, 13)),
            (1, 0.3, None), (5, 0.05, None), (4, None, -20.0)))])
def test_the_whole_plan_by_merit_is_the_same(number, soc, target_c):
    trip, state, goal = situation(number)
    state = replace(state, soc=soc or state.soc)
    goal = goal if target_c is None else replace(goal, target_temperature_c=target_c)
    found = merit_plan(trip, state, goal)
    with without_core():
        expected = plan_merit_order(trip, state, goal)
    for rows, expected_rows in zip((found.states, found.powers_w), rows_of(expected), strict=True):
        np.testing.assert_allclose(rows, expected_rows, **SAME)
    assert found.start_s == pytest.approx(expected.heating_start_s, abs=1e-3)
    assert found.end_s == pytest.approx(expected.heating_end_s, abs=1e-3)
    if expected.empty_at_s is None:
        assert found.stranded is None
    else:
        step, share = found.stranded
        empty_at_s = trip.time_s[step] + share * trip.route.duration_s[step]
        assert empty_at_s == pytest.approx(expected.empty_at_s, abs=1e-6)


@pytest.mark.parametrize('number', [6, 8])
def test_without_an_active_limit_the_whole_plan_is_one_interval(number):
    drawn = draw_trip(drawn_situations.car('reference'), 15, number)
    for path in PATHS:
        trip = make_trip(replace(drawn.vehicle, heat_path=path), drawn.route)
        found = merit_plan(trip, drawn.state, drawn.goal)
        with without_core():
            expected = plan_merit_order(trip, drawn.state, drawn.goal)
        assert limits_hold(trip, expected) and expected.heating_start_s is not None
        for rows, expected_rows in zip((found.states, found.powers_w), rows_of(expected), strict=True):
            np.testing.assert_allclose(rows, expected_rows, **SAME)
        assert (found.start_s, found.end_s) == (
            pytest.approx(expected.heating_start_s, abs=1e-6), pytest.approx(expected.heating_end_s, abs=1e-6))


def test_where_heating_is_cheaper_elsewhere_the_whole_plan_heats_there():
    changed = 0
    for number in range(12):
        vehicle, route, state, goal = short_stretches.draw(number)
        trip = make_trip(vehicle, route)
        found = merit_plan(trip, state, goal)
        with without_core():
            expected = plan_merit_order(trip, state, goal)
            changed += expected.heating_start_s != plan_optimal_switch(trip, state, goal).heating_start_s
        for rows, expected_rows in zip((found.states, found.powers_w), rows_of(expected), strict=True):
            np.testing.assert_allclose(rows, expected_rows, **SAME)
        assert found.start_s == pytest.approx(expected.heating_start_s, abs=1e-6) and found.end_s is None
    assert changed > 1


def merit_plan_call(number):
    """Return the arguments of bev_plan_merit_order for a situation, and the arrays behind them."""
    trip, state, goal = situation(number)
    idle_states, powers_w = rows_of(plan_without_heating(trip, state))
    steps = trip.native.steps
    settling, plan = SettlingStruct(True, goal.target_temperature_c), MeritPlanStruct()
    states, watched = np.empty_like(idle_states), np.full(room('BEV_MERIT_BYTES', steps) + 64, 3, dtype=np.uint8)
    order = np.empty(steps, dtype=np.int32)
    memory = np.full(room('BEV_MERIT_PLAN_MEMORY', steps) + 64, 7.25)
    return [native_vehicle(trip.vehicle).address, trip.native.address, addressof(settling),
            *(array.ctypes.data for array in (idle_states, states, powers_w, watched, order, memory)),
            addressof(plan)], (trip, idle_states, states, powers_w, settling, plan, order, watched, memory)


@pytest.mark.parametrize('number', [4, 7])
def test_the_whole_plan_by_merit_needs_each_argument_and_no_more_memory_than_it_asks_for(number):
    arguments, kept = merit_plan_call(number)
    for missing in range(len(arguments)):
        assert core().bev_plan_merit_order(
            *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing
    assert core().bev_plan_merit_order(*arguments) == 0
    assert (kept[-1][-64:] == 7.25).all() and (kept[-2][-64:] == 3).all()
    kept[1][0, 5] = np.nan
    assert core().bev_plan_merit_order(*arguments) == BAD_INPUT


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('number, soc', [(4, None), (7, None), (1, 0.3), (4, 0.05)])
def test_commands_are_driven_as_in_python(number, soc):
    trip, state, _ = situation(number)
    state = replace(state, soc=soc or state.soc)
    steps = trip.native.steps
    command_w = np.where(np.arange(steps) % 3 == 0, trip.heater_limit_w, 0.0)
    with without_core():
        expected = drive_as_planned(trip, state, command_w, take_surplus=True)
    expected_states, expected_w = rows_of(expected)
    states, powers_w = np.full_like(expected_states, np.nan), np.full_like(expected_w, np.nan)
    states[:, 0] = expected_states[:, 0]
    watched, stranding = np.empty(2 * steps, dtype=np.uint8), StrandingStruct()
    arguments = [native_vehicle(trip.vehicle).address, trip.native.address,
                 *(array.ctypes.data for array in (command_w, states, powers_w, watched)), addressof(stranding)]
    assert core().bev_drive_as_planned(*arguments) == 0
    np.testing.assert_allclose(states, expected_states, **SAME)
    np.testing.assert_allclose(powers_w, expected_w, **SAME)
    assert (stranding.step < 0) == (expected.empty_at_s is None)
    np.testing.assert_array_equal(watched[:steps], trip.route.propulsion_power_w < 0.0)
    assert (watched[steps:] == 1).all()
    for missing in range(len(arguments)):
        assert core().bev_drive_as_planned(
            *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing


def test_a_grid_of_too_few_or_too_many_points_is_refused():
    trip, state, _ = situation(4)
    run = run_unheated(trip, state)
    watch = watch_limits(trip, run.soc, run.temperature_c)
    strides = make_strides(trip, watch, run, no_acceptance_loss(trip), 20.0)
    limited = strides.may_overcharge | strides.may_overdraw
    vehicle = native_vehicle(trip.vehicle)
    ends = 20.0, -20.0, 40.0, 30.0, 30.0
    for points, is_taken in ((4, False), (5, True), (512, True), (513, False)):
        bands_c = searches.find_bands(
            vehicle, vars(strides), limited, False, np.linspace(-30.0, 50.0, points), *ends)
        assert (bands_c is not None) == is_taken
    falling = np.linspace(50.0, -30.0, 60)
    assert searches.find_bands(vehicle, vars(strides), limited, False, falling, *ends) is None
    assert searches.find_bands(
        vehicle, vars(strides), limited, False, falling[::-1], np.nan, *ends[1:]) is None


def test_a_library_with_other_structs_is_not_used(monkeypatch):
    class Wider(CurveRangeStruct):
        _fields_ = [('more', CurveRangeStruct)]

    path = core_in_words().removeprefix('used: ')
    monkeypatch.setattr(library_module, 'CurveRangeStruct', Wider)
    assert library_module.load_core(path) == (None, f'{path} is of another version')
    assert byref(Wider())
