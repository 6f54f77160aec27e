# SPDX-License-Identifier: Apache-2.0
"""A drive log becomes battery states of a planner that was not there; test_other_recordings.py replays them."""

import math

import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.planning.status import Status
from bev_preheat.recording.changes import Changes
from bev_preheat.recording.recordings import open_recording, Sources
from bev_preheat_msgs.msg import RoutePlan

START_S = 1_700_000_100
COLUMNS = ('timestamp', 'battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'battery_heater_w')


@pytest.fixture
def flight(tmp_path):
    """`flight(columns, rows)` writes a CSV log and gives its Flight."""
    def flight(columns, rows, **parameters):
        path = tmp_path / 'log.csv'
        path.write_text('\n'.join(','.join(map(str, row)) for row in (columns, *rows)) + '\n')
        return open_recording(path, Changes(parameters=parameters), Sources(route='reference'))

    return flight


def states_of(flight):
    return [deserialize_message(given.message[1], BatteryState) for given in flight.given
            if given.message is not None and given.message[0].endswith('BatteryState')]


def commands_of(flight):
    return [given.step.command for given in flight.given if given.step.command is not None]


def test_each_reading_is_a_battery_state_and_the_heaters_power_stands_for_the_command(flight):
    rows = [(START_S + second, 5.0 + second / 100, 0.8 - second / 1e4, 350.0, 20.0, heater_w)
            for second, heater_w in enumerate((0.0, 0.5, 3000.0, 3000.0, 0.0))]
    found = flight(COLUMNS, rows)
    assert (found.source, found.has_commands) == ('log', False)
    first = found.given[0]
    assert first.step.now_ns == START_S * 10**9
    route = deserialize_message(first.message[1], RoutePlan)
    assert len(route.segment_duration) > 10 and nanoseconds(route.header.stamp) == START_S * 10**9
    for row, state in zip(rows, states_of(found), strict=True):
        assert nanoseconds(state.header.stamp) == row[0] * 10**9
        # sensor_msgs has the current negative when discharging.
        assert (state.temperature, state.percentage, state.voltage, state.current) == pytest.approx(
            (*row[1:4], -row[4]), rel=1e-6)
        assert state.present and math.isnan(state.charge)
    powers_w, ends_ns, statuses = zip(*commands_of(found))
    assert powers_w == (0.0, 0.5, 3000.0, 3000.0, 0.0)
    # A value holds for a minute.
    assert ends_ns == tuple((row[0] + 60) * 10**9 for row in rows)
    waiting, heating = int(Status.WAITING), int(Status.HEATING)
    assert statuses == (waiting, waiting, heating, heating, waiting)
    assert 'no commands to reproduce' in found.remarks[-1]


def test_of_several_readings_a_second_the_first_counts(flight):
    found = flight(COLUMNS[:3], [(START_S + tenth / 10, 5.0 + tenth / 10, 0.8) for tenth in range(31)])
    assert [state.temperature for state in states_of(found)] == pytest.approx([5.0, 6.0, 7.0, 8.0])


@pytest.mark.parametrize('parameters, steps', [({}, 9), ({'command_period': 0.5}, 17)])
def test_the_planner_repeats_its_command_between_readings(flight, parameters, steps):
    found = flight(COLUMNS[:3], [(START_S, 5.0, 0.8), (START_S + 8, 5.0, 0.8)], **parameters)
    assert len({given.step.now_ns for given in found.given}) == steps


def test_a_value_that_is_older_than_a_minute_is_unknown(flight):
    rows = [(START_S + second, 5.0, 0.8, 350.0 if second < 1 else '') for second in range(0, 100, 20)]
    assert [state.voltage for state in states_of(flight(COLUMNS[:4], rows))] == pytest.approx(
        [350.0, 350.0, 350.0, 350.0, math.nan], nan_ok=True)


def test_a_log_without_a_date_has_one_in_its_remarks(flight):
    found = flight(('time_s', *COLUMNS[1:3]), [(second, 5.0, 0.8) for second in range(5)])
    assert 'the log has no date; its start counts as 2023-11-14 22:13:20 UTC' in found.remarks
    assert found.given[0].step.now_ns == 1_700_000_000 * 10**9
