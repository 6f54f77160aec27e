# SPDX-License-Identifier: Apache-2.0
"""Heating that is cheaper before the end of the trip: against small changes, and all choices of steps."""

from ctypes import byref, c_int32
from dataclasses import replace
from itertools import product
import math

import numpy as np
import pytest
import short_stretches

from bev_preheat.native.library import core, without_core
from bev_preheat.native.runs import place
from bev_preheat.native.structs import room
from bev_preheat.planning.cheapest_steps import heat_cheapest, LEAST_SAVING_WH, whole_charge_wh
from bev_preheat.planning.dynamics import native_vehicle, run_forward
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.prices import find_prices
from bev_preheat.planning.situation import Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat.vehicle.model import make_runge_kutta_4

BAD_ARGUMENT, BAD_INPUT = -1, -3


def planned(number, **drawn):
    """Return (trip, state, goal, its Schedule of one switch) of a situation."""
    vehicle, route, state, goal = short_stretches.draw(number, **drawn)
    trip = make_trip(vehicle, route)
    return trip, state, goal, plan_optimal_switch(trip, state, goal)


def saved_wh(trip, schedule, other):
    return float(other.soc[-1] - schedule.soc[-1]) * whole_charge_wh(trip, schedule)


@pytest.mark.parametrize('number', range(4))
def test_prices_are_what_heating_a_step_makes_on_arrival(number):
    trip, state, _, schedule = planned(number)
    prices = find_prices(trip, schedule)
    for k in range(0, len(trip.route), 7):
        ends = []
        for step_w in (0.0, trip.heater_limit_w[k]):
            heater_w = schedule.heater_power_w.copy()
            heater_w[k] = step_w
            ends.append([float(values[-1]) for values in run_forward(
                trip, make_runge_kutta_4, state.soc, state.temperature_c, heater_w)])
        (full_soc, cold_c), (less_soc, warm_c) = ends
        assert prices.warmth_k_per_w[k] * trip.heater_limit_w[k] == pytest.approx(warm_c - cold_c, rel=2e-3)
        assert prices.charge_per_w[k] * trip.heater_limit_w[k] == pytest.approx(full_soc - less_soc, rel=2e-3)


def test_steps_are_put_in_order_of_what_a_kelvin_costs():
    trip, _, _, schedule = planned(3)
    prices = find_prices(trip, schedule)
    order = prices.cheapest_first()
    assert sorted(order) == list(range(len(trip.route)))
    per_k = (prices.charge_per_w / prices.warmth_k_per_w)[order]
    assert (np.diff(per_k) >= 0.0).all()


def test_a_step_that_the_cabin_takes_is_in_no_order():
    trip, _, _, schedule = planned(3)
    limit_w = trip.heater_limit_w.copy()
    limit_w[5] = 0.0
    assert 5 not in find_prices(trip.changed(heater_limit_w=limit_w), schedule).cheapest_first()


@pytest.mark.parametrize('number', [
    2, *(pytest.param(number, marks=pytest.mark.deep) for number in (0, 9))])
def test_of_all_choices_of_steps_none_costs_less(number):
    trip, state, goal, schedule = planned(number, steps=8)
    best = heat_cheapest(trip, schedule, goal.target_temperature_c)
    least = 0.0

    def arrival(shares):
        soc, temperature_c = run_forward(
            trip, make_runge_kutta_4, state.soc, state.temperature_c, shares * trip.heater_limit_w)
        return float(soc[-1]), float(temperature_c[-1])

    for partial in range(8):
        for others in product((0.0, 1.0), repeat=7):
            shares = np.insert(others, partial, 0.0)
            full = np.insert(others, partial, 1.0)
            if not arrival(shares)[1] <= goal.target_temperature_c <= arrival(full)[1]:
                continue
            low, high = 0.0, 1.0
            for _ in range(40):
                shares[partial] = 0.5 * (low + high)
                if arrival(shares)[1] < goal.target_temperature_c:
                    low = shares[partial]
                else:
                    high = shares[partial]
            least = max(least, arrival(shares)[0])
    assert (least - float(best.soc[-1])) * whole_charge_wh(trip, best) <= LEAST_SAVING_WH


def test_it_saves_much_where_one_switch_is_far_from_the_best_and_nothing_else_changes():
    savings_wh = []
    for number in range(120):
        trip, _, goal, schedule = planned(number)
        best = heat_cheapest(trip, schedule, goal.target_temperature_c)
        savings_wh.append(saved_wh(trip, schedule, best))
        assert (best is schedule) == (savings_wh[-1] == 0.0)
        assert best.temperature_c[-1] == pytest.approx(goal.target_temperature_c, abs=5e-6)
        assert ((best.heater_power_w >= 0.0) & (best.heater_power_w <= trip.heater_limit_w)).all()
    assert min(savings_wh) == 0.0 and max(savings_wh) > 3.0
    assert sum(saving_wh > 0.0 for saving_wh in savings_wh) >= 5


def test_what_is_heated_all_the_way_or_not_at_all_stays_as_it_is():
    trip, state, goal, _ = planned(1)
    for target_c in (goal.target_temperature_c - 60.0, 80.0):
        schedule = plan_optimal_switch(trip, state, Goal(target_c))
        assert heat_cheapest(trip, schedule, target_c) is schedule


def test_merit_order_heats_where_it_is_cheapest_and_says_so():
    def saving_wh(number):
        trip, state, goal, switch = planned(number)
        return saved_wh(trip, switch, plan_merit_order(trip, state, goal))

    number = max(range(60), key=saving_wh)
    inputs = short_stretches.draw(number)
    switch, plan = (plan_preheating(*inputs, method) for method in ('optimal_switch', 'merit_order'))
    assert plan.energy_wh.battery_total < switch.energy_wh.battery_total - 1.0
    assert len(switch.intervals) == 1 and len(plan.intervals) == 2
    assert plan.heating_start_s == plan.intervals[0].start_s < switch.heating_start_s
    assert plan.arrival_temperature_c == pytest.approx(switch.arrival_temperature_c, abs=1e-5)


# Leaf by leaf; test/native/test_same_plans.py compares whole plans daily.
@pytest.mark.deep
def test_core_and_python_agree_to_the_last_bit():
    changed = 0
    for number in range(150):
        trip, _, goal, schedule = planned(number)
        found, prices = (heat_cheapest(trip, schedule, goal.target_temperature_c),
                         find_prices(trip, schedule))
        with without_core():
            expected, expected_prices = (heat_cheapest(trip, schedule, goal.target_temperature_c),
                                         find_prices(trip, schedule))
        for name in ('heater_power_w', 'soc', 'temperature_c'):
            assert getattr(found, name).tolist() == getattr(expected, name).tolist(), (number, name)
        assert found.heating_start_s == expected.heating_start_s
        np.testing.assert_allclose(prices.warmth_k_per_w, expected_prices.warmth_k_per_w, rtol=1e-9)
        np.testing.assert_allclose(prices.charge_per_w, expected_prices.charge_per_w, rtol=1e-9)
        changed += found is not schedule
    assert changed >= 5


def call_heat_cheapest(trip, schedule, target_c, null=None, changed=None):
    """Return the status of bev_heat_cheapest; `null` is the argument to pass as a null pointer."""
    steps = trip.native.steps
    arrays = {'soc': schedule.soc.copy(), 'temperature_c': schedule.temperature_c.copy(),
              'heater_w': schedule.heater_power_w.copy(),
              'memory': np.full(room('BEV_CHEAPEST_MEMORY', steps) + 8, 7.25)}
    for name, value in (changed or {}).items():
        arrays[name][0] = value
    order, orders = (c_int32 * (steps + 4))(*[-7] * (steps + 4)), c_int32()
    status = core().bev_heat_cheapest(
        None if null == 'vehicle' else native_vehicle(trip.vehicle).address,
        None if null == 'trip' else trip.native.address, target_c,
        *(None if name == null else place(array) for name, array in arrays.items()),
        None if null == 'order' else order, None if null == 'orders' else byref(orders))
    assert (arrays['memory'][-8:] == 7.25).all() and list(order)[-4:] == [-7] * 4
    return status


@pytest.mark.parametrize('null', [
    'vehicle', 'trip', 'soc', 'temperature_c', 'heater_w', 'memory', 'order', 'orders'])
def test_a_null_pointer_is_refused(null):
    trip, _, goal, schedule = planned(2)
    assert call_heat_cheapest(trip, schedule, goal.target_temperature_c) == 0
    assert call_heat_cheapest(trip, schedule, goal.target_temperature_c, null) == BAD_ARGUMENT


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_refused(number):
    trip, _, goal, schedule = planned(2)
    assert call_heat_cheapest(trip, schedule, number) == BAD_INPUT
    for name in ('soc', 'temperature_c', 'heater_w'):
        assert call_heat_cheapest(
            trip, schedule, goal.target_temperature_c, changed={name: number}) == BAD_INPUT, name


@pytest.mark.parametrize('path', [HeatPath(30.0), HeatPath(0.0, 14e3, 300.0)])
def test_heat_that_arrives_late_is_refused_by_the_core_and_left_as_it_is_by_the_method(path):
    trip, state, goal, schedule = planned(2)
    late = make_trip(replace(trip.vehicle, heat_path=path), trip.route)
    assert call_heat_cheapest(late, schedule, goal.target_temperature_c) == BAD_ARGUMENT
    plan, switch = (method(late, state, goal) for method in (plan_merit_order, plan_optimal_switch))
    assert plan.heating_start_s == switch.heating_start_s


def test_a_trip_of_one_step_is_heated_in_it():
    trip, state, _, _ = planned(2, steps=1)
    target_c = state.temperature_c + 0.2
    schedule = plan_optimal_switch(trip, state, Goal(target_c))
    assert heat_cheapest(trip, schedule, target_c) is schedule
