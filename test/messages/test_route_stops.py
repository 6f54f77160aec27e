# SPDX-License-Identifier: Apache-2.0
"""Stops and chargers in route plans: refusals and their wording, the parsed stops, and back."""

from dataclasses import fields, replace
from math import inf, isnan, nan

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from refusals import problems_of

from bev_preheat.charging.stop import Charger
from bev_preheat.control.inputs import Leg
from bev_preheat.errors import figure
from bev_preheat.messages.route_plan import mission_from_message, route_plan_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import Route
from bev_preheat.tunables import MOST_STOPS
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import RoutePlan

VEHICLE = load_vehicle('reference')
START_S = 1_700_000_000
DURATIONS_S = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]
STOP_FIELDS = ('stop_duration', 'stop_target_battery_temperature', 'stop_maximum_arrival_temperature',
               'stop_minimum_arrival_soc', 'stop_charger_power', 'departure_battery_temperature', 'departure_soc')
POWER = '1000 ... 2000000 W, or 0 or NaN: not known'


def route_message(sec=START_S, **changed):
    """Return a RoutePlan of six segments with stops after the second and the third."""
    message = RoutePlan(**{
        'route_id': 'far', 'segment_duration': DURATIONS_S,
        'speed': [11.0, 12.0, 13.0, 14.0, 15.0, 16.0], 'propulsion_power': [9e3],
        'ambient_temperature': [-4.0], 'charging_planned': False,
        'target_battery_temperature': 27.0, 'minimum_arrival_soc': 0.35,
        'stop_after_segment': [1, 2], 'stop_duration': [700.0, 800.0],
        'stop_target_battery_temperature': [21.0, nan], 'stop_minimum_arrival_soc': [0.15, 0.25],
        'stop_maximum_arrival_temperature': [40.0, nan],
        'stop_charger_power': [50e3, 60e3], 'departure_battery_temperature': [31.0, 32.0],
        'departure_soc': [0.55, 0.65], **changed})
    message.header.stamp = Time(sec=sec)
    return message


def convert(step_s=1000.0, **changed):
    return mission_from_message(route_message(**changed), VEHICLE.defaults, step_s)


# Refusals

ALLOWED = {
    'stop_duration': '1 ... 86400 s',
    'stop_target_battery_temperature': "-60 ... 60 degC, or NaN: the planner's own default",
    'stop_maximum_arrival_temperature': '-60 ... 60 degC, or 0 or NaN: not given',
    'stop_minimum_arrival_soc': '0 ... 1', 'stop_charger_power': POWER,
    'departure_battery_temperature': '-60 ... 60 degC, or NaN: that wanted on arrival',
    'departure_soc': '0 ... 1, or NaN: 0.8'}
NAN_IS_ALLOWED = ('stop_target_battery_temperature', 'stop_maximum_arrival_temperature', 'stop_charger_power',
                  'departure_battery_temperature', 'departure_soc')
OUTSIDE = {
    'stop_duration': (0.5, -700.0, 90000.0), 'stop_target_battery_temperature': (-61.0, 293.0),
    'stop_maximum_arrival_temperature': (-61.0, 308.0),
    'stop_minimum_arrival_soc': (-0.25, 15.0), 'stop_charger_power': (50.0, 2.1e6, -50e3),
    'departure_battery_temperature': (-61.0, 304.0),
    'departure_soc': (-0.5, 55.0)}


@pytest.mark.parametrize('field, value', [
    (field, value) for field in STOP_FIELDS for value in (*OUTSIDE[field], inf, -inf, nan)
    if not (isnan(value) and field in NAN_IS_ALLOWED)])
def test_a_bad_value_is_refused_in_each_array(field, value):
    values = list(getattr(route_message(), field))
    values[1] = value
    assert problems_of(convert, **{field: values}) == [
        f'{field}[1]: {figure(value)} is not allowed; it must be {ALLOWED[field]}']


@pytest.mark.parametrize('count', [0, 1, 3])
@pytest.mark.parametrize('field', [*STOP_FIELDS, 'stop_has_target_battery_temperature'])
def test_an_array_of_another_length_is_refused(field, count):
    value = False if 'has' in field else getattr(route_message(), field)[0]
    empty = '' if field == 'stop_duration' else ', or none'
    if count > 0 or not empty:
        assert problems_of(convert, **{field: [value] * count}) == [
            f'{field}: has {count} values; it must have 2, as stop_after_segment has{empty}']


@pytest.mark.parametrize('after_segment, problem', [
    ([2, 2], 'stop_after_segment[1]: 2 is not allowed; it must be above 2, the one before it'),
    ([3, 1], 'stop_after_segment[1]: 1 is not allowed; it must be above 3, the one before it'),
    ([1, 5], 'stop_after_segment[1]: 5 is not allowed; it must be below 5, the last segment of '
     'the route'),
    ([2**32 - 1, 2**32 - 1], 'stop_after_segment[0]: 4294967295 is not allowed; it must be below '
     '5, the last segment of the route')])
def test_stops_out_of_order_are_refused(after_segment, problem):
    assert problems_of(convert, stop_after_segment=after_segment) == [problem]


def test_stops_need_their_segments():
    assert [problem.partition(':')[0] for problem in problems_of(convert, stop_after_segment=[])] == list(
        STOP_FIELDS)
    assert ('stop_after_segment[0]: 0 is not allowed; a route of one segment has no stop on the way'
            in problems_of(convert, segment_duration=[900.0], speed=[11.0], stop_after_segment=[0]))


@pytest.mark.parametrize('field', ['stop_after_segment', *STOP_FIELDS,
                                   'stop_has_target_battery_temperature'])
def test_more_stops_than_are_planned_are_refused(field):
    value = 1 if field == 'stop_after_segment' else False if 'has' in field else 1.0
    assert problems_of(convert, **{field: [value] * (MOST_STOPS + 1)}) == [
        f'{field}: has 21 values; at most 20 stops are planned']


def test_a_route_whose_stops_end_after_time_itself_is_refused():
    # 210 s of driving and 1500 s at stops; there is room for the driving.
    assert problems_of(convert, sec=2**31 - 1000) == [
        f'header.stamp: {2**31 - 1000} s is too late: the route would end after the last instant '
        'that a stamp can hold']


# Conversion


@pytest.mark.parametrize('attribute, expected', [
    ('start_ns', [START_S * NS_PER_S, (START_S + 30 + 700) * NS_PER_S,
                  (START_S + 60 + 1500) * NS_PER_S]),
    ('charging_planned', [True, True, False]),
    ('target_temperature_c', [21.0, None, 27.0]),
    ('minimum_arrival_soc', [0.15, 0.25, 0.35]),
    ('maximum_arrival_temperature_c', [40.0, inf, inf]),
    ('departure', [None, BatteryState(31.0, 0.55), BatteryState(32.0, 0.65)])])
def test_what_is_wanted_of_each_leg(attribute, expected):
    assert [getattr(leg, attribute) for leg in convert().legs] == expected


@pytest.mark.parametrize('field, attribute, expected', [
    ('stop_target_battery_temperature', 'target_temperature_c', [None, None, 27.0]),
    ('stop_minimum_arrival_soc', 'minimum_arrival_soc', [0.0, 0.0, 0.35]),
    # The target on arrival; without its own target, the planner's default.
    ('departure_battery_temperature', 'departure',
     [None, BatteryState(21.0, 0.55), BatteryState(17.5, 0.65)]),
    ('departure_soc', 'departure', [None, BatteryState(31.0, 0.8), BatteryState(32.0, 0.8)])])
def test_an_empty_array_is_not_given_for_all_stops(field, attribute, expected):
    mission = mission_from_message(
        route_message(**{field: []}),
        replace(VEHICLE.defaults, target_battery_temperature_c=17.5), 1000.0)
    assert [getattr(leg, attribute) for leg in mission.legs] == expected


@pytest.mark.parametrize('targets_c, has, expected', [
    ([0.0, 21.0], [], [None, 21.0]), ([0.0, 0.0], [True, False], [0.0, None]),
    ([nan, 0.0], [False, True], [None, 0.0]), ([5.0, -5.0], [False, False], [5.0, -5.0]),
    ([-0.0, 12.5], [False, True], [None, 12.5])])
def test_a_stop_target_of_0_counts_where_it_is_said_to_be_there(targets_c, has, expected):
    mission = convert(stop_target_battery_temperature=targets_c,
                      stop_has_target_battery_temperature=has)
    assert [leg.target_temperature_c for leg in mission.legs[:2]] == expected


# Chargers


@pytest.mark.parametrize('changed, expected', [
    ({}, [Charger(50e3, 0.55), Charger(60e3, 0.65), Charger(150e3, 0.75)]),
    ({'stop_charger_power': [], 'charging_departure_soc': 0.0}, [None, None, Charger(150e3)]),
    ({'stop_charger_power': [0.0, nan], 'charging_departure_soc': nan}, [None, None, Charger(150e3)]),
    ({'departure_soc': [nan, 0.0], 'charger_power': nan}, [Charger(50e3), Charger(60e3), None]),
    ({'departure_soc': [], 'charger_power': 0.0}, [Charger(50e3), Charger(60e3), None])])
def test_a_charger_is_known_by_its_power(changed, expected):
    mission = convert(**{'charger_power': 150e3, 'charging_departure_soc': 0.75, **changed})
    assert [leg.charger for leg in mission.legs] == expected
    again = mission_from_message(route_plan_message(mission), VEHICLE.defaults, 1000.0)
    assert again.legs[-1].charger == mission.legs[-1].charger


# There and back

def test_each_leg_comes_back():
    mission = convert(step_s=10.0)
    again = mission_from_message(route_plan_message(mission), VEHICLE.defaults, 10.0)
    for there, back in zip(mission.legs, again.legs, strict=True):
        for field in fields(Leg):
            if field.name not in ('route', 'places'):
                assert getattr(back, field.name) == getattr(there, field.name), field.name
        for field in fields(Route):
            np.testing.assert_allclose(getattr(back.route, field.name), getattr(there.route, field.name))
        # Places of the original route and of its planning steps have different points.
        assert back.places.length_m == pytest.approx(there.places.length_m)
        for time_s in np.linspace(0.0, there.route.total_duration_s, 50):
            assert back.places.distance_at_m(time_s) == pytest.approx(
                there.places.distance_at_m(time_s))
