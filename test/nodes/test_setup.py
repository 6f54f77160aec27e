# SPDX-License-Identifier: Apache-2.0
"""Set-up errors around the installed nodes are described in the log and in the diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from planner_car import LATCHED, state_at
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rehearsal import START_NS
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState, Temperature

from bev_preheat.messages.fields import time_message
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan, RoutePlan

BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def setup_entry(diagnostics, name, text, level=DiagnosticStatus.WARN):
    """Return the message of the setup entry that has the text and the level, once it comes."""
    def entries(array):
        return [status for status in array.status if status.name == f'{name}: setup'
                and status.level == level and text in status.message]

    return entries(diagnostics.wait_for(lambda array: entries(array), f'{name}: {text}'))[0].message


def test_all_is_well_with_what_fits(rehearsal):
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
    planner = rehearsal.start('planner')
    rehearsal.record(HvchCommand, 'hvch_command', BEST_EFFORT)
    # Matches one subscription.
    rehearsal.publisher(RoutePlan, 'route_plan', BEST_EFFORT)
    rehearsal.publisher(BatteryState, 'battery_state', LATCHED)
    rehearsal.advance(5.0)
    assert {status.level for array in diagnostics.messages for status in array.status
            if status.name == 'planner: setup'} == {DiagnosticStatus.OK}
    assert 'WARNING' not in planner.output()


MISFITS = {
    'planner': ('planner', [
        (lambda bench: bench.publisher(Temperature, 'battery_state'),
         '/tester publishes /battery_state as sensor_msgs/msg/Temperature; the type must be '
         'sensor_msgs/msg/BatteryState'),
        (lambda bench: bench.publisher(Temperature, 'route_plan'),
         '/tester publishes /route_plan as sensor_msgs/msg/Temperature; the type must be '
         'bev_preheat_msgs/msg/RoutePlan'),
        (lambda bench: bench.record(HvchCommand, 'hvch_command', LATCHED),
         '/tester subscribes to /hvch_command with an incompatible quality of service: '
         'volatile publisher and transient local subscription')]),
    'type of a subscription': ('planner', [
        (lambda bench: bench.record(Temperature, 'hvch_command', 1),
         '/tester subscribes to /hvch_command as sensor_msgs/msg/Temperature')]),
    'best-effort commands': ('vehicle_simulator', [
        (lambda bench: bench.publisher(HvchCommand, 'hvch_command', BEST_EFFORT),
         '/tester publishes /hvch_command with an incompatible quality of service: '
         'best effort publisher and reliable subscription')]),
    'checker': ('nlp_checker', [
        (lambda bench: bench.publisher(Temperature, 'route_plan'),
         '/tester publishes /route_plan as sensor_msgs/msg/Temperature'),
        (lambda bench: bench.publisher(PreheatPlan, 'preheat_plan'),
         '/tester publishes /preheat_plan with an incompatible quality of service: ')]),
    'second heater': ('heater_controller', [
        (lambda bench: bench.publisher(HvchStatus, 'hvch_status'),
         '/hvch_status has 2 publishers, /heater_controller, /tester; it must have one')]),
}


@pytest.mark.parametrize('name, misfits', MISFITS.values(), ids=MISFITS)
def test_who_does_not_fit_is_named_once_in_the_log_and_forgotten_when_gone(rehearsal, name, misfits):
    diagnostics, process = rehearsal.record(DiagnosticArray, '/diagnostics'), rehearsal.start(name)
    parts, texts = [make(rehearsal) for make, _ in misfits], [text for _, text in misfits]
    for text in texts:
        setup_entry(diagnostics, name, text)
    # Two checks later they are still there, and not logged again.
    diagnostics.clear()
    message = setup_entry(diagnostics, name, texts[0])
    assert all(text in message for text in texts)
    assert [process.output().count(text) for text in texts] == [1] * len(texts)
    for part in parts:
        part.destroy()
    diagnostics.clear()
    setup_entry(diagnostics, name, 'fit', DiagnosticStatus.OK)


def test_who_does_not_fit_is_found_over_dds_and_forgotten_when_gone(bench):
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    bench.start('planner')
    name, misfits = MISFITS['planner']
    parts = [make(bench) for make, _ in misfits]
    for _, text in misfits:
        setup_entry(diagnostics, name, text)
    for part in parts:
        part.destroy()
    diagnostics.clear()
    setup_entry(diagnostics, name, 'fit', DiagnosticStatus.OK)


def refusals(diagnostics):
    return [status.message for array in diagnostics.messages for status in array.status
            if 'battery_state refused' in status.message]


@pytest.mark.parametrize('name', ['nlp_checker', 'planner'])
def test_simulated_stamps_against_the_wall_clock_are_told(rehearsal, name):
    diagnostics, process = rehearsal.record(DiagnosticArray, '/diagnostics'), rehearsal.start(name)
    states = rehearsal.publisher(BatteryState, 'battery_state')
    text = ("days before this node's time, which is the system's: if the sender is simulated or "
            'replayed, set use_sim_time:=true here')
    states.publish(state_at(1000 * 10**9))
    assert text in rehearsal.wait_until(lambda: refusals(diagnostics), 'a refusal')[0]
    assert text in process.output()


# Unknown parameters

def test_a_misspelt_parameter_on_the_command_line_is_told_with_the_nearest(rehearsal):
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
    planner = rehearsal.start('planner', '-p', 'vehicel:=small_car')
    text = "parameter 'vehicel' is unknown and ignored; did you mean 'vehicle'?"
    assert setup_entry(diagnostics, 'planner', text) == text
    assert planner.output().count(text) == 1


def test_parameters_that_ros_knows_are_not_unknown(bench):
    diagnostics = bench.record(DiagnosticArray, '/diagnostics')
    planner = bench.start(
        'planner', '-p', 'use_sim_time:=false', '-p', 'start_type_description_service:=false',
        '-p', 'vehicle:=small_car',
        '-p', 'another_node:colour:=red')
    setup_entry(diagnostics, 'planner', 'fit', DiagnosticStatus.OK)
    assert 'unknown' not in planner.output()


def test_a_file_for_another_node_is_told(rehearsal, tmp_path, monkeypatch):
    path = tmp_path / 'parameters.yaml'
    path.write_text('planer:\n  ros__parameters:\n    vehicle: small_car\n')
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
    arguments = '--params-file', str(path), '-p', 'planner:vehicle:=small_car'
    monkeypatch.setattr('sys.argv', ['planner', '--ros-args', *arguments])
    rehearsal.start('planner', *arguments)
    setup_entry(diagnostics, 'planner', 'the parameter file holds nothing for /planner')


# Clocks

@pytest.mark.parametrize('name', ['planner', 'nlp_checker'])
def test_with_simulated_time_no_clock_and_wall_stamps_are_told(rehearsal, name):
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics')
    process = rehearsal.start(name, '-p', 'use_sim_time:=true')
    text = 'use_sim_time is set and no /clock has arrived: time stands at 0'
    assert setup_entry(diagnostics, name, text) == text
    assert text in process.output()
    clocks, states = rehearsal.publisher(Clock, '/clock'), rehearsal.publisher(BatteryState, 'battery_state')
    diagnostics.clear()

    def tick():
        clocks.publish(Clock(clock=time_message(1000 * 10**9 + rehearsal.now_ns - START_NS)))

    with rehearsal.repeating(tick, 0.1):
        setup_entry(diagnostics, name, 'fit', DiagnosticStatus.OK)
        hint = ("days after this node's time, which is /clock (use_sim_time is set): set "
                'use_sim_time:=true at the sender too, or use_sim_time:=false here')
        states.publish(state_at(rehearsal.now_ns))
        rehearsal.wait_until(lambda: any(hint in refusal for refusal in refusals(diagnostics)), 'the hint')
    assert hint in process.output()
