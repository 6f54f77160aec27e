# SPDX-License-Identifier: Apache-2.0
"""
Method `value_function`: near the program's optimum, the same in C and Python, no worse than trying everything.

If not everything can be had, it gives up first the target, then the power of climbs, last the reserve.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from bev_preheat.native.library import without_core
from bev_preheat.planning.limits import drive_as_planned, run_unheated
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.value_function import plan_by_values
from bev_preheat.route import load_route, make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

VEHICLE = load_vehicle('reference')


def planned(trip, method='value_function', **changes):
    goal = replace(trip.goal, **changes)
    return plan_preheating(trip.vehicle, trip.route, trip.state, goal, method)


def total_wh(plan):
    """Energy with the heat missing at the target, so that plans with different shortfalls compare."""
    per_k = VEHICLE.battery.heat_capacity_j_per_k / VEHICLE.hvch.efficiency / 3600.0
    return plan.energy_wh.battery_total + plan.shortfall_k * per_k


# Descents that pay for heat, climbs, free heat that opens the charge limit, a reserve: trips of seed 1.
@pytest.mark.costly
@pytest.mark.needs('casadi')
@pytest.mark.parametrize('number', [79, pytest.param(0, marks=pytest.mark.deep), pytest.param(
    37, marks=pytest.mark.deep), pytest.param(123, marks=pytest.mark.deep)])
def test_it_costs_what_the_program_costs(number):
    from bev_preheat.nonlinear_program.solve import solve_optimum
    trip = draw_limit_trip(VEHICLE, 1, number)
    optimum = solve_optimum(trip.vehicle, trip.route, trip.state, trip.goal).plan
    plan = planned(trip)
    assert total_wh(plan) < total_wh(optimum) + 1.0
    assert plan.shortfall_k < 1e-4
    # There the default method is dearer, so this is no trip on which all methods agree.
    assert total_wh(plan) < total_wh(planned(trip, 'merit_order')) - 5.0


@pytest.mark.deep
@pytest.mark.parametrize('number', [3, 10, 46, 50])
def test_core_and_python_plan_the_same(number):
    """Limits at the end of a step are found in another way; so energies agree, not bits."""
    trip = draw_limit_trip(VEHICLE, 1, number)
    plan = planned(trip)
    with without_core():
        python = planned(trip)
    assert python.status is plan.status
    assert total_wh(python) == pytest.approx(total_wh(plan), abs=0.05)
    assert python.arrival_temperature_c == pytest.approx(plan.arrival_temperature_c, abs=1e-3)


@pytest.mark.deep
def test_with_a_heat_path_core_and_python_plan_the_same():
    trip = draw_limit_trip(VEHICLE, 3, 7)
    trip = replace(trip, vehicle=replace(VEHICLE, heat_path=HeatPath(40.0, 15e3, 150.0)))
    plan = planned(trip)
    with without_core():
        python = planned(trip)
    assert python.status is plan.status is Status.WAITING
    assert total_wh(python) == pytest.approx(total_wh(plan), abs=0.5)


def short_descent():
    """Return a route with a descent that the cold battery may not take."""
    return make_route({
        'duration_s': np.full(8, 120.0), 'speed_mps': np.full(8, 20.0),
        'propulsion_power_w': [14e3, 14e3, -48e3, -52e3, -52e3, 12e3, 12e3, 12e3],
        'ambient_temperature_c': np.full(8, -12.0), 'cabin_heating_power_w': np.full(8, 500.0)}, VEHICLE.defaults)


@pytest.mark.parametrize('heat_path', [HeatPath(), HeatPath(40.0, 15e3, 150.0)])
def test_on_a_short_descent_core_and_python_plan_the_same(heat_path):
    vehicle = replace(VEHICLE, heat_path=heat_path)
    trip, state, goal = make_trip(vehicle, short_descent()), BatteryState(-9.0, 0.8), Goal(4.0)
    schedule = plan_by_values(trip, state, goal)
    with without_core():
        python = plan_by_values(trip, state, goal)
    assert schedule.heater_power_w.max() > 1e3
    assert python.temperature_c == pytest.approx(schedule.temperature_c, abs=0.01)
    assert python.soc[-1] == pytest.approx(schedule.soc[-1], abs=1e-6)


@pytest.mark.parametrize('target_c', [2.0, 6.0])
def test_nothing_else_that_can_be_switched_costs_less(target_c):
    """Every pattern of off, half and full power is driven."""
    state, goal = BatteryState(-9.0, 0.8), Goal(target_c)
    trip = make_trip(VEHICLE, short_descent())
    mine = plan_by_values(trip, state, goal)

    def cost_wh(schedule):
        capacity_wh = VEHICLE.battery.capacity_ah * 400.0
        short_k = max(target_c - float(schedule.temperature_c[-1]), 0.0)
        per_k = VEHICLE.battery.heat_capacity_j_per_k / VEHICLE.hvch.efficiency / 3600.0
        return (state.soc - float(schedule.soc[-1])) * capacity_wh + 30.0 * short_k * per_k

    tried = [drive_as_planned(trip, state, np.array(shares) * trip.heater_limit_w)
             for shares in product((0.0, 0.5, 1.0), repeat=8)]
    # Switching on costs half a watt-hour, which this does not count.
    assert cost_wh(mine) < min(map(cost_wh, tried)) + 1.0


def test_without_an_active_limit_it_is_one_switch():
    route = load_route('reference', VEHICLE.defaults)
    plans = [plan_preheating(VEHICLE, route, BatteryState(-7.0, 0.9), Goal(25.0), method)
             for method in ('value_function', 'optimal_switch')]
    assert np.array_equal(plans[0].hvch_battery_power_w, plans[1].hvch_battery_power_w)


# Order of sacrifices.

def climb(power_w, cold_c, soc, reserve, target_c=5.0):
    route = make_route({
        'duration_s': np.full(60, 30.0), 'speed_mps': np.full(60, 20.0),
        'propulsion_power_w': [*[15e3] * 40, *[power_w] * 6, *[15e3] * 14],
        'ambient_temperature_c': np.full(60, cold_c)}, VEHICLE.defaults)
    state = BatteryState(cold_c, soc)
    return make_trip(VEHICLE, route), route, state, Goal(target_c, reserve)


def lacking_w(trip, schedule):
    return power_deficit(trip, schedule).worst_w


def test_a_climb_that_heat_makes_possible_is_heated_for_and_given_up_for_the_reserve():
    trip, route, state, goal = climb(150e3, -12.0, 0.7, 0.0)
    unheated = run_unheated(trip, state)
    assert lacking_w(trip, unheated) > 1e3
    heated = plan_by_values(trip, state, goal)
    assert lacking_w(trip, heated) == 0.0
    # The unheated drive leaves this much, so no heat can be paid for.
    reserve = float(unheated.soc[-1])
    held = plan_preheating(VEHICLE, route, state, Goal(5.0, reserve), 'value_function')
    assert held.arrival_soc >= reserve - 1e-5
    assert held.energy_wh.hvch_electric < 1.0
    assert held.status is Status.POWER_LIMITED


def test_the_target_is_lowered_to_what_the_reserve_allows():
    route = load_route('reference', VEHICLE.defaults)
    plan = plan_preheating(VEHICLE, route, BatteryState(-7.0, 0.9), Goal(25.0, 0.64), 'value_function')
    assert plan.status is Status.SOC_LIMITED
    assert plan.arrival_soc == pytest.approx(0.64, abs=1e-6) and plan.arrival_soc >= 0.64
    warmer = plan_preheating(VEHICLE, route, BatteryState(-7.0, 0.9), Goal(
        plan.arrival_temperature_c + 0.1), 'value_function')
    assert warmer.arrival_soc < 0.64


def test_a_trip_that_the_charge_does_not_carry_is_not_heated():
    trip, route, state, goal = climb(90e3, -12.0, 0.1, 0.0)
    plan = plan_preheating(VEHICLE, route, state, goal, 'value_function')
    assert plan.status is Status.OUT_OF_CHARGE
    assert plan.energy_wh.hvch_electric == 0.0


@pytest.mark.deep
def test_on_many_trips_it_is_no_dearer_than_the_default_method():
    dearer_wh = []
    for number in range(120):
        trip = draw_limit_trip(VEHICLE, 5, number)
        plans = [planned(trip, method) for method in ('value_function', 'merit_order')]
        if plans[0].undeliverable_power_w == plans[1].undeliverable_power_w == 0.0:
            dearer_wh.append(total_wh(plans[0]) - total_wh(plans[1]))
    assert len(dearer_wh) > 80
    assert max(dearer_wh) < 2.0 and np.mean(dearer_wh) < 0.0
