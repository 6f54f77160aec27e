# SPDX-License-Identifier: Apache-2.0
"""Prices of heat in each step, and what heating elsewhere may save: against runs in which heat is moved."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
import short_stretches

from bev_preheat.native.library import without_core
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.prices import find_prices, is_cheaper_elsewhere
from bev_preheat.planning.switch_methods import plan_optimal_switch
from bev_preheat.planning.trip import make_trip
from bev_preheat.tunables import LEAST_SAVING_WH
from bev_preheat.vehicle.model import make_runge_kutta_4


def planned(number, **drawn):
    """Return (trip, state, goal, its Schedule of one switch) of a situation."""
    vehicle, route, state, goal = short_stretches.draw(number, **drawn)
    trip = make_trip(vehicle, route)
    return trip, state, goal, plan_optimal_switch(trip, state, goal)


def arrival(trip, state, heater_w):
    soc, temperature_c = run_forward(trip, make_runge_kutta_4, state.soc, state.temperature_c, heater_w)
    return float(soc[-1]), float(temperature_c[-1])


def whole_wh(trip, soc):
    """Return the energy of the whole charge at the voltage on arrival."""
    c0, c1, c2, c3 = trip.vehicle.battery.open_circuit_voltage.coefficients_v
    return trip.vehicle.battery.capacity_ah * (c0 + c1 * soc + c2 * soc**2 + c3 * soc**3)


@pytest.mark.parametrize('number', range(4))
def test_prices_are_what_heating_a_step_makes_on_arrival(number):
    trip, state, _, schedule = planned(number)
    prices = find_prices(trip, schedule)
    for k in range(0, len(trip.route), 7):
        ends = []
        for step_w in (0.0, trip.heater_limit_w[k]):
            heater_w = schedule.heater_power_w.copy()
            heater_w[k] = step_w
            ends.append(arrival(trip, state, heater_w))
        (full_soc, cold_c), (less_soc, warm_c) = ends
        assert prices.warmth_k_per_w[k] * trip.heater_limit_w[k] == pytest.approx(warm_c - cold_c, rel=2e-3)
        assert prices.charge_per_w[k] * trip.heater_limit_w[k] == pytest.approx(full_soc - less_soc, rel=2e-3)


@pytest.mark.parametrize('number', range(12))
def test_the_core_has_the_same_prices(number):
    trip, _, _, schedule = planned(number)
    found = find_prices(trip, schedule), is_cheaper_elsewhere(trip, schedule)
    with without_core():
        expected = find_prices(trip, schedule), is_cheaper_elsewhere(trip, schedule)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-9)
    assert found[1] == expected[1]


def test_a_step_that_the_cabin_takes_has_no_price():
    trip, _, _, schedule = planned(3)
    limit_w = trip.heater_limit_w.copy()
    limit_w[5] = 0.0
    prices = find_prices(trip.changed(heater_limit_w=limit_w), schedule)
    assert prices.warmth_k_per_w[5] == prices.charge_per_w[5] == 0.0


def best_of_all_steps(trip, state, target_c):
    """Return the most charge on arrival at a target: all choices of whole steps, and one heated in part."""
    most = 0.0
    for partial in range(len(trip.route)):
        for others in product((0.0, 1.0), repeat=len(trip.route) - 1):
            shares = np.insert(others, partial, 0.0)
            full = np.insert(others, partial, 1.0)
            if not (arrival(trip, state, shares * trip.heater_limit_w)[1] <= target_c
                    <= arrival(trip, state, full * trip.heater_limit_w)[1]):
                continue
            low, high = 0.0, 1.0
            for _ in range(30):
                shares[partial] = 0.5 * (low + high)
                if arrival(trip, state, shares * trip.heater_limit_w)[1] < target_c:
                    low = shares[partial]
                else:
                    high = shares[partial]
            most = max(most, arrival(trip, state, shares * trip.heater_limit_w)[0])
    return most


@pytest.mark.costly
@pytest.mark.parametrize('number', [2, *(pytest.param(number, marks=pytest.mark.deep) for number in (0, 9))])
def test_where_no_step_is_cheaper_no_choice_of_steps_saves_more_than_that(number):
    trip, state, goal, schedule = planned(number, steps=8)
    saved_wh = (best_of_all_steps(trip, state, goal.target_temperature_c) - float(schedule.soc[-1])) * whole_wh(
        trip, float(schedule.soc[-1]))
    assert saved_wh < LEAST_SAVING_WH or is_cheaper_elsewhere(trip, schedule)


def moved_saving_wh(trip, state, schedule):
    """Return the most that moving heat from one step to another saves, at the same arrival temperature."""
    most_wh, here_soc = 0.0, float(schedule.soc[-1])
    heated = np.flatnonzero(schedule.heater_power_w > 0.0)
    for to in np.flatnonzero(schedule.heater_power_w < trip.heater_limit_w)[::3]:
        heater_w = schedule.heater_power_w.copy()
        heater_w[to] = trip.heater_limit_w[to]
        given_w = 0.0
        for k in heated:
            # The latest heat is the cheapest, but near high power; the earliest of the interval is given up.
            low_w, high_w = 0.0, schedule.heater_power_w[k]
            heater_w[k] = 0.0
            if arrival(trip, state, heater_w)[1] > schedule.temperature_c[-1]:
                given_w += high_w
                continue
            for _ in range(30):
                heater_w[k] = 0.5 * (low_w + high_w)
                if arrival(trip, state, heater_w)[1] < schedule.temperature_c[-1]:
                    low_w = heater_w[k]
                else:
                    high_w = heater_w[k]
            break
        most_wh = max(most_wh, (arrival(trip, state, heater_w)[0] - here_soc) * whole_wh(trip, here_soc))
    return most_wh


def test_what_moving_heat_saves_is_known_in_advance():
    situations = [planned(number) for number in range(30)]
    saves = [moved_saving_wh(trip, state, schedule) >= LEAST_SAVING_WH for trip, state, _, schedule in situations]
    known = [is_cheaper_elsewhere(trip, schedule) for trip, _, _, schedule in situations]
    # By an upper bound: it may expect too much, but not too little.
    assert all(is_known for is_known, is_saved in zip(known, saves) if is_saved)
    assert any(saves) and not all(known)


def test_a_plan_heats_where_it_is_cheapest_and_says_so():
    saved = []
    for number in range(60):
        trip, _, _, schedule = planned(number)
        if is_cheaper_elsewhere(trip, schedule):
            situation = short_stretches.draw(number)
            plans = SimpleNamespace(**{method: plan_preheating(*situation, method)
                                       for method in ('optimal_switch', 'value_function')})
            saved.append((plans.optimal_switch.energy_wh.battery_total
                          - plans.value_function.energy_wh.battery_total, plans))
            assert plans.value_function.shortfall_k < 1e-4
    # At worst, as dear as its switch, by what a plan may lie above the optimum (decision 14).
    assert min(saving_wh for saving_wh, _ in saved) > -1.5
    saving_wh, plans = max(saved, key=lambda each: each[0])
    assert saving_wh > 1.0
    assert len(plans.optimal_switch.intervals) == 1 and len(plans.value_function.intervals) == 2
    assert (plans.value_function.heating_start_s == plans.value_function.intervals[0].start_s
            < plans.optimal_switch.heating_start_s)
    assert plans.value_function.arrival_temperature_c == pytest.approx(
        plans.optimal_switch.arrival_temperature_c, abs=1e-4)
