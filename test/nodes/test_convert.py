# SPDX-License-Identifier: Apache-2.0
"""Messages to types and back: refusals and their wording, defaults, units, enums."""

from array import array
from dataclasses import replace
from math import inf, nan
from pathlib import Path
import random
import re
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from sensor_msgs.msg import BatteryState as BatteryStateMessage
from varying_power import magnitude_w

from bev_preheat.control.decision import Command, Decision
from bev_preheat.control.inputs import Leg, Mission, SupplyStatus, with_stops
from bev_preheat.control.target_choice import TargetSource
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.convert import (
    battery_event,
    command_message,
    is_cancellation,
    measurement_from_message,
    mission_from_message,
    nanoseconds,
    plan_message,
    ROUTE_FIELDS,
    route_plan_message,
    temperature_message,
    time_message,
)
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.heating_intervals import HeatingInterval, Reason
from bev_preheat.planning.outcome import Stranding
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Defaults
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

VEHICLE = load_vehicle('reference')
DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0,
                    target_battery_temperature_c=33.0)
STAMP = Time(sec=1_700_000_000, nanosec=250_000_000)
EAST = Mission('east', (Leg(None),))
UNSET_STAMP = 'header.stamp: is 0; it must be set, as "header: auto" of ros2 topic pub does'
MESSAGES = Path(__file__).parents[2] / 'msg_defs' / 'msg'


def battery_message(stamp=STAMP, **fields):
    message = BatteryStateMessage(**{'temperature': -5.0, 'percentage': 0.5, **fields})
    message.header.stamp = stamp
    return message


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


def problems_of(function, *arguments):
    with pytest.raises(InvalidInput) as refusal:
        function(*arguments)
    return refusal.value.problems


# Battery state

def test_battery_state():
    measurement = measurement_from_message(battery_message())
    assert (measurement.state, measurement.stamp_ns) == (
        BatteryState(temperature_c=-5.0, soc=0.5), 1_700_000_000_250_000_000)


@pytest.mark.parametrize('fields, problem', [
    ({'temperature': nan}, 'temperature: nan is not a known value; it must be a finite number, in degC'),
    ({'temperature': -inf}, 'temperature: -inf is not a known value; it must be a finite number, in degC'),
    ({'percentage': nan}, 'percentage: nan is not a known value; it must be 0 ... 1'),
    ({'percentage': inf}, 'percentage: inf is not a known value; it must be 0 ... 1'),
    ({'percentage': 1.25}, 'percentage: 1.25 is not allowed; it must be 0 ... 1'),
    ({'percentage': -0.25}, 'percentage: -0.25 is not allowed; it must be 0 ... 1'),
    ({'percentage': 1.0051}, 'percentage: 1.0051 is not allowed; it must be 0 ... 1'),
    ({'percentage': -0.0051}, 'percentage: -0.0051 is not allowed; it must be 0 ... 1'),
    ({'percentage': 64.0}, 'percentage: 64 is not allowed; it must be 0 ... 1'),
    ({'stamp': Time()}, UNSET_STAMP),
])
def test_bad_battery_state(fields, problem):
    assert problems_of(measurement_from_message, battery_message(**fields)) == [problem]


def test_every_bad_field_of_a_battery_state_is_named():
    problems = problems_of(measurement_from_message,
                           battery_message(Time(), temperature=nan, percentage=2.0))
    assert [problem.partition(':')[0] for problem in problems] == [
        'temperature', 'percentage', 'header.stamp']


@pytest.mark.parametrize('soc', [0.0, 1.0])
def test_the_ends_of_the_state_of_charge_are_allowed(soc):
    message = battery_message(percentage=soc, present=True)
    assert measurement_from_message(message).state.soc == soc


@pytest.mark.parametrize('percentage, soc', [
    # The next number of single precision above 1; a byte that counts 0.4 %, at 100.4 %.
    (1.0 + 2.0**-23, 1.0), (251 * 0.004, 1.0), (1.0049, 1.0), (-0.0049, 0.0), (-1e-9, 0.0)])
def test_a_percentage_that_was_rounded_is_that_of_the_end(percentage, soc):
    assert measurement_from_message(battery_message(percentage=percentage)).state.soc == soc


def test_the_event_of_a_refused_state_has_its_percentage():
    assert battery_event(battery_message(percentage=64.0)).percentage == 64.0
    assert battery_event(battery_message(temperature=nan, percentage=0.25)).percentage == 0.25


@pytest.mark.parametrize('hint', ['', 'the publisher sends degrees Fahrenheit'])
def test_a_hint_follows_the_problems_of_an_unreadable_battery_state(hint):
    unread = battery_event(battery_message(temperature=nan), hint)
    without = battery_event(battery_message(temperature=nan))
    assert unread.error.problems == [*without.error.problems, *([hint] if hint else [])]


# Cells: their order, and NaN among them, must not matter.
CELLS_C = [4.0, nan, 1.5, 9.5]


def test_cells_stand_for_a_temperature_that_is_not_known():
    measurement = measurement_from_message(
        battery_message(temperature=nan, cell_temperature=CELLS_C))
    assert (measurement.state.temperature_c, measurement.coldest_cell_c, measurement.cell_spread_k) == (
        5.0, 1.5, 8.0)
    assert measurement.cell_warning == ''


def test_a_temperature_goes_before_the_mean_of_the_cells():
    measurement = measurement_from_message(battery_message(cell_temperature=CELLS_C))
    assert (measurement.state.temperature_c, measurement.coldest_cell_c, measurement.cell_spread_k) == (
        -5.0, 1.5, 8.0)


@pytest.mark.parametrize('cells_c', [[], [nan, nan], [inf, -inf]])
def test_without_a_known_cell_there_is_no_coldest(cells_c):
    measurement = measurement_from_message(battery_message(cell_temperature=cells_c))
    assert (measurement.coldest_cell_c, measurement.cell_spread_k, measurement.cell_warning) == (None, None, '')
    assert problems_of(measurement_from_message, battery_message(
        temperature=nan, cell_temperature=cells_c)) == [
            'temperature: nan is not a known value; it must be a finite number, in degC']


@pytest.mark.parametrize('code_c, shown', [(215.0, '215'), (-273.0, '-273')])
def test_a_code_for_a_missing_sensor_is_no_cell(code_c, shown):
    cells_c = [4.0, code_c, 1.5]
    assert problems_of(measurement_from_message, battery_message(
        temperature=nan, cell_temperature=cells_c)) == [
            f'cell_temperature: {shown} is not allowed; it must be -60 ... 100 degC, or NaN: unknown']
    measurement = measurement_from_message(battery_message(cell_temperature=cells_c))
    assert (measurement.state.temperature_c, measurement.coldest_cell_c) == (-5.0, None)


@pytest.mark.parametrize('warmest_c, warning', [
    (12.0, ''),
    (12.5, 'cell_temperature: the cells differ by 10.5 K, the coldest is at 2.0 degC; at most 10 K are '
     'expected')])
def test_cells_that_differ_widely_are_reported(warmest_c, warning):
    assert measurement_from_message(
        battery_message(cell_temperature=[2.0, warmest_c])).cell_warning == warning


def test_supply_status_and_names_of_a_battery():
    for name in ('UNKNOWN', 'CHARGING', 'DISCHARGING', 'NOT_CHARGING', 'FULL'):
        measurement = measurement_from_message(battery_message(
            power_supply_status=getattr(BatteryStateMessage, f'POWER_SUPPLY_STATUS_{name}'),
            location='under the floor', serial_number='T-7'))
        assert measurement.supply_status is SupplyStatus[name]
        assert (measurement.location, measurement.serial_number) == ('under the floor', 'T-7')
    assert measurement_from_message(
        battery_message(power_supply_status=77)).supply_status is SupplyStatus.UNKNOWN


EVIDENCE = ('voltage', 'current', 'charge', 'capacity', 'design_capacity')


@pytest.mark.parametrize('unset', [0.0, nan])
def test_a_percentage_of_0_with_nothing_else_is_not_given(unset):
    assert problems_of(measurement_from_message, battery_message(
        percentage=0.0, **dict.fromkeys(EVIDENCE, unset))) == [
            'percentage: 0 counts as not given where present is false and voltage, current, '
            'charge, capacity, design_capacity are unset too; it must be 0 ... 1, and a battery '
            'that is really empty says "present: true" or its voltage']


@pytest.mark.parametrize('field, value', [
    ('present', True), ('voltage', 310.0), ('current', -5.0), ('charge', 0.5),
    ('capacity', 190.0), ('design_capacity', 200.0)])
def test_an_empty_battery_with_another_value_is_empty(field, value):
    message = battery_message(percentage=0.0, **{
        **dict.fromkeys(EVIDENCE, nan), field: value})
    assert measurement_from_message(message).state.soc == 0.0


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
    assert problems_of(lambda: convert(**{field: values})) == [
        f'{field}[1]: {text} is not allowed; it must be {LIMITS_TEXT[field]}']


@pytest.mark.parametrize('field, values, problem', [
    ('segment_duration', [10.0, 20.0, -30.0],
     'segment_duration[2]: -30 is not allowed; it must be 0.001 ... 86400 s'),
    ('segment_duration', [0.0, 20.0, 0.0],
     'segment_duration[0]: 0 is not allowed; it must be 0.001 ... 86400 s (and 1 more)'),
    ('speed', [11.0, 130.0, 13.0], 'speed[1]: 130 is not allowed; it must be 0 ... 100 m/s'),
    ('speed', [-1.0], 'speed[0]: -1 is not allowed; it must be 0 ... 100 m/s'),
    ('ambient_temperature', [266.0],
     'ambient_temperature[0]: 266 is not allowed; it must be -60 ... 60 degC'),
    ('cabin_heating_power', [710.0, -1.0, 730.0],
     'cabin_heating_power[1]: -1 is not allowed; it must be 0 ... 50000 W'),
    ('auxiliary_power', [-5.0], 'auxiliary_power[0]: -5 is not allowed; it must be 0 ... 50000 W'),
    ('propulsion_power_rms', [1.5e3, 1.9e3, 3.5e3],
     'propulsion_power_rms[1]: 1900 is below the magnitude of the mean, 2000'),
    ('segment_duration', [86000.0, 300.0, 200.0],
     'segment_duration: the route lasts 86500 s; at most 86400 s are planned'),
    ('speed', [11.0, 12.0],
     'speed: has 2 values; it must have 1 or 3, the length of the longest array'),
    ('auxiliary_power', [310.0, 320.0],
     'auxiliary_power: has 2 values; it must have 1 or 3, the length of the longest array'),
    ('segment_duration', [], 'missing or empty: segment_duration'),
    ('speed', [], 'missing or empty: speed'),
    ('propulsion_power', [], 'missing or empty: propulsion_power'),
    ('ambient_temperature', [], 'missing or empty: ambient_temperature'),
    ('minimum_arrival_soc', -0.5, 'minimum_arrival_soc: -0.5 is not allowed; it must be 0 ... 1'),
    ('minimum_arrival_soc', 20.0, 'minimum_arrival_soc: 20 is not allowed; it must be 0 ... 1'),
    ('minimum_arrival_soc', nan, 'minimum_arrival_soc: nan is not allowed; it must be 0 ... 1'),
    ('target_battery_temperature', inf, 'target_battery_temperature: inf is not allowed; it must '
     "be finite, or 0 or NaN: the planner's own default"),
    ('route_id', 'x' * 257, f"route_id: '{'x' * 60}' … (257 characters) is too long; it must have "
     'at most 256 characters'),
    ('stamp', Time(), UNSET_STAMP),
    ('stamp', Time(sec=2**31 - 20), 'header.stamp: 2147483628 s is too late: the route would end '
     'after the last instant that a stamp can hold'),
])
def test_bad_route(field, values, problem):
    assert problems_of(lambda: convert(**{field: values})) == [problem]


@pytest.mark.parametrize('soc', [0.0, 1.0])
def test_the_charge_wanted_on_arrival_may_be_none_or_all(soc):
    assert convert(minimum_arrival_soc=soc).legs[-1].minimum_arrival_soc == soc


def test_a_longer_array_makes_the_others_too_short():
    problems = problems_of(lambda: convert(speed=[11.0] * 4))
    assert [problem.partition(':')[0] for problem in problems] == [
        name for name in ARRAYS if name != 'speed']


def test_no_segments_are_named_as_all_that_is_missing():
    assert problems_of(mission_from_message, route_message(**dict.fromkeys(ARRAYS, [])), DEFAULTS,
                       30.0) == [
        'missing or empty: segment_duration, speed, propulsion_power, ambient_temperature']


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


def test_as_many_segments_as_are_planned_are_accepted():
    route = convert_leg(segment_duration=array('d', [0.01]) * 200_000, **{
        name: [{'propulsion_power_rms': 5.0, 'propulsion_power_magnitude': 4.0}.get(name, 1.0)]
        for name in ARRAYS if name != 'segment_duration'}).route
    assert route.total_duration_s == pytest.approx(2000.0)


def test_a_long_route_id_that_is_allowed_is_kept():
    assert convert(route_id='ü' * 256).route_id == 'ü' * 256


def test_the_message_about_a_huge_route_id_is_short():
    problem, = problems_of(lambda: convert(route_id='x' * 1_000_000))
    assert len(problem) < 200 and '(1000000 characters)' in problem


def test_every_bad_field_of_a_route_is_named():
    problems = problems_of(lambda: convert(
        stamp=Time(), minimum_arrival_soc=2.0, segment_duration=[-1.0], speed=[nan],
        auxiliary_power=[1.0, 2.0]))
    assert [re.match(r'[\w.]+', problem)[0] for problem in problems] == [
        'header.stamp', 'minimum_arrival_soc', 'segment_duration', 'speed', 'auxiliary_power']


# Route: conversion

def test_fields_of_a_mission():
    mission = convert()
    leg, = mission.legs
    assert (mission.route_id, leg.start_ns, leg.charging_planned, leg.target_temperature_c,
            leg.minimum_arrival_soc, leg.departure) == (
        'to the charger', 1_700_000_000_250_000_000, True, 27.0, 0.15, None)


@pytest.mark.parametrize('value, has, target_c', [
    (0.0, False, None), (-0.0, False, None), (nan, False, None), (0.0, True, 0.0),
    (12.5, False, 12.5), (12.5, True, 12.5), (-3.0, False, -3.0)])
def test_target_of_0_counts_where_it_is_said_to_be_there(value, has, target_c):
    leg = convert_leg(target_battery_temperature=value, has_target_battery_temperature=has)
    assert leg.target_temperature_c == target_c


def test_a_target_that_is_said_to_be_there_must_be_a_number():
    assert problems_of(lambda: convert(
        target_battery_temperature=nan, has_target_battery_temperature=True)) == [
            'target_battery_temperature: nan is not allowed where has_target_battery_temperature '
            'is true; it must be finite']


# Cancellation

def test_an_empty_message_is_a_cancellation():
    assert is_cancellation(RoutePlan())


@pytest.mark.parametrize('field, value', [
    ('route_id', 'home'), ('minimum_arrival_soc', nan), ('target_battery_temperature', inf),
    ('has_target_battery_temperature', True)])
def test_a_cancellation_may_hold_anything_but_a_trip(field, value):
    assert is_cancellation(RoutePlan(**{field: value}))


@pytest.mark.parametrize('field, value', [
    ('charging_planned', True), *((name, [1.0]) for name in ARRAYS), ('stop_after_segment', [0]),
    ('stop_duration', [60.0]), ('stop_target_battery_temperature', [1.0]),
    ('stop_has_target_battery_temperature', [False]), ('stop_minimum_arrival_soc', [0.0]),
    ('departure_battery_temperature', [1.0]), ('departure_soc', [0.5])])
def test_what_holds_some_of_a_trip_is_no_cancellation(field, value):
    assert not is_cancellation(RoutePlan(**{field: value}))


def test_no_field_is_forgotten_where_a_cancellation_is_told_from_a_trip():
    arrays = {name for name, kind in RoutePlan.get_fields_and_field_types().items()
              if kind.startswith('sequence')}
    assert {field for field in arrays if is_cancellation(RoutePlan(**{field: [1]} if field in (
        'stop_after_segment',) else {field: [True]} if 'has' in field else {field: [1.0]}))} == set()


@pytest.mark.parametrize('field, name', ROUTE_FIELDS.items())
def test_each_array_goes_to_its_field(field, name):
    # A step of 10 s keeps the first segment as it is.
    value = getattr(convert_leg(step_s=10.0).route, field)[0]
    assert value == pytest.approx(getattr(route_message(), name)[0])


@pytest.mark.parametrize('name', [name for name in ARRAYS if name != 'segment_duration'])
def test_an_array_of_one_holds_in_every_segment(name):
    value = {'propulsion_power_rms': 4e3, 'propulsion_power_magnitude': 3.3e3}.get(name, 7.0)
    field = next(field for field, other in ROUTE_FIELDS.items() if other == name)
    # Some of these routes have constant columns.
    rest = {} if name == 'propulsion_power_magnitude' else {'propulsion_power_magnitude': []}
    if name in ('propulsion_power', 'propulsion_power_magnitude'):
        rest['propulsion_power_rms'] = [8e3]
    route = convert_leg(step_s=10.0, **rest, **{name: [value]}).route
    assert getattr(route, field).tolist() == pytest.approx([value] * 6)


def test_a_single_duration_holds_in_every_segment():
    assert convert_leg(segment_duration=[40.0]).route.total_duration_s == pytest.approx(120.0)


@pytest.mark.parametrize('name, field, expected', [
    ('cabin_heating_power', 'cabin_heating_power_w', [1111.0] * 6),
    ('auxiliary_power', 'auxiliary_power_w', [222.0] * 6),
    ('propulsion_power_rms', 'propulsion_power_rms_w', [1e3, 2e3, 2e3, 3e3, 3e3, 3e3]),
    ('propulsion_power_magnitude', 'propulsion_power_magnitude_w', [
        magnitude_w(*powers) for powers in ((1e3, 1.5e3), *[(-2e3, 2.5e3)] * 2,
                                            *[(3e3, 3.5e3)] * 3)]),
])
def test_an_empty_optional_array_takes_its_default(name, field, expected):
    route = convert_leg(step_s=10.0, **{'propulsion_power_magnitude': [], name: []}).route
    assert getattr(route, field).tolist() == pytest.approx(expected)


@pytest.mark.parametrize('name', [name for name in ARRAYS if name != 'segment_duration'])
@pytest.mark.parametrize('step_s', [7.0, 30.0])
def test_steps_keep_what_a_route_sums_up_to(name, step_s):
    seeded = random.Random(3)
    durations_s = [seeded.uniform(0.2, 90.0) for _ in range(50)]
    powers_w = [seeded.uniform(-9e3, 50e3) for _ in range(50)]
    values = {
        'segment_duration': durations_s, 'propulsion_power': powers_w,
        'propulsion_power_magnitude': [abs(power) + seeded.uniform(0.0, 2e3) for power in powers_w],
        'propulsion_power_rms': [abs(power) + seeded.uniform(2e3, 5e3) for power in powers_w],
        **{other: [seeded.uniform(0.0, 50.0) for _ in range(50)] for other in (
            'speed', 'ambient_temperature', 'cabin_heating_power', 'auxiliary_power')}}
    route = convert_leg(step_s=step_s, **values).route
    field = next(field for field, other in ROUTE_FIELDS.items() if other == name)
    order = 2 if name == 'propulsion_power_rms' else 1
    assert route.duration_s @ getattr(route, field)**order == pytest.approx(
        sum(duration_s * value**order for duration_s, value in zip(durations_s, values[name])))


def test_steps_are_as_long_as_asked_for():
    assert convert_leg(step_s=25.0).route.duration_s.tolist() == pytest.approx([25.0, 25.0, 10.0])


def legs_strategy(draw):
    """Return Legs of three segments each, with all fields that a message can hold."""
    targets_c = st.one_of(st.none(), st.just(0.0), st.floats(-60.0, 60.0))
    shares = st.floats(0.0, 1.0)
    route = convert_leg(step_s=10.0).route
    count = draw(st.integers(1, 4))
    legs = [Leg(route, 1_650_000_000_123_456_789, draw(st.booleans()) or at < count - 1,
                draw(targets_c), draw(shares),
                None if at == 0 else BatteryState(
                    draw(st.floats(-60.0, 60.0)), draw(st.floats(1e-3, 1.0))))
            for at in range(count)]
    return with_stops(legs, [draw(st.floats(1.0, 86400.0)) for _ in legs[1:]])


@pytest.mark.parametrize('standing_time_s', [float('nan'), float('inf'), float('-inf'), -1.0])
def test_a_standing_time_that_is_none_is_refused(standing_time_s):
    assert problems_of(lambda: convert(standing_time=standing_time_s)) == [
        f'standing_time: {standing_time_s:g} is not allowed; it must be finite and at least 0 s '
        '(0: not known)']


@pytest.mark.parametrize('standing_time_s', [0.0, 1.0, 1e300])
def test_any_other_standing_time_is_taken(standing_time_s):
    assert convert(standing_time=standing_time_s).standing_time_s == standing_time_s


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
        assert back.start_ns == pytest.approx(leg.start_ns, abs=1000)
        for field in ROUTE_FIELDS:
            np.testing.assert_allclose(getattr(back.route, field), getattr(leg.route, field),
                                       rtol=1e-12, err_msg=field)


@pytest.mark.parametrize('instant_ns', [0, 1, 999_999_999, NS_PER_S, 1_700_000_000_000_000_001])
def test_time_to_message_and_back(instant_ns):
    assert nanoseconds(time_message(instant_ns)) == instant_ns


# Outgoing messages

def test_command():
    message = command_message(
        Command(4321.0, 12_000_000_345, Status.HEATING), now_ns=10_000_000_678)
    assert (message.battery_heating_power, message.reason, message.valid_until,
            message.header.stamp) == (4321.0, HvchCommand.HEATING, Time(sec=12, nanosec=345),
                                      Time(sec=10, nanosec=678))


@pytest.fixture(scope='module')
def decision():
    """Return a decision whose plan waits for a while."""
    route = make_route({
        'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
        'ambient_temperature_c': [-7.0]}, VEHICLE.defaults)
    plan = plan_preheating(VEHICLE, route, BatteryState(18.0, 0.8), Goal(24.0))
    assert 0.0 < plan.heating_start_s < 1200.0
    return Decision(plan.status, plan.explanation, plan, 50 * NS_PER_S)


@pytest.fixture(scope='module')
def message(decision):
    return plan_message(decision, EAST, now_ns=99 * NS_PER_S)


def test_plan_is_stamped_where_its_trajectories_start(message):
    assert message.header.stamp == Time(sec=50)


@pytest.mark.parametrize('field, attribute', [
    ('method', 'method'), ('status', 'status'), ('explanation', 'explanation'),
    ('predicted_arrival_temperature', 'arrival_temperature_c'),
    ('predicted_arrival_soc', 'arrival_soc'),
    ('target_battery_temperature', 'target_temperature_c'), ('shortfall', 'shortfall_k'),
    ('soc_shortfall', 'soc_shortfall'), ('undeliverable_power', 'undeliverable_power_w'),
    ('planning_time', 'planning_time_s')])
def test_figure_of_a_plan(message, decision, field, attribute):
    assert getattr(message, field) == getattr(decision.plan, attribute)


@pytest.mark.parametrize('field, energy', [
    ('joule_energy', 'joule'), ('drivetrain_heat_energy', 'drivetrain_heat'),
    ('hvch_electric_energy', 'hvch_electric'), ('hvch_heat_energy', 'hvch_heat'),
    ('leakage_energy', 'leakage'), ('battery_energy', 'battery_total')])
def test_energy_of_a_plan(message, decision, field, energy):
    assert getattr(message, field) == getattr(decision.plan.energy_wh, energy)


@pytest.mark.parametrize('field, attribute', [
    ('time', 'time_s'), ('battery_temperature', 'battery_temperature_c'), ('soc', 'soc'),
    ('hvch_power', 'hvch_battery_power_w')])
def test_trajectory_of_a_plan(message, decision, field, attribute):
    assert list(getattr(message, field)) == getattr(decision.plan, attribute).tolist()


def test_heat_under_way_of_a_plan(message):
    vehicle = replace(VEHICLE, heat_path=HeatPath(60.0, 20e3, 400.0))
    route = make_route({'duration_s': [30.0] * 40, 'speed_mps': [20.0], 'propulsion_power_w': [20e3],
                        'ambient_temperature_c': [-7.0]}, vehicle.defaults)
    plan = plan_preheating(vehicle, route, BatteryState(18.0, 0.8, 3000.0, 4.0), Goal(24.0))
    heated = plan_message(Decision(plan.status, '', plan, 0), EAST, 0)
    assert (list(heated.heater_power), list(heated.coolant_excess_temperature)) == (
        plan.heat.heater_power_w.tolist(), plan.heat.coolant_excess_k.tolist())
    assert len(heated.heater_power) == len(heated.time)
    assert (heated.heater_power[0], heated.coolant_excess_temperature[0]) == (3000.0, 4.0)
    assert not message.heater_power and not message.coolant_excess_temperature


def test_instants_of_a_plan(message, decision):
    start_ns = round(decision.plan.heating_start_s * NS_PER_S)
    assert (message.route_id, message.heating_planned, nanoseconds(message.heating_start),
            nanoseconds(message.arrival)) == (
        'east', True, 50 * NS_PER_S + start_ns, (50 + 1200) * NS_PER_S)


# Four heating intervals, one for each reason, all figures different.
STRETCHES = (HeatingInterval(10.0, 15.5, 7.25, Reason.CLIMB),
             HeatingInterval(30.0, 90.0, 61.0, Reason.DESCENT),
             HeatingInterval(90.0, 400.0, 330.5, Reason.SURPLUS),
             HeatingInterval(777.0, 1200.0, 590.75, Reason.ARRIVAL))


@pytest.mark.parametrize('intervals, field, expected', [
    (STRETCHES, 'stretch_start', [10.0, 30.0, 90.0, 777.0]),
    (STRETCHES, 'stretch_end', [15.5, 90.0, 400.0, 1200.0]),
    (STRETCHES, 'stretch_energy', [7.25, 61.0, 330.5, 590.75]),
    (STRETCHES, 'stretch_reason', [
        PreheatPlan.STRETCH_CLIMB, PreheatPlan.STRETCH_DESCENT, PreheatPlan.STRETCH_SURPLUS,
        PreheatPlan.STRETCH_ARRIVAL]),
    ((), 'stretch_start', []), ((), 'stretch_end', []), ((), 'stretch_energy', []),
    ((), 'stretch_reason', [])])
def test_heating_intervals_of_a_plan(decision, intervals, field, expected):
    plan = replace(decision.plan, intervals=intervals)
    message = plan_message(replace(decision, plan=plan), EAST, now_ns=99 * NS_PER_S)
    assert list(getattr(message, field)) == expected


@pytest.mark.parametrize('field', ['shortfall', 'soc_shortfall', 'undeliverable_power'])
def test_each_lack_goes_to_its_own_field(decision, field):
    lacks = {'shortfall': 1.5, 'soc_shortfall': 0.0625, 'undeliverable_power': 4321.0}
    plan = replace(decision.plan, shortfall_k=1.5, soc_shortfall=0.0625,
                   undeliverable_power_w=4321.0)
    message = plan_message(replace(decision, plan=plan), EAST, now_ns=99 * NS_PER_S)
    assert getattr(message, field) == lacks[field]


def test_where_the_charge_runs_out(decision):
    plan = replace(decision.plan, stranding=Stranding(at_s=450.5, at_m=8125.0, deficit_wh=2250.0))
    message = plan_message(replace(decision, plan=plan), EAST, now_ns=99 * NS_PER_S)
    # The plan starts at 50 s.
    assert (nanoseconds(message.charge_runs_out), message.charge_runs_out_distance,
            message.lacking_energy) == (500.5 * NS_PER_S, 8125.0, 2250.0)


def test_charge_that_carries_the_trip_runs_out_nowhere(message):
    assert message.charge_runs_out == Time()
    assert np.isnan([message.charge_runs_out_distance, message.lacking_energy]).all()


@pytest.mark.parametrize('field', [
    'stretch_start', 'stretch_end', 'stretch_energy', 'stretch_reason'])
def test_without_a_plan_there_are_no_heating_intervals(field):
    message = plan_message(Decision(Status.DISABLED, 'No.'), None, now_ns=7 * NS_PER_S)
    assert len(getattr(message, field)) == 0


def test_without_a_plan_the_figures_are_unknown():
    message = plan_message(Decision(Status.DISABLED, 'No.'), None, now_ns=7 * NS_PER_S)
    figures = [name for name, kind in PreheatPlan.get_fields_and_field_types().items()
               if kind == 'double' and name not in ('delay', 'planning_time')]
    assert (len(figures), [name for name in figures if not np.isnan(getattr(message, name))],
            message.route_id, message.heating_planned, len(message.time), message.header.stamp,
            message.arrival) == (21, [], '', False, 0, Time(sec=7), Time())


@pytest.mark.parametrize('delay_ns, delay_s', [(0, 0.0), (90 * NS_PER_S, 90.0), (-NS_PER_S // 2, -0.5)])
def test_the_delay_of_a_mission_is_told_with_and_without_a_plan(decision, delay_ns, delay_s):
    for told in (decision, Decision(Status.DISABLED, 'No.')):
        assert plan_message(told, EAST.delayed(delay_ns), now_ns=0).delay == delay_s
    assert plan_message(Decision(Status.NO_ROUTE, 'No.'), None, now_ns=0).delay == 0.0


@pytest.mark.parametrize('deviation_k, variance', [(nan, 0.0), (0.75, 0.5625)])
def test_predicted_temperature(decision, deviation_k, variance):
    message = temperature_message(
        replace(decision, forecast=SimpleNamespace(deviation_k=deviation_k)), now_ns=8 * NS_PER_S)
    assert (message.temperature, message.variance, message.header.stamp) == (
        decision.plan.arrival_temperature_c, variance, Time(sec=8))


def test_deviation_of_the_predicted_temperature(decision):
    message = plan_message(
        replace(decision, forecast=SimpleNamespace(deviation_k=0.625)), EAST, 99 * NS_PER_S)
    assert message.predicted_arrival_temperature_deviation == 0.625


@pytest.mark.parametrize('heating_end_s, end_s', [(None, 50 + 1200), (700.5, 750.5)])
def test_end_of_heating(decision, heating_end_s, end_s):
    plan = replace(decision.plan, heating_end_s=heating_end_s)
    message = plan_message(replace(decision, plan=plan), EAST, now_ns=99 * NS_PER_S)
    assert nanoseconds(message.heating_end) == round(end_s * NS_PER_S)


def test_without_heating_it_has_no_end(decision):
    plan = replace(decision.plan, heating_start_s=None)
    message = plan_message(replace(decision, plan=plan), EAST, now_ns=99 * NS_PER_S)
    assert message.heating_end == Time()


# Voltage and current: discharging is positive here, negative in sensor_msgs

@pytest.mark.parametrize('voltage, current, expected', [
    (400.0, -50.0, (400.0, 50.0)), (390.0, 12.5, (390.0, -12.5)),
    (0.0, -50.0, (None, None)), (400.0, 0.0, (400.0, 0.0)), (nan, -50.0, (None, None)),
    (400.0, nan, (None, None)), (-400.0, 5.0, (None, None)),
    (inf, 5.0, (None, None)), (400.0, -inf, (None, None)), (400.0, 1e6, (None, None))])
def test_voltage_and_current(voltage, current, expected):
    message = BatteryStateMessage(temperature=-7.0, percentage=0.5, voltage=voltage,
                                  current=current)
    message.header.stamp = Time(sec=5)
    measurement = measurement_from_message(message)
    assert (measurement.voltage_v, measurement.current_a) == expected


# Enums: the message files are the contract

@pytest.mark.parametrize('name', ['HvchCommand', 'PreheatPlan'])
def test_constants_of_the_message_are_the_statuses(name):
    text = (MESSAGES / f'{name}.msg').read_text()
    constants = dict(re.findall(r'^uint8 ([A-Z_]+)=(\d+)', text, re.MULTILINE))
    reasons = {'PreheatPlan': {
        **{f'STRETCH_{reason.name}': reason.value for reason in Reason},
        **{f'TARGET_{source.name}': source.value for source in TargetSource}}}
    assert {key: int(value) for key, value in constants.items()} == {
        **{status.name: status.value for status in Status}, **reasons.get(name, {})}


@pytest.mark.parametrize('message_type', [HvchCommand, PreheatPlan])
@pytest.mark.parametrize('status', Status)
def test_constants_as_built_are_the_statuses(message_type, status):
    assert getattr(message_type, status.name) == status.value


@pytest.mark.parametrize('reason', Reason)
def test_constants_as_built_are_the_reasons(reason):
    assert getattr(PreheatPlan, f'STRETCH_{reason.name}') == reason.value


@pytest.mark.parametrize('source', TargetSource)
def test_constants_as_built_are_the_sources_of_a_target(source):
    assert getattr(PreheatPlan, f'TARGET_{source.name}') == source.value
