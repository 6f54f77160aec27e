# SPDX-License-Identifier: Apache-2.0
"""Route plans in messages: refusals and their wording, defaults, units, powers of the road load, and back."""

from dataclasses import replace
from math import inf, nan

from builtin_interfaces.msg import Time
from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from refusals import problems_of

from bev_preheat.charging.stop import ChargingProspect
from bev_preheat.control.inputs import Leg, Mission, with_stops
from bev_preheat.messages.route_plan import is_cancellation, mission_from_message, ROUTE_FIELDS, route_plan_message
from bev_preheat.numerics import mean_magnitude
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route import route_for
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Defaults
from bev_preheat_msgs.msg import RoutePlan

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0,
                    target_battery_temperature_c=33.0)
STAMP = Time(sec=1_700_000_000, nanosec=250_000_000)
UNSET_STAMP = 'header.stamp: is 0; it must be set, as "header: auto" of ros2 topic pub does'


def route_message(stamp=STAMP, **fields):
    """Return a RoutePlan of three segments; all values differ."""
    message = RoutePlan(**{
        'route_id': 'to the charger', 'segment_duration': [10.0, 20.0, 30.0],
        'speed': [11.0, 12.0, 13.0], 'propulsion_power': [1e3, -2e3, 3e3],
        'propulsion_power_rms': [1.5e3, 2.5e3, 3.5e3], 'ambient_temperature': [-4.0, -5.0, -6.0],
        'cabin_heating_power': [710.0, 720.0, 730.0], 'auxiliary_power': [310.0, 320.0, 330.0],
        'propulsion_power_magnitude': [1.2e3, 2.2e3, 3.2e3],
        'charging_planned': True, 'target_battery_temperature': 27.0, 'minimum_arrival_soc': 0.15,
        **fields})
    message.header.stamp = stamp
    return message


def convert(step_s=1000.0, **fields):
    return mission_from_message(route_message(**fields), DEFAULTS, step_s)


def convert_leg(*arguments, **fields):
    leg, = convert(*arguments, **fields).legs
    return leg


# Route: refusals

ARRAYS = list(ROUTE_FIELDS.values())
LIMITS_TEXT = {
    'segment_duration': '0.001 ... 86400 s', 'speed': '0 ... 100 m/s',
    'propulsion_power': '-2000000 ... 2000000 W', 'propulsion_power_rms': '0 ... 2000000 W',
    'ambient_temperature': '-60 ... 60 degC', 'cabin_heating_power': '0 ... 50000 W',
    'auxiliary_power': '0 ... 50000 W', 'propulsion_power_magnitude': '0 ... 2000000 W'}


@pytest.mark.parametrize('value, text', [(nan, 'nan'), (inf, 'inf'), (-inf, '-inf')])
@pytest.mark.parametrize('field', ARRAYS)
def test_a_number_that_is_none_is_refused_in_each_array(field, value, text):
    values = list(getattr(route_message(), field))
    values[1] = value
    assert problems_of(convert, **{field: values}) == [
        f'{field}[1]: {text} is not allowed; it must be {LIMITS_TEXT[field]}']


@pytest.mark.parametrize('field, values, problem', [
    ('segment_duration', [0.0, 20.0, 0.0],
     'segment_duration[0]: 0 is not allowed; it must be 0.001 ... 86400 s (and 1 more)'),
    ('speed', [11.0, 130.0, 13.0], 'speed[1]: 130 is not allowed; it must be 0 ... 100 m/s'),
    ('ambient_temperature', [266.0],
     'ambient_temperature[0]: 266 is not allowed; it must be -60 ... 60 degC'),
    ('cabin_heating_power', [710.0, -1.0, 730.0],
     'cabin_heating_power[1]: -1 is not allowed; it must be 0 ... 50000 W'),
    ('propulsion_power_rms', [1.5e3, 1.9e3, 3.5e3],
     'propulsion_power_rms[1]: 1900 is below the magnitude of the mean, 2000'),
    ('segment_duration', [86000.0, 300.0, 200.0],
     'segment_duration: the route lasts 86500 s; at most 86400 s are planned'),
    ('speed', [11.0, 12.0],
     'speed: has 2 values; it must have 1 or 3, the length of the longest array'),
    ('minimum_arrival_soc', 20.0, 'minimum_arrival_soc: 20 is not allowed; it must be 0 ... 1'),
    ('minimum_arrival_soc', nan, 'minimum_arrival_soc: nan is not allowed; it must be 0 ... 1'),
    ('maximum_arrival_temperature', inf, 'maximum_arrival_temperature: inf is not allowed; it must be -60 ... 60 '
     'degC, or 0 or NaN: not given'),
    ('target_battery_temperature', inf, 'target_battery_temperature: inf is not allowed; it must '
     "be finite, or 0 or NaN: the planner's own default"),
    ('route_id', 'x' * 257, f"route_id: '{'x' * 60}' … (257 characters) is too long; it must have "
     'at most 256 characters'),
    ('stamp', Time(), UNSET_STAMP),
    ('stamp', Time(sec=2**31 - 20), 'header.stamp: 2147483628 s is too late: the route would end '
     'after the last instant that a stamp can hold'),
])
def test_bad_route(field, values, problem):
    assert problems_of(convert, **{field: values}) == [problem]


@pytest.mark.parametrize('name', ARRAYS)
def test_too_many_segments_are_refused_before_they_are_looked_at(name):
    class Unread(list):
        """Numbers that must not be read, because there may be millions."""

        def __iter__(self):
            raise AssertionError('read')

    message = route_message()
    # Bypasses the setter, which would check each element.
    setattr(message, f'_{name}', Unread([nan] * 200_001))
    assert problems_of(mission_from_message, message, DEFAULTS, 30.0) == [
        f'{name}: has 200001 values; at most 200000 segments are planned']


# Route: conversion


def test_a_target_that_is_said_to_be_there_must_be_a_number():
    assert problems_of(lambda: convert(
        target_battery_temperature=nan, has_target_battery_temperature=True)) == [
            'target_battery_temperature: nan is not allowed where has_target_battery_temperature '
            'is true; it must be finite']


@pytest.mark.parametrize('fields, prospect', [
    ({}, (1.0, 0.0, 0.0)), ({'charging_probability': 0.4, 'arrival_time_deviation': 90.0,
                             'charging_known_before_arrival': 600.0}, (0.4, 90.0, 600.0))])
def test_charging_is_certain_unless_the_message_says_otherwise(fields, prospect):
    assert convert_leg(**fields).prospect == ChargingProspect(*prospect)


# Cancellation


def test_what_holds_some_of_a_trip_is_no_cancellation():
    assert not is_cancellation(RoutePlan(charging_planned=True))
    arrays = {name for name, kind in RoutePlan.get_fields_and_field_types().items()
              if kind.startswith('sequence')}
    assert len(arrays) > len(ARRAYS) and {field for field in arrays if is_cancellation(RoutePlan(**{
        field: [1] if field == 'stop_after_segment' else [True] if 'has' in field else [1.0]}))} == set()


@pytest.mark.parametrize('name, field, expected', [
    ('cabin_heating_power', 'cabin_heating_power_w', [1111.0] * 6),
    ('auxiliary_power', 'auxiliary_power_w', [222.0] * 6),
    ('propulsion_power_rms', 'propulsion_power_rms_w', [1e3, 2e3, 2e3, 3e3, 3e3, 3e3]),
    # The variance is the square of the rms less that of the mean.
    ('propulsion_power_magnitude', 'propulsion_power_magnitude_w', mean_magnitude(
        np.repeat([1e3, -2e3, 3e3], [1, 2, 3]), np.repeat([1.25e6, 2.25e6, 3.25e6], [1, 2, 3])).tolist()),
])
def test_an_empty_optional_array_takes_its_default(name, field, expected):
    route = convert_leg(step_s=10.0, **{'propulsion_power_magnitude': [], name: []}).route
    assert getattr(route, field).tolist() == pytest.approx(expected)


def legs_strategy(draw):
    """Return Legs of three segments each, with all fields that a message can hold."""
    targets_c = st.one_of(st.none(), st.just(0.0), st.floats(-60.0, 60.0))
    shares = st.floats(0.0, 1.0)
    route = convert_leg(step_s=10.0).route
    count = draw(st.integers(1, 4))
    legs = [Leg(route, 1_650_000_000_123_456_789, draw(st.booleans()) or at < count - 1,
                draw(targets_c), draw(shares),
                None if at == 0 else BatteryState(
                    draw(st.floats(-60.0, 60.0)), draw(st.floats(1e-3, 1.0))),
                maximum_arrival_temperature_c=draw(st.sampled_from((inf, 0.0, 1e-3, 60.0))))
            for at in range(count)]
    return with_stops(legs, [draw(st.floats(1.0, 86400.0)) for _ in legs[1:]])


@pytest.mark.parametrize('standing_time_s', [nan, inf, -inf, -1.0])
def test_a_standing_time_that_is_none_is_refused(standing_time_s):
    assert problems_of(convert, standing_time=standing_time_s) == [
        f'standing_time: {standing_time_s:g} is not allowed; it must be finite and at least 0 s '
        '(0: not known)']
    for taken_s in (0.0, 1.0, 1e300):
        assert convert(standing_time=taken_s).standing_time_s == taken_s


@given(st.composite(legs_strategy)())
@example((Leg(convert_leg(step_s=10.0).route, 10**18, True, 0.0),))
@example((Leg(convert_leg(step_s=10.0).route, 10**18, True, None),))
def test_mission_to_message_and_back(legs):
    mission = mission_from_message(route_plan_message(Mission('x', legs, 5e4)), DEFAULTS, 10.0)
    assert (mission.route_id, len(mission.legs), mission.standing_time_s) == ('x', len(legs), 5e4)
    for back, leg in zip(mission.legs, legs):
        assert (back.charging_planned, back.target_temperature_c, back.minimum_arrival_soc,
                back.departure) == (
            leg.charging_planned, leg.target_temperature_c, leg.minimum_arrival_soc, leg.departure)
        # A highest temperature of 0 degC stays given.
        assert back.maximum_arrival_temperature_c == pytest.approx(leg.maximum_arrival_temperature_c, abs=1e-9)
        assert back.start_ns == pytest.approx(leg.start_ns, abs=1000)
        for field in ROUTE_FIELDS:
            np.testing.assert_allclose(getattr(back.route, field), getattr(leg.route, field),
                                       rtol=1e-12, err_msg=field)


# Powers of the road load


CAR = load_vehicle('small_car')
SEGMENTS = {'segment_duration': [120.0, 90.0, 300.0], 'speed': [11.0, 0.0, 23.0]}
MIDDLES_S = (60.0, 165.0, 360.0)


def read_without_powers(vehicle=CAR, **fields):
    """Return the Mission of a RoutePlan without powers."""
    message = RoutePlan(**{'route_id': 'trip', **SEGMENTS, 'ambient_temperature': [-4.0], 'charging_planned': True,
                           **fields})
    message.header.stamp = STAMP
    return mission_from_message(message, vehicle.defaults, 30.0, vehicle)


def powers(mission, name='propulsion_power_w'):
    """Return a power in the middle of each segment, from the planning steps."""
    route = mission.legs[0].route
    return getattr(route, name)[[route.segment_at(instant_s) for instant_s in MIDDLES_S]]


def test_powers_are_those_of_the_same_segments_in_a_file(tmp_path):
    slopes = [0.02, 0.0, -0.01]
    mission = read_without_powers(slope=slopes)
    rows = zip(*SEGMENTS.values(), slopes)
    path = tmp_path / 'trip.csv'
    path.write_text('duration_s,speed_mps,slope,ambient_temperature_c\n' + ''.join(
        f'{duration},{speed},{slope},-4\n' for duration, speed, slope in rows))
    route = route_for(path, CAR).route
    for name in ('propulsion_power_w', 'propulsion_power_rms_w', 'propulsion_power_magnitude_w'):
        assert powers(mission, name) == pytest.approx(getattr(route, name), abs=1e-3)
    assert mission.power_source == (
        'computed from speeds and slopes and the road_load of vehicle small_car; accelerations within the '
        'segments are estimated')


def test_a_missing_slope_is_level_and_one_slope_is_for_all():
    level, one = powers(read_without_powers()), powers(read_without_powers(slope=[0.03]))
    assert (powers(read_without_powers(slope=[0.0])) == level).all()
    assert 'no slope: level road' in read_without_powers().power_source
    rise_m = 23.0 * 300.0 * 0.03 / np.hypot(1.0, 0.03)
    climb_w = CAR.road_load.mass_kg * 9.80665 * rise_m / 300.0 / CAR.drivetrain.efficiency
    assert one[2] - level[2] == pytest.approx(climb_w, rel=0.05)
    assert level[1] == 0.0


@pytest.mark.parametrize('fields, problem', [
    ({'slope': [0.5]}, 'slope[0]: 0.5 is not allowed; it must be -0.4 ... 0.4 (rise over run)'),
    ({'slope': [float('nan')]}, 'slope[0]: nan is not allowed; it must be -0.4 ... 0.4 (rise over run)'),
    ({'slope': [0.1, 0.1]}, 'slope: has 2 values; it must have 1 or 3, the length of the longest array, or none'),
    ({'propulsion_power_rms': [1.0]},
     'propulsion_power_rms: given without propulsion_power; give all three, or none'),
    ({'speed': [-1.0]}, 'speed[0]: -1 is not allowed; it must be 0 ... 100 m/s'),
    ({'ambient_temperature': []}, 'missing or empty: propulsion_power, ambient_temperature'),
    ({'speed': [90.0], 'segment_duration': [900.0], 'slope': [0.3]},
     'slope: the road rises by 23275 m in total; at most 6000 m are plausible; it must be rise over run')])
def test_mistakes_in_a_route_without_powers_are_named(fields, problem):
    assert problem in problems_of(read_without_powers, **fields)


def test_a_vehicle_without_road_load_is_told_what_to_add():
    found = problems_of(read_without_powers, replace(CAR, road_load=None))
    assert found[0].startswith("propulsion_power: empty, and vehicle 'small_car' has no road_load")
    assert 'road_load: {mass_kg: 1900' in found[0]
