# SPDX-License-Identifier: Apache-2.0
"""Plans with one switching instant, and the accounts of runs, in the core and in Python."""

from ctypes import addressof
from dataclasses import replace
from math import inf, nan

import drawn_situations
from drawn_situations import in_both
import numpy as np
import pytest

from bev_preheat.numerics import ARRAYS
from bev_preheat.planning.engine import plan_switch, trip_in_core
from bev_preheat.planning.heat_run import roll_heated
from bev_preheat.planning.limits import limits_along
from bev_preheat.planning.methods import plan_optimal_switch
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.core_calls import place, vehicle_in_core
from bev_preheat.vehicle.core_library import core
from bev_preheat.vehicle.core_structs import NativeVehicle, room, SwitchPlanStruct
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.model import make_terminal_limits

FORMULAS, TABLES = (drawn_situations.car(name) for name in drawn_situations.CARS)
BAD_ARGUMENT, BAD_VEHICLE, BAD_INPUT = -1, -2, -3
START = BatteryState(-4.0, 0.8)


def steady_route(steps=40, power_w=14e3, cabin_w=1500.0, **columns):
    return make_route({
        'duration_s': [60.0], 'speed_mps': [22.0], 'propulsion_power_w': np.full(steps, power_w),
        'ambient_temperature_c': [-9.0], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [300.0], **columns}, FORMULAS.defaults)


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


def test_two_switches_of_what_cannot_be_are_refused():
    trip = make_trip(replace(FORMULAS, heat_path=HeatPath(45.0, 16e3, 280.0)), steady_route(12))
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


def call_plan(trip, vehicle=None, soc=0.8, start_c=-4.0, target_c=15.0, null=None):
    """Return (status, SwitchPlanStruct); `null` is the argument that is to be a null pointer."""
    steps = len(trip.route)
    kept = {'memory': np.empty(room('BEV_SWITCH_MEMORY', steps)), 'soc': np.empty(steps + 1),
            'temperature_c': np.empty(steps + 1), 'heater_w': np.empty(steps)}
    plan = SwitchPlanStruct()
    vehicle = vehicle or NativeVehicle(trip.vehicle)
    status = core().bev_plan_switch(
        None if null == 'vehicle' else vehicle.address, None if null == 'trip' else trip_in_core(trip).address,
        soc, start_c, target_c, 1,
        *(None if name == null else place(array) for name, array in kept.items()),
        None if null == 'plan' else addressof(plan))
    return status, plan


def test_what_cannot_be_is_refused():
    trip = make_trip(FORMULAS, steady_route())
    assert call_plan(trip)[0] == 0
    for name in ('vehicle', 'trip', 'memory', 'soc', 'temperature_c', 'heater_w', 'plan'):
        assert call_plan(trip, null=name)[0] == BAD_ARGUMENT, name
    for name in ('soc', 'start_c', 'target_c'):
        for number in (nan, inf, -inf):
            assert call_plan(trip, **{name: number})[0] == BAD_INPUT, (name, number)
    for path in (HeatPath(30.0), HeatPath(0.0, 14e3, 300.0)):
        assert call_plan(make_trip(replace(FORMULAS, heat_path=path), steady_route()))[0] == BAD_ARGUMENT
    vehicle = NativeVehicle(FORMULAS)
    vehicle.struct.lowest_c = nan
    assert call_plan(trip, vehicle)[0] == BAD_VEHICLE
    time_s = trip.columns.column('time_s')
    time_s[20] = time_s[19]
    assert call_plan(trip)[0] == BAD_INPUT


@pytest.mark.parametrize('route, start, target_c, unheated_keeps', [
    (steady_route(propulsion_power_w=[-25e3]), (0.8, -12.0), 10.0, False),
    (steady_route(propulsion_power_w=[170e3]), (0.9, -12.0), 10.0, False),
    # Only the heater takes it beyond.
    (steady_route(), (0.8, 46.0), 80.0, True),
    (steady_route(power_w=30e3), (0.12, 0.0), 10.0, False),
    (steady_route(propulsion_power_w=[-9e3], duration_s=[100.0]), (0.999, 20.0), 10.0, False)],
    ids=['charge limit', 'discharge limit', 'highest temperature', 'no charge', 'overfilled'])
def test_where_a_limit_is_active_the_plan_says_so(route, start, target_c, unheated_keeps):
    trip = make_trip(FORMULAS, route)
    status, plan = call_plan(trip, soc=start[0], start_c=start[1], target_c=target_c)
    assert status == 0 and plan.unheated_keeps_limits == unheated_keeps and not plan.keeps_limits
    found, expected = in_both(lambda: plan_switch(trip, BatteryState(start[1], start[0]), target_c))
    assert found[2:4] == expected[2:4] and not expected.keeps_limits
    _, plan = call_plan(make_trip(FORMULAS, steady_route()))
    assert plan.unheated_keeps_limits and plan.keeps_limits


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


@pytest.mark.parametrize('column', ['time_s', 'duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w',
                                    'leakage_w_per_k', 'heater_limit_w', 'propulsion_power_w',
                                    'drivetrain_heat_w', 'ambient_temperature_c'])
def test_a_trip_with_a_number_that_is_none_gives_no_plan(column):
    trip = make_trip(FORMULAS, steady_route())
    trip.columns.column(column)[37] = nan
    status, _ = call_plan(trip)
    # The propulsion power decides only whether a step regenerates, and NaN does not.
    assert status < 0 or (column == 'propulsion_power_w' and status == 0)
