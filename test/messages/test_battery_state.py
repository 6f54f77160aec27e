# SPDX-License-Identifier: Apache-2.0
"""Battery states in messages: what is read of them, refusals and their wording."""

from math import inf, isnan, nan

from builtin_interfaces.msg import Time
import pytest
from refusals import problems_of
from sensor_msgs.msg import BatteryState as BatteryStateMessage

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.messages.battery_state import measurement_from_message

STAMP = Time(sec=1_700_000_000, nanosec=250_000_000)
UNSET_STAMP = 'header.stamp: is 0; it must be set, as "header: auto" of ros2 topic pub does'


def battery_message(stamp=STAMP, **fields):
    message = BatteryStateMessage(**{'temperature': -5.0, 'percentage': 0.5, **fields})
    message.header.stamp = stamp
    return message


@pytest.mark.parametrize('fields, problem', [
    ({'temperature': nan}, 'temperature: nan is not a known value; it must be a finite number, in degC'),
    ({'temperature': -inf}, 'temperature: -inf is not a known value; it must be a finite number, in degC'),
    ({'percentage': nan}, 'percentage: nan is not a known value; it must be 0 ... 1'),
    ({'percentage': inf}, 'percentage: inf is not a known value; it must be 0 ... 1'),
    ({'percentage': 1.0051}, 'percentage: 1.0051 is not allowed; it must be 0 ... 1'),
    ({'percentage': -0.0051}, 'percentage: -0.0051 is not allowed; it must be 0 ... 1'),
    ({'percentage': 64.0}, 'percentage: 64 is not allowed; it must be 0 ... 1'),
    ({'stamp': Time()}, UNSET_STAMP),
])
def test_bad_battery_state(fields, problem):
    assert problems_of(measurement_from_message, battery_message(**fields)) == [problem]


@pytest.mark.parametrize('percentage, soc', [
    (0.0, 0.0), (1.0, 1.0),
    # The next number of single precision above 1; a byte that counts 0.4 %, at 100.4 %.
    (1.0 + 2.0**-23, 1.0), (251 * 0.004, 1.0), (1.0049, 1.0), (-0.0049, 0.0), (-1e-9, 0.0)])
def test_a_percentage_at_an_end_or_rounded_beyond_it_is_that_of_the_end(percentage, soc):
    message = battery_message(percentage=percentage, present=True)
    assert measurement_from_message(message).state.soc == soc


# Cells


@pytest.mark.parametrize('code_c, shown', [(215.0, '215'), (-273.0, '-273')])
def test_a_code_for_a_missing_sensor_is_no_cell(code_c, shown):
    cells_c = [4.0, code_c, 1.5]
    assert problems_of(measurement_from_message, battery_message(
        temperature=nan, cell_temperature=cells_c)) == [
            f'cell_temperature: {shown} is not allowed; it must be -60 ... 100 degC, or NaN: unknown']
    measurement = measurement_from_message(battery_message(cell_temperature=cells_c))
    assert (measurement.state.temperature_c, measurement.coldest_cell_c) == (-5.0, None)


@pytest.mark.parametrize('battery_c, cells_c, expected', [
    # A byte 0 with an offset of 40 or 50 K, or a plain 0, in place of modules that are not there.
    (nan, [20.0, -40.0, 22.0, 0.0, -50.0], (21.0, 20.0)), (nan, [12.0, 0.0, 0.0, 0.0], (12.0, 12.0)),
    (21.0, [-40.0, -40.0], (21.0, None)),
    # Real ones: near to others, or other values. Their order, and NaN among them, does not matter.
    (nan, [4.0, nan, 1.5, 9.5], (5.0, 1.5)), (nan, [8.0, 0.0], (4.0, 0.0)), (nan, [-40.0, -36.0], (-38.0, -40.0)),
    (21.0, [0.5, 20.0], (21.0, 0.5))])
def test_cells_stand_for_an_unknown_temperature_without_the_codes_of_missing_modules(battery_c, cells_c, expected):
    measurement = measurement_from_message(battery_message(temperature=battery_c, cell_temperature=cells_c))
    assert (measurement.state.temperature_c, measurement.coldest_cell_c) == expected


@pytest.mark.parametrize('warmest_c, warning', [
    (12.0, ''), (nan, ''),
    (12.5, 'cell_temperature: the cells differ by 10.5 K, the coldest is at 2.0 degC; at most 10 K are '
     'expected')])
def test_cells_that_differ_widely_are_reported(warmest_c, warning):
    measurement = measurement_from_message(battery_message(cell_temperature=[2.0, warmest_c]))
    assert measurement.cell_warning == warning
    assert measurement.cell_spread_k == (0.0 if isnan(warmest_c) else warmest_c - 2.0)


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


# Voltage and current: discharging is positive here, negative in sensor_msgs

@pytest.mark.parametrize('voltage, current, expected', [
    (400.0, -50.0, (400.0, 50.0)), (390.0, 12.5, (390.0, -12.5)),
    (0.0, -50.0, (None, None)), (400.0, 0.0, (400.0, 0.0)), (nan, -50.0, (None, None)),
    (400.0, nan, (None, None)), (-400.0, 5.0, (None, None)),
    (inf, 5.0, (None, None)), (400.0, -inf, (None, None)), (400.0, 1e6, (None, None))])
def test_voltage_and_current(voltage, current, expected):
    measurement = measurement_from_message(battery_message(voltage=voltage, current=current))
    assert (measurement.voltage_v, measurement.current_a) == expected
