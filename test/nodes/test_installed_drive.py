# SPDX-License-Identifier: Apache-2.0
"""Drives in lockstep over DDS, the same on an idle and on a busy computer, or an error; private ROS domains."""

from contextlib import contextmanager, nullcontext
import signal
import socket
import subprocess
import sys

import domain_coordinator
from mcap.reader import make_reader
from node_bench import Bench
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState
from spinning import spun_node
import yaml

from bev_preheat.nodes import installed_drive
from bev_preheat.nodes.installed_drive import drive_with_nodes, reserved_domain_id
from bev_preheat.nodes.recorded_scenario import drive_recorded
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.scenario_drive import drive_scenario, evaluate
from bev_preheat_msgs.msg import HvchCommand, RoutePlan

BUSY_LOOPS = 2
# Noise, losses and delays, so that a state more or less changes all that follow; states drop out until the
# command is 0 W, and a new route arrives on the way.
DRIVE = {
    'name': 'noisy', 'description': 'Noise, losses and delays.', 'seed': 7,
    'drive': {'vehicle': 'reference', 'route': 'reference', 'ends_after_s': 30,
              'initial_battery_temperature_c': 18, 'initial_soc': 0.8},
    'sensors': {'period_s': 0.7, 'delay_s': 0.4, 'loss': 0.1, 'temperature_noise_k': 0.2,
                'drop_outs': [[15, 24]]},
    'traffic': [{'event': 'stop', 'at_s': 8, 'duration_s': 4, 'route_plan_after_s': 2}],
    'expect': {'statuses': ['STALE_INPUT']},
}
# Participants announce themselves every 3 s, and start more slowly beside other tests.
LIMIT_S = 10.0
LOCKSTEP = ('-p', 'lockstep:=true', '-p', f'lockstep_limit:={LIMIT_S}', '-p', 'exit_on_arrival:=true')


@contextmanager
def busy_computer():
    loops = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(BUSY_LOOPS)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def recorded_states(path):
    """Return (instant [ns], message) of each battery state in a flight recording."""
    with open(path, 'rb') as stream:
        return [(message.log_time, deserialize_message(message.data, BatteryState))
                for _, _, message in make_reader(stream).iter_messages(['/battery_state'], log_time_order=False)]


@pytest.mark.parametrize('load', [nullcontext, pytest.param(busy_computer, marks=pytest.mark.deep)],
                         ids=['idle', 'busy'])
def test_a_drive_is_the_same_over_dds_and_without_ros(dds, tmp_path, load):
    file = tmp_path / 'noisy.yaml'
    file.write_text(yaml.safe_dump(DRIVE))
    scenario = load_scenario(str(file))
    over_dds, without_ros = (tmp_path / f'{name}.mcap' for name in ('over_dds', 'without_ros'))
    with load():
        seen = drive_with_nodes(scenario, str(file), recording=over_dds).record
    assert len(seen.commands) > 60
    # Without ROS the timers of an instant come after its battery state, not before; the heater gets the same.
    drive_recorded(scenario, without_ros, pytest.fail)
    states = recorded_states(over_dds)
    assert len(states) > 25
    # NaN fields: not reported.
    assert repr(states) == repr(recorded_states(without_ros)[:len(states)])


def test_the_commands_of_all_heat_sources_are_those_of_the_drive(dds, tmp_path):
    file = tmp_path / 'sources.yaml'
    file.write_text(yaml.safe_dump({
        'name': 'sources', 'description': 'The heat pump is on before the heater.',
        'drive': {'vehicle': 'heat_pump_car', 'route': 'reference', 'ends_after_s': 20,
                  'initial_battery_temperature_c': 5, 'initial_soc': 0.8}, 'expect': {'heats_during': [[5, 20]]}}))
    scenario = load_scenario(str(file))
    over_dds, without_ros = drive_with_nodes(scenario, str(file)).record, drive_scenario(scenario)
    named = {name for command in over_dds.by_source for name, power_w in command.sources_w if power_w > 0.0}
    assert 'heat_pump' in named
    assert over_dds.switch_ons == without_ros.switch_ons == len({'hvch', *named})
    assert max(power_w for _, power_w, _ in over_dds.commands) == pytest.approx(
        max(power_w for _, power_w, _ in without_ros.commands))
    assert [finding for finding in evaluate(scenario.expectations, over_dds) if not finding.good] == []


def test_a_planner_that_no_longer_answers_ends_the_drive_with_an_error(bench):
    planner = bench.start('planner', '-p', 'use_sim_time:=true')
    simulator = bench.start('vehicle_simulator', *LOCKSTEP)
    bench.wait_until(lambda: 'the clock starts' in simulator.output(), 'the start')
    planner.send_signal(signal.SIGSTOP)
    try:
        assert simulator.wait() == 1
    finally:
        planner.send_signal(signal.SIGCONT)
    assert f'No answer of /planner/get_parameters within {LIMIT_S:g} s of real time' in simulator.output()
    assert 'The drive ends after' in simulator.output()


def test_a_planner_that_sends_no_command_ends_the_drive_with_an_error(domain_id, start_executable):
    with spun_node('tester', domain_id, uses_sim_time=True) as node:
        bench = Bench(node, start_executable)
        simulator = connected_simulator(bench)
        assert simulator.wait() == 1
    assert ('No hvch_command with the stamp of /clock answers the battery state: a message was lost. '
            'The drive ends after 0:00 min.') in simulator.output()


def connected_simulator(bench):
    """Start a simulator that takes the test's node for the planner."""
    bench.publisher(HvchCommand, 'hvch_command')
    for message_type, topic in ((BatteryState, 'battery_state'), (RoutePlan, 'route_plan')):
        bench.record(message_type, topic)
    return bench.start('vehicle_simulator', *LOCKSTEP)


def test_a_planner_on_another_clock_is_refused(bench):
    simulator = connected_simulator(bench)
    assert simulator.wait() == 2
    assert '/tester does not follow /clock: start it with use_sim_time:=true' in simulator.output()


# Private ROS domains


# DDSI-RTPS 9.6.1.1: the first participant's port is 10 above the domain's, each next port 2 higher.
# Earlier participants of a domain may have ended.
@pytest.mark.parametrize('participants_before', [0, 1, 6, 30])
def test_domain_in_which_somebody_takes_part_is_left_alone(monkeypatch, participants_before):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        with reserved_domain_id() as taken:
            participant.bind(('127.0.0.1', 7400 + 250 * taken + 10 + 2 * participants_before))
        monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(taken, taken + 1))
        with pytest.raises(RuntimeError, match='are all in use'), reserved_domain_id():
            pass


def test_those_who_reserve_by_the_convention_of_ros_are_respected(monkeypatch):
    with reserved_domain_id() as domain_id:
        monkeypatch.setattr(installed_drive, 'DOMAIN_IDS', range(domain_id, domain_id + 1))
    with domain_coordinator.domain_id(lambda: domain_id):
        with pytest.raises(RuntimeError, match='are all in use'), reserved_domain_id():
            pass
