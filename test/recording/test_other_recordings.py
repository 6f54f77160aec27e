# SPDX-License-Identifier: Apache-2.0
"""Recordings of `ros2 bag` and drive logs are replayed like flight recordings, or refused in one line."""

import csv
import json

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from recorded_bag import STEPS, topic_messages, TYPES, write_mcap, write_sqlite
from recorded_drive import record_drive
from sensor_msgs.msg import BatteryState

from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.records import definition
from bev_preheat_msgs.msg import HeatSourceCommand

pytestmark = [pytest.mark.needs('mcap', 'rclpy'), pytest.mark.costly]


@pytest.fixture
def replayed(said):
    def run(*words):
        status, output, errors = said('replay', *words, '--json', '-')
        return status, json.loads(output) if output else errors
    return run


@pytest.mark.parametrize('ahead_ns', [pytest.param(0, marks=pytest.mark.deep), 10**17])
def test_a_bag_gives_the_commands_again(recorded, tmp_path, replayed, ahead_ns):
    """Also under simulated time, whose clock is far from the recorder's."""
    outputs, folder = recorded
    bag = write_mcap(tmp_path / 'drive.mcap', topic_messages(folder, ahead_ns=ahead_ns))
    status, result = replayed(bag, '--vehicle', 'reference', '--method', 'value_function')
    assert (status, result['reproduced']) == (0, True)
    assert result['commands'] == sum(output.command is not None for _, output in outputs[:STEPS])
    assert result['recorded']['hvch_commanded_wh'] > 200.0


def weaker(data):
    message = deserialize_message(data, HeatSourceCommand)
    message.battery_heating_power *= 0.9
    return bytes(serialize_message(message))


def test_a_bag_of_a_car_with_several_heat_sources_is_replayed_as_its_flight_recording(tmp_path, replayed):
    record_drive(tmp_path / 'flight', 16.0, 120, vehicle='heat_pump_car')
    messages = list(topic_messages(tmp_path / 'flight', vehicle='heat_pump_car'))
    bag = write_mcap(tmp_path / 'drive.mcap', messages)
    status, of_bag = replayed(bag, '--vehicle', 'heat_pump_car', '--change', 'target=11', '--to', '110')
    assert (status, of_bag['reproduced']) == (0, True)
    _, of_flight = replayed(tmp_path / 'flight', '--change', 'target=11', '--to', '110')
    for drive in ('recorded', 'changed'):
        assert of_bag[drive]['heat_pump_commanded_wh'] == pytest.approx(
            of_flight[drive]['heat_pump_commanded_wh'], abs=2.0), drive
    assert of_bag['changed']['heat_pump_commanded_wh'] < 0.8 * of_bag['recorded']['heat_pump_commanded_wh']
    # Another power of one source is no reproduction.
    bag = write_mcap(tmp_path / 'other.mcap', [(topic, kind, at_ns, weaker(data) if topic == '/heat_source_command'
                                                else data) for topic, kind, at_ns, data in messages])
    status, result = replayed(bag, '--vehicle', 'heat_pump_car')
    assert (status, result['reproduced']) == (1, False)
    assert result['largest_difference_w'] == pytest.approx(300.0, abs=1.0)


def test_the_folder_of_an_sqlite_bag_is_read(recorded, tmp_path, replayed):
    bag = write_sqlite(tmp_path / 'bag', topic_messages(recorded[1]))
    assert replayed(bag)[0] == 0


def test_another_planner_than_the_recorded_one_is_no_reproduction(recorded, tmp_path, replayed):
    bag = write_mcap(tmp_path / 'drive.mcap', topic_messages(recorded[1]))
    status, result = replayed(bag, '--set', 'estimation=false')
    assert (status, result['reproduced']) == (1, False)
    assert '--vehicle' in result['first_difference']['cause']
    # A change is a question, and no failure.
    status, result = replayed(bag, '--change', 'estimation=false')
    assert (status, result['reproduced']) == (0, True)
    assert result['verdict'][-1].startswith('With estimation=false it would have started')


def test_the_planners_of_two_namespaces_are_told_apart(recorded, tmp_path, replayed):
    messages = sorted((message for prefix in ('/a', '/b') for message in topic_messages(recorded[1], prefix)),
                      key=lambda message: message[2])
    bag = write_mcap(tmp_path / 'two.mcap', messages)
    assert '--namespace: /a, /b' in replayed(bag)[1]
    assert replayed(bag, '--namespace', 'b')[1]['reproduced']
    assert "'c' is not in the recording" in replayed(bag, '--namespace', 'c')[1]


def test_without_commands_there_is_nothing_to_reproduce(recorded, tmp_path, replayed):
    bag = write_mcap(tmp_path / 'drive.mcap', topic_messages(recorded[1], has_commands=False))
    status, result = replayed(bag)
    assert (status, result['reproduced'], result['commands']) == (0, None, 0)
    assert any('no commands to reproduce' in remark for remark in result['remarks'])


def test_a_type_with_other_fields_is_refused_by_name(recorded, tmp_path, replayed):
    text = definition('bev_preheat_msgs', 'RoutePlan').replace(b'float64 standing_time', b'float32 standing_time')
    bag = write_mcap(tmp_path / 'old.mcap', topic_messages(recorded[1]), {TYPES['route_plan']: text})
    status, line = replayed(bag)
    assert status == 2 and 'RoutePlan was recorded with other fields' in line and 'standing_time' in line


def log_of(folder, path, columns):
    """Write the recorded drive as a CSV log with the first columns."""
    names = ['timestamp', 'battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'battery_heater_w']
    heater_w = 0.0
    with open(path, 'w', newline='') as file:
        log = csv.writer(file)
        log.writerow(names[:columns])
        for given in read_flight(folder).given[:STEPS]:
            if given.step.command is not None:
                heater_w = given.step.command[0]
            if given.message is not None and given.message[0] == TYPES['battery_state']:
                state = deserialize_message(given.message[1], BatteryState)
                log.writerow([given.step.now_ns / NS_PER_S, state.temperature, state.percentage, state.voltage,
                              -state.current, heater_w][:columns])
    return path


@pytest.mark.deep
def test_a_log_has_the_heaters_power_instead_of_commands(recorded, tmp_path, replayed):
    outputs, folder = recorded
    log = log_of(folder, tmp_path / 'log.csv', 6)
    status, result = replayed(log, '--route', 'reference')
    assert (status, result['source'], result['reproduced']) == (0, 'log', None)
    # The same energy as the drive that the log was made of: two steps a second.
    energy_wh = sum(output.command.battery_heating_power_w for _, output in outputs[:STEPS]) / 2 / 3600
    assert result['recorded']['hvch_delivered_wh'] == pytest.approx(energy_wh, rel=0.02)
    assert energy_wh > 200.0 and result['changed']['statuses']
    assert 'no commands to reproduce' in result['remarks'][-1]
    _, without = replayed(log_of(folder, tmp_path / 'cold.csv', 5), '--route', 'reference')
    assert without['recorded']['hvch_delivered_wh'] == 0.0 and 'counts as 0 W' in without['remarks'][-1]


@pytest.mark.parametrize('columns, words, told', [
    (6, [], 'needs the route'), (6, ['--route', 'nowhere'], "'nowhere'"), (6, ['--namespace', 'a'], '--namespace'),
    (2, ['--route', 'reference'], 'the state of charge')])
def test_a_log_that_lacks_something_is_one_line(recorded, tmp_path, refused, columns, words, told):
    assert told in refused('replay', log_of(recorded[1], tmp_path / 'log.csv', columns), *words)


@pytest.mark.parametrize('share', [
    0.0, 0.3, *(pytest.param(share, marks=pytest.mark.deep) for share in (0.0001, 0.9))])
def test_a_cut_bag_is_read_or_one_line(recorded, tmp_path, replayed, share):
    bag = write_mcap(tmp_path / 'drive.mcap', topic_messages(recorded[1]))
    data = bag.read_bytes()
    bag.write_bytes(data[:round(share * len(data))])
    status, result = replayed(bag)
    if status == 2:
        assert len(result.splitlines()) == 1 and str(bag) in result
    else:
        assert any('ends in the middle' in remark for remark in result['remarks'])


def test_a_folder_of_recordings_with_other_names_says_which_to_name(tmp_path, refused):
    # As of preheat scenario --record.
    (tmp_path / 'nominal.mcap').touch()
    # As a recorder of ros2 bag leaves it that is killed: without metadata.yaml.
    (tmp_path / 'drive_0.db3').write_bytes(b'')
    assert 'name a file: drive_0.db3, nominal.mcap' in refused('replay', tmp_path)
