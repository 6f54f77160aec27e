# SPDX-License-Identifier: Apache-2.0
"""Plans with one switching instant, and the accounts of runs, in the core and in Python."""

from ctypes import addressof, c_double
from dataclasses import replace
from math import inf, nan

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native.calls import place
from bev_preheat.native.library import core, without_core
from bev_preheat.native.structs import (
    ENERGIES,
    NativeVehicle,
    room,
    RunOfPowersStruct,
    SwitchPlanStruct,
)
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.core_engine import trip_in_core, vehicle_in_core
from bev_preheat.planning.dynamics import hottest_c
from bev_preheat.planning.engine import keep_accounts, plan_switch, run_forward, run_heated
from bev_preheat.planning.heat_run import initial_states, roll_heated
from bev_preheat.planning.limits import drive_as_planned, limits_along
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.switch_methods import is_best, plan_optimal_switch
from bev_preheat.planning.trip import heated_throughout, make_trip, MOST_KEPT_SEGMENTS
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat.vehicle.model import make_euler, make_midpoint, make_runge_kutta_4
from bev_preheat.vehicle.terminal_limits import make_terminal_limits

FORMULAS, TABLES = (drawn_situations.car(name) for name in drawn_situations.CARS)
BAD_ARGUMENT, BAD_VEHICLE, BAD_INPUT = -1, -2, -3
START = BatteryState(-4.0, 0.8)
PATHS = (HeatPath(35.0), HeatPath(0.0, 14e3, 320.0), HeatPath(45.0, 16e3, 280.0))


def steady_route(steps=40, power_w=14e3, cabin_w=1500.0, **columns):
    return make_route({
        'duration_s': [60.0], 'speed_mps': [22.0], 'propulsion_power_w': np.full(steps, power_w),
        'ambient_temperature_c': [-9.0], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [300.0], **columns}, FORMULAS.defaults)


def in_both(make):
    found = make()
    with without_core():
        return found, make()


@pytest.mark.parametrize('part', [0, pytest.param(1, marks=pytest.mark.deep)])
def test_switching_instants_and_runs_are_the_same_to_the_last_bit(part):
    heated = 0
    for number in range(40 * part, 40 * (part + 1)):
        vehicle, route, state, goal, *_ = drawn_situations.draw(number, 25)
        trip = make_trip(replace(vehicle, heat_path=HeatPath()), route)
        found, expected = in_both(lambda: plan_optimal_switch(trip, state, goal))
        assert found.heating_start_s == expected.heating_start_s, number
        for name in ('heater_power_w', 'brake_power_w', 'soc', 'temperature_c'):
            assert getattr(found, name).tolist() == getattr(expected, name).tolist(), (number, name)
        heated += found.heating_start_s is not None
    assert heated > 15


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('path', PATHS, ids=['lag', 'coolant', 'coolant and lag'])
def test_instants_of_switching_on_and_off_are_the_same_to_the_last_bit(path):
    ends_early = 0
    situations = [*(drawn_situations.draw(number, 12)[:4] for number in range(8)),
                  *(drawn_situations.draw_without_limits(number) for number in range(8))]
    for number, (vehicle, route, state, goal) in enumerate(situations):
        trip = make_trip(replace(vehicle, heat_path=path), route)
        found, expected = in_both(lambda: plan_optimal_switch(trip, state, goal))
        assert (found.heating_start_s, found.heating_end_s) == (
            expected.heating_start_s, expected.heating_end_s), number
        for name in ('heater_power_w', 'soc', 'temperature_c'):
            assert getattr(found, name).tolist() == getattr(expected, name).tolist(), (number, name)
        for name in ('heater_power_w', 'coolant_excess_k'):
            assert getattr(found.heat, name).tolist() == getattr(expected.heat, name).tolist(), (number, name)
        for name in ('drawn_power_w', 'arriving_heat_w'):
            np.testing.assert_allclose(
                getattr(found.heat, name), getattr(expected.heat, name), rtol=1e-12, atol=1e-9)
        ends_early += found.heating_end_s is not None
    assert ends_early > 1


def test_two_switches_of_what_cannot_be_are_refused():
    trip = make_trip(replace(FORMULAS, heat_path=PATHS[2]), steady_route(12))
    vehicle = vehicle_in_core(trip.vehicle)
    idle = roll_heated(trip, (0.8, -4.0, 0.0, 0.0), np.zeros(12))

    def status(target_c=15.0, idle_states=idle, null=None, address=vehicle.address):
        arrays = {'idle_states': idle_states, 'memory': np.empty(13), 'states': np.empty((4, 13)),
                  'command_w': np.empty(12), 'heat_w': np.empty((2, 12)),
                  'on_s': np.empty(1), 'off_s': np.empty(1)}
        return core().bev_find_two_switches(
            address, trip_in_core(trip).address, target_c,
            *(None if name == null else place(array) for name, array in arrays.items()))

    assert status() == status(null='heat_w') == 0
    for null in ('idle_states', 'memory', 'states', 'command_w', 'on_s', 'off_s'):
        assert status(null=null) == BAD_ARGUMENT
    assert status(address=None) == BAD_ARGUMENT
    assert status(target_c=nan) == BAD_INPUT
    for row in range(4):
        unknown = idle.copy()
        unknown[row, 5] = nan
        assert status(idle_states=unknown) < 0


def test_plans_without_active_limits_are_the_same():
    seen, whole = set(), 0
    for number in range(80):
        *situation, goal = drawn_situations.draw_without_limits(number)
        method = ('value_function', 'optimal_switch')[number % 2]
        trip, aimed = make_trip(*situation[:2]), goal
        if not (goal.charging_planned and goal.heating_pays):
            aimed = replace(goal, target_temperature_c=trip.vehicle.battery.temperature_range_c[0])
        switched = plan_switch(trip, situation[2], aimed.target_temperature_c, method == 'optimal_switch')
        if not (switched.unheated_keeps_limits and is_best(trip, aimed, switched)):
            # A limit is active: the charge that must be left, or the battery's; test_same_plans.py.
            continue
        whole += 1
        found, expected = in_both(lambda: plan_preheating(*situation, goal, method).as_dictionary())
        for plan in (found, expected):
            del plan['planning_time_s']
        energies_wh = [plan.pop('energy_wh') for plan in (found, expected)]
        intervals = [plan.pop('stretches') for plan in (found, expected)]
        assert found == expected, number
        assert energies_wh[0] == pytest.approx(energies_wh[1], rel=1e-12, abs=1e-9), number
        for interval, expected_interval in zip(*intervals, strict=True):
            wh, expected_wh = interval.pop('energy_wh'), expected_interval.pop('energy_wh')
            assert interval == expected_interval and wh == pytest.approx(expected_wh, rel=1e-12), number
        seen.add(found['status'])
    assert {'NOT_NEEDED', 'WAITING', 'TARGET_UNREACHABLE', 'NO_CHARGING_PLANNED', 'NOT_WORTH_IT'} <= seen
    assert 40 < whole < 80


def runs_to_account_for():
    """Yield trips and schedules of every kind: with brake, without delivery, held hot, with a heat path."""
    for number in range(24):
        vehicle, route, state, *_ = drawn_situations.draw(number, 12)
        path = vehicle.heat_path
        trip = make_trip(replace(vehicle, heat_path=HeatPath()), route)
        heater_w = 0.6 * trip.heater_limit_w
        for make_integrator in (make_euler, make_midpoint, make_runge_kutta_4):
            soc, temperature_c = run_forward(trip, make_integrator, state.soc, state.temperature_c, heater_w)
            yield trip, Schedule(0.0, heater_w, np.zeros(len(heater_w)), soc, temperature_c, make_integrator)
        yield trip, drive_as_planned(trip, state, heater_w)
        if not path.is_direct:
            slow = make_trip(vehicle, route)
            yield slow, run_heated(slow, initial_states(state), heater_w)
            yield slow, drive_as_planned(slow, state, heater_w)
    beyond = make_trip(FORMULAS, steady_route(3, power_w=900e3))
    soc, temperature_c = run_forward(beyond, make_runge_kutta_4, 0.9, -8.0)
    yield beyond, Schedule(None, np.zeros(3), np.zeros(3), soc, temperature_c, make_runge_kutta_4)
    trip = make_trip(FORMULAS, steady_route(power_w=160e3, duration_s=[200.0]))
    hot = drive_as_planned(trip, BatteryState(48.0, 0.9), np.zeros(40))
    assert hot.temperature_c.max() == hottest_c(FORMULAS) and hot.empty_at_s is not None
    yield trip, hot


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
def test_accounts_are_the_same():
    kinds = set()
    for trip, schedule in runs_to_account_for():
        for deliverable in (True, False):
            found, expected = in_both(lambda: keep_accounts(trip, schedule, deliverable))
            assert vars(found.energy_wh) == pytest.approx(vars(expected.energy_wh), rel=1e-12, abs=1e-9)
            for name in ('joule_heat_w', 'leakage_w', 'battery_power_w', 'undeliverable_power_w'):
                np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=1e-12, atol=1e-8)
        kinds |= {name for name, is_seen in (
            ('brake', schedule.brake_power_w.any()), ('lacking', expected.undeliverable_power_w.any()),
            ('heat path', schedule.heat is not None), ('stranded', schedule.empty_at_s is not None)) if is_seen}
    assert kinds == {'brake', 'lacking', 'heat path', 'stranded'}


def call_plan_switch(trip, vehicle=None, soc=0.8, start_c=-4.0, target_c=15.0, null=None):
    """Return (status, SwitchPlanStruct); `null` is the argument that is to be a null pointer."""
    steps = len(trip.route)
    kept = {'memory': np.empty(room('BEV_SWITCH_MEMORY', steps)), 'soc': np.empty(steps + 1),
            'temperature_c': np.empty(steps + 1), 'heater_w': np.empty(steps)}
    plan = SwitchPlanStruct()
    vehicle = vehicle or NativeVehicle(trip.vehicle, hottest_c(trip.vehicle))
    status = core().bev_plan_switch(
        None if null == 'vehicle' else vehicle.address, None if null == 'trip' else trip_in_core(trip).address,
        soc, start_c, target_c, 1,
        *(None if name == null else place(array) for name, array in kept.items()),
        None if null == 'plan' else addressof(plan))
    return status, plan


@pytest.mark.parametrize('name', ['vehicle', 'trip', 'memory', 'soc', 'temperature_c', 'heater_w', 'plan'])
def test_a_null_pointer_is_refused(name):
    assert call_plan_switch(make_trip(FORMULAS, steady_route()))[0] == 0
    assert call_plan_switch(make_trip(FORMULAS, steady_route()), null=name)[0] == BAD_ARGUMENT


@pytest.mark.parametrize('path', [HeatPath(30.0), HeatPath(0.0, 14e3, 300.0)])
def test_a_heat_path_is_refused(path):
    trip = make_trip(replace(FORMULAS, heat_path=path), steady_route())
    assert call_plan_switch(trip)[0] == BAD_ARGUMENT


@pytest.mark.parametrize('number', [nan, inf, -inf])
@pytest.mark.parametrize('name', ['soc', 'start_c', 'target_c'])
def test_a_state_or_target_that_is_no_number_is_refused(name, number):
    trip = make_trip(FORMULAS, steady_route())
    assert call_plan_switch(trip, **{name: number})[0] == BAD_INPUT


@pytest.mark.parametrize('column', ['time_s', 'duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w',
                                    'leakage_w_per_k', 'heater_limit_w', 'propulsion_power_w',
                                    'drivetrain_heat_w', 'ambient_temperature_c'])
def test_a_trip_with_a_number_that_is_none_gives_no_plan(column):
    trip = replace(make_trip(FORMULAS, steady_route()))
    trip.columns.column(column)[37] = nan
    status, plan = call_plan_switch(trip)
    # The propulsion power decides only whether a step regenerates, and NaN does not.
    assert status < 0 or (column == 'propulsion_power_w' and status == 0)


def test_time_that_does_not_rise_is_refused():
    trip = replace(make_trip(FORMULAS, steady_route()))
    time_s = trip.columns.column('time_s')
    time_s[20] = time_s[19]
    assert call_plan_switch(trip)[0] == BAD_INPUT


def test_an_impossible_vehicle_is_refused():
    vehicle = NativeVehicle(FORMULAS, 60.0)
    vehicle.struct.lowest_c = nan
    assert call_plan_switch(make_trip(FORMULAS, steady_route()), vehicle)[0] == BAD_VEHICLE


@pytest.mark.parametrize('route, start, target_c', [
    (steady_route(propulsion_power_w=[-25e3]), (0.8, -12.0), 10.0),
    (steady_route(propulsion_power_w=[170e3]), (0.9, -12.0), 10.0),
    # Only the heater takes it beyond.
    (steady_route(), (0.8, 46.0), 80.0),
    (steady_route(power_w=30e3), (0.12, 0.0), 10.0),
    (steady_route(propulsion_power_w=[-9e3], duration_s=[100.0]), (0.999, 20.0), 10.0)],
    ids=['charge limit', 'discharge limit', 'highest temperature', 'no charge', 'overfilled'])
def test_where_a_limit_is_active_the_plan_says_so(route, start, target_c):
    trip = make_trip(FORMULAS, route)
    status, plan = call_plan_switch(trip, soc=start[0], start_c=start[1], target_c=target_c)
    assert status == 0 and not plan.keeps_limits
    found, expected = in_both(lambda: plan_switch(trip, BatteryState(start[1], start[0]), target_c))
    assert found[2:4] == expected[2:4] and not expected.keeps_limits


def test_a_plan_is_best_while_it_leaves_the_charge_that_must_be_left():
    trip = make_trip(FORMULAS, steady_route())
    found = plan_switch(trip, START, 15.0)
    arrival_soc = float(found.schedule.soc[-1])
    assert is_best(trip, Goal(15.0, arrival_soc), found)
    assert not is_best(trip, Goal(15.0, np.nextafter(arrival_soc, 1.0)), found)
    # Nothing is left for a charger where none is planned.
    assert is_best(trip, Goal(15.0, 0.99, charging_planned=False), found)


def test_accounts_of_what_cannot_be_are_refused():
    trip = make_trip(FORMULAS, steady_route())
    vehicle, steps = vehicle_in_core(FORMULAS), len(trip.route)
    soc, temperature_c, heater_w = np.full(steps + 1, 0.7), np.full(steps + 1, 3.0), np.zeros(steps)
    energies = (c_double * len(ENERGIES))()

    def status(integrator=2, **changed):
        arrays = {'soc': soc, 'temperature_c': temperature_c, 'heater_w': heater_w, **changed}
        run = RunOfPowersStruct(0, *(None if each is None else each.ctypes.data for each in arrays.values()))
        return core().bev_keep_accounts(
            vehicle.address, integrator, trip_in_core(trip).address, addressof(run), None, addressof(energies))

    assert status() == 0
    assert status(integrator=3) == status(soc=None) == status(heater_w=None) == BAD_ARGUMENT
    assert status(soc=np.where(np.arange(steps + 1) == 9, nan, soc)) == BAD_INPUT
    assert status(heater_w=np.where(np.arange(steps) == 9, inf, 0.0)) == BAD_INPUT
    assert core().bev_keep_accounts(
        vehicle.address, 2, trip_in_core(trip).address, None, None, energies) == BAD_ARGUMENT


def test_a_trip_is_kept_for_the_same_vehicle_and_route_only():
    route = steady_route()
    trip = make_trip(FORMULAS, route)
    assert make_trip(FORMULAS, route) is trip
    same = make_trip(FORMULAS, replace(route))
    assert same is not trip and same.idle_heat_w.tolist() == trip.idle_heat_w.tolist()
    assert make_trip(TABLES, route).vehicle is TABLES
    assert make_trip(FORMULAS, route, 0.7).heater_limit_w[0] == pytest.approx(0.7 * trip.heater_limit_w[0])
    assert make_trip(FORMULAS, route, 0.7, 200.0).heater_limit_w[-1] == 0.0 < trip.heater_limit_w[-1]
    assert heated_throughout(trip, trip.heater_limit_w).heater_limit_w.max() == 0.0 < trip.heater_limit_w.max()
    long = steady_route(MOST_KEPT_SEGMENTS + 1, duration_s=[5.0])
    assert make_trip(FORMULAS, long) is not make_trip(FORMULAS, long)


def test_a_trip_of_another_size_is_what_its_struct_says():
    trip = make_trip(FORMULAS, steady_route(3))
    assert trip_in_core(trip).struct.steps == trip.columns.steps == 3
    found = plan_switch(trip, START, 60.0).schedule
    # Heating all the way is not enough.
    assert found.heating_start_s == 0.0 and found.heater_power_w.tolist() == trip.heater_limit_w.tolist()


def test_limits_along_a_run_are_those_of_its_trip():
    trip = make_trip(FORMULAS, steady_route())
    schedule = plan_optimal_switch(trip, START, Goal(15.0))
    _, most_w = limits_along(trip, schedule)
    other_vehicle = replace(trip, vehicle=TABLES)
    varied = trip.changed(power_variance_w2=np.full(40, 4e8))
    for other in (other_vehicle, varied, trip):
        (start_w, end_w) = (np.array(make_terminal_limits(other.vehicle, ARRAYS)(
            schedule.soc[ends], schedule.temperature_c[ends], other.power_variance_w2))
            for ends in (slice(-1), slice(1, None)))
        assert [each.tolist() for each in limits_along(other, schedule)] == [
            np.maximum(start_w[0], end_w[0]).tolist(), np.minimum(start_w[1], end_w[1]).tolist()]
    assert not np.array_equal(limits_along(varied, schedule)[1], most_w)
    # A schedule that is changed is another run.
    emptier = replace(schedule, soc=schedule.soc - 0.3)
    assert not np.array_equal(limits_along(trip, emptier)[1], most_w)
