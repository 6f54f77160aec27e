# SPDX-License-Identifier: Apache-2.0
"""A recorded drive is reproduced to the last digit, and answers what-if questions as a second drive does."""

from dataclasses import replace
import json

import pytest
from recorded_drive import LENGTH_S, no_warning

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.reading import read_recording
from bev_preheat.nodes.recorded_scenario import drive_recorded
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.records import Beginning
from bev_preheat.recording.replay import replay
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.supervised_drive import START_NS

pytestmark = [pytest.mark.needs('mcap', 'rclpy')]


def test_it_is_reproduced_to_the_last_digit(recorded):
    outputs, folder = recorded
    flight = read_flight(folder)
    assert flight.remarks == ()
    replayed = replay(flight)
    assert replayed.comparison.is_reproduced
    commands = [output.command for _, output in outputs if output.command is not None]
    assert replayed.comparison.commands == len(commands) > LENGTH_S
    # It heats, otherwise equality would say little.
    assert replayed.course.heating and replayed.course.energy_wh > 200.0


@pytest.mark.needs('rosbags')
def test_it_is_a_log_too(recorded):
    """Its steps are JSON, which no reader of ROS messages takes for one."""
    _, folder = recorded
    recording = read_recording(next(folder.glob('*.mcap')))
    given = read_flight(folder).given
    temperatures = recording.signals['battery_temperature_c'].value
    # States with the same stamp count as one.
    assert 0.5 * LENGTH_S < len(temperatures) <= sum(each.message is not None for each in given)
    assert temperatures[0] == pytest.approx(10.0, abs=1.0) and temperatures[-1] > temperatures[0] + 1.5
    assert recording.start_s == pytest.approx(START_NS / NS_PER_S, abs=2.0)


def test_a_changed_command_is_found(recorded):
    _, folder = recorded
    flight = read_flight(folder)
    at = next(index for index, given in enumerate(flight.given)
              if given.step.command is not None and given.step.command[0] > 100.0)
    given = flight.given[at]
    object.__setattr__(given.step, 'command', (given.step.command[0] - 50.0, *given.step.command[1:]))
    comparison = replay(flight).comparison
    assert (comparison.different, comparison.first.number) == (1, at)
    assert comparison.largest_w == pytest.approx(50.0)


def test_the_command_says_reproduced_and_compares(recorded, said):
    _, folder = recorded
    status, output, errors = said('replay', folder, '--json', '-')
    result = json.loads(output)
    assert status == 0 and result['reproduced'] and result['changed'] is None
    assert 'each to the last digit' in errors
    status, output, _ = said('replay', folder, '--set', 'estimation=false')
    assert status == 0 and 'changed' in output


def test_simulated_time_that_is_not_set_yet_is_no_start(recorded):
    _, folder = recorded
    flight = read_flight(folder)
    unset = [replace(given, step=replace(given.step, now_ns=number))
             for number, given in enumerate(flight.given[:3])]
    changed = replace(flight, given=(*unset, *flight.given[3:200]))
    assert (changed.begin, changed.start_ns) == (3, flight.given[3].step.now_ns)
    assert replay(changed).course.instants[0].now_ns == flight.given[3].step.now_ns
    assert flight.begin == 0


def test_another_format_is_refused_by_name(recorded):
    values = {**read_flight(recorded[1]).beginning.as_dictionary(), 'format': 99, 'version': '9.9.9'}
    with pytest.raises(InvalidInput, match=r"format '99' of version '9\.9\.9'"):
        Beginning.from_dictionary(values)


@pytest.fixture
def cooled(tmp_path):
    """`cooled(most_c)` returns the recording of a car that arrives with at most that [deg C]."""
    def cooled(most_c):
        path = tmp_path / f'{most_c}.mcap'
        scenario = load_scenario('summer_at_most')
        drive = replace(scenario.first, route=scenario.first.route.before(540.0), goal=Goal(
            25.0, maximum_arrival_temperature_c=most_c))
        drive_recorded(replace(scenario, phases=(drive,), state=BatteryState(38.0, 0.8)),
                       path, no_warning)
        return path

    return cooled


def test_a_drive_that_cools_is_told_and_asked_what_if(cooled, said):
    status, output, errors = said(
        'replay', cooled(36.0), '--change', 'maximum_arrival_temperature=+1', '--json', '-')
    result = json.loads(output)
    recorded, changed = result['recorded'], result['changed']
    assert status == 0 and result['reproduced'] and recorded['heating'] == changed['heating'] == []
    assert len(recorded['cooling']) == 1 and 'cooling begins after' in errors
    assert 'allowed 25.0 … 36.0 degC.' in recorded['results'][0][0]
    assert 'later, used' in result['verdict'][-1] and 'arrived at' in result['verdict'][-1]
    actual = replay(read_flight(cooled(37.0))).course
    assert changed['arrival_temperature_c'] == pytest.approx(actual.arrival.measured_c, abs=0.5)
    assert changed['chiller_commanded_wh'] == pytest.approx(actual.energy_wh, abs=10.0)
    assert recorded['chiller_commanded_wh'] > actual.energy_wh + 30.0
