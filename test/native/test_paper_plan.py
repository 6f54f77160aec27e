# SPDX-License-Identifier: Apache-2.0
"""The whole plan of the paper's heuristic, in the core and in Python."""

from ctypes import addressof
from dataclasses import replace
from math import inf, nan

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native.calls import place
from bev_preheat.native.library import core, without_core
from bev_preheat.native.structs import NativeVehicle, room, SwitchPlanStruct
from bev_preheat.planning.core_engine import trip_in_core
from bev_preheat.planning.dynamics import hottest_c
from bev_preheat.planning.engine import plan_by_paper
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.heat_path import HeatPath

FORMULAS, TABLES = (drawn_situations.car(name) for name in drawn_situations.CARS)
BAD_ARGUMENT, BAD_INPUT = -1, -3
START = BatteryState(-4.0, 0.8)


def winter_route(steps=40, **columns):
    return make_route({
        'duration_s': [60.0], 'speed_mps': [21.0], 'propulsion_power_w': np.full(steps, 13e3),
        'ambient_temperature_c': [-8.0], 'cabin_heating_power_w': [1400.0], 'auxiliary_power_w': [310.0],
        **columns}, FORMULAS.defaults)


def drawn(number):
    """Return a situation in which the battery's limits are mostly not active."""
    random = np.random.default_rng([31, number])
    steps = int(random.integers(1, 50))
    vehicle = (FORMULAS, TABLES)[int(random.integers(2))]
    route = make_route({
        'duration_s': random.uniform(20.0, 400.0, steps), 'speed_mps': random.uniform(0.0, 33.0, steps),
        'propulsion_power_w': random.uniform(-500.0, 18e3, steps),
        'ambient_temperature_c': random.uniform(-15.0, 5.0, steps),
        'cabin_heating_power_w': random.choice([0.0, 1500.0, 7e3], steps, p=[0.1, 0.85, 0.05]),
        'auxiliary_power_w': [350.0]}, vehicle.defaults)
    goal = Goal(float(random.uniform(-2.0, 25.0)), float(random.choice([0.0, 0.3, 0.6])),
                heating_pays=bool(random.random() < 0.9))
    return vehicle, route, BatteryState(float(random.uniform(0.0, 10.0)), float(random.uniform(0.4, 0.95))), goal


def test_plans_are_the_same_to_the_last_bit():
    seen, whole = set(), 0
    situations = [*map(drawn, range(40)), *(drawn_situations.draw(number, 20)[:4] for number in range(20))]
    for number, (vehicle, *others) in enumerate(situations):
        situation = replace(vehicle, heat_path=HeatPath()), *others
        found = plan_preheating(*situation, 'paper').as_dictionary()
        with without_core():
            expected = plan_preheating(*situation, 'paper').as_dictionary()
        for plan in (found, expected):
            del plan['planning_time_s']
        # Sums of the steps, which are taken in another order.
        energies_wh = [plan.pop('energy_wh') for plan in (found, expected)]
        intervals = [[interval.pop('energy_wh') for interval in plan['stretches']] for plan in (found, expected)]
        assert found == expected, number
        assert energies_wh[0] == pytest.approx(energies_wh[1], rel=1e-12, abs=1e-9), number
        assert intervals[0] == pytest.approx(intervals[1], rel=1e-12), number
        seen.add(found['status'])
        switched = plan_by_paper(make_trip(*situation[:2]), situation[2], situation[3].target_temperature_c)
        whole += switched.unheated_keeps_limits and switched.keeps_limits
    assert {'NOT_NEEDED', 'WAITING', 'TARGET_UNREACHABLE', 'NOT_WORTH_IT'} <= seen
    # In the others something limits the plan.
    assert 15 < whole < 50


def call(trip, soc=0.8, start_c=-4.0, target_c=15.0, null=None):
    """Return (status, SwitchPlanStruct) of bev_plan_paper; `null` is the argument that is to be a null pointer."""
    steps = len(trip.route)
    kept = {'memory': np.empty(room('BEV_SWITCH_MEMORY', steps)), 'soc': np.empty(steps + 1),
            'temperature_c': np.empty(steps + 1), 'heater_w': np.empty(steps)}
    vehicle, plan = NativeVehicle(trip.vehicle, hottest_c(trip.vehicle)), SwitchPlanStruct()
    status = core().bev_plan_paper(
        None if null == 'vehicle' else vehicle.address, None if null == 'trip' else trip_in_core(trip).address,
        soc, start_c, target_c, *(None if name == null else place(array) for name, array in kept.items()),
        None if null == 'plan' else addressof(plan))
    return status, plan


@pytest.mark.parametrize('name', ['vehicle', 'trip', 'memory', 'soc', 'temperature_c', 'heater_w', 'plan'])
def test_a_null_pointer_is_refused(name):
    assert call(make_trip(FORMULAS, winter_route()))[0] == 0
    assert call(make_trip(FORMULAS, winter_route()), null=name)[0] == BAD_ARGUMENT


@pytest.mark.parametrize('number', [nan, inf, -inf])
@pytest.mark.parametrize('name', ['soc', 'start_c', 'target_c'])
def test_a_state_or_target_that_is_no_number_is_refused(name, number):
    assert call(make_trip(FORMULAS, winter_route()), **{name: number})[0] == BAD_INPUT


@pytest.mark.parametrize('column', ['time_s', 'duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w',
                                    'leakage_w_per_k', 'heater_limit_w', 'drivetrain_heat_w',
                                    'ambient_temperature_c'])
def test_a_trip_with_a_number_that_is_none_gives_no_plan(column):
    trip = replace(make_trip(FORMULAS, winter_route()))
    trip.columns.column(column)[37] = nan
    assert call(trip)[0] < 0


@pytest.mark.parametrize('path', [HeatPath(30.0), HeatPath(0.0, 14e3, 300.0)])
def test_a_heat_path_is_refused_and_driven_after_the_plan(path):
    trip = make_trip(replace(FORMULAS, heat_path=path), winter_route())
    assert call(trip)[0] == BAD_ARGUMENT
    found = plan_by_paper(trip, START, 15.0)
    with without_core():
        expected = plan_by_paper(trip, START, 15.0)
    direct = plan_by_paper(make_trip(FORMULAS, winter_route()), START, 15.0)
    for plan in (found, expected):
        assert plan.schedule.heating_start_s == direct.schedule.heating_start_s
        assert plan.schedule.heater_power_w.tolist() == direct.schedule.heater_power_w.tolist()
    assert found.schedule.temperature_c.tolist() == expected.schedule.temperature_c.tolist()
    assert found[2:5] == expected[2:5]


@pytest.mark.parametrize('route, start', [
    (winter_route(propulsion_power_w=[-25e3]), (0.8, -12.0)),
    (winter_route(propulsion_power_w=[170e3]), (0.9, -12.0)),
    (winter_route(propulsion_power_w=np.full(40, 30e3)), (0.12, 0.0))],
    ids=['charge limit', 'discharge limit', 'no charge'])
def test_where_a_limit_is_active_the_plan_says_so(route, start):
    status, plan = call(make_trip(FORMULAS, route), *start)
    assert status == 0 and not plan.unheated_keeps_limits
    status, plan = call(make_trip(FORMULAS, winter_route()))
    assert status == 0 and plan.unheated_keeps_limits and plan.keeps_limits
