# SPDX-License-Identifier: Apache-2.0
"""Simulated time: one node publishes `/clock`, and a simulator ends if another does, or drives by it."""

from builtin_interfaces.msg import Time
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds

MANY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
START_S = 1_000_000


def start_in(bench, namespace, *arguments):
    return bench.start('vehicle_simulator', '-r', f'__ns:={namespace}', *arguments)


@pytest.fixture
def errors(capsys):
    """`errors()` returns the lines with an error that the nodes of a rehearsal have printed."""
    return lambda: [line for line in capsys.readouterr().err.splitlines() if 'error:' in line]


def test_the_simulator_that_comes_later_ends_and_says_why(rehearsal, errors):
    clock = rehearsal.record(Clock, '/clock', MANY)
    first = start_in(rehearsal, '/car1', '-p', f'start_time:={START_S}.0')
    # Long enough ago that the first node stays.
    clock.wait_for(lambda message: message.clock.sec > START_S + 3)
    second = start_in(rehearsal, '/car2', '-p', f'start_time:={2 * START_S}.0')
    assert second.wait() == 2
    assert errors() == ['vehicle_simulator: error: /car1/vehicle_simulator also publishes /clock; set '
                        'publish_clock:=false (and use_sim_time:=true) to drive by that clock']
    # Only the first clock keeps running.
    clock.clear()
    assert all(START_S <= message.clock.sec < 2 * START_S
               for message in clock.wait_for_count(100))
    assert first.exit_status is None


def ticking(rehearsal):
    """Publish a clock that stands."""
    clocks = rehearsal.publisher(Clock, '/clock')
    return rehearsal.repeating(lambda: clocks.publish(Clock(clock=Time(sec=START_S))), 0.02)


def test_a_running_simulator_ends_if_another_clock_appears_and_stays(rehearsal, errors):
    simulator = start_in(rehearsal, '/car1')
    rehearsal.advance(3.0)
    with ticking(rehearsal):
        assert simulator.wait() == 2
    (line,) = errors()
    assert '/tester also publishes /clock' in line


def test_without_a_clock_of_its_own_it_can_drive_in_real_time(rehearsal):
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    rehearsal.start('vehicle_simulator', '-p', 'publish_clock:=false', '-p', 'battery_state_period:=0.1')
    began_ns = rehearsal.now_ns
    last = states.wait_for_count(3)[-1]
    # Neither simulated time nor another day's.
    assert began_ns <= nanoseconds(last.header.stamp) <= rehearsal.now_ns < began_ns + 2 * 10**9
    assert rehearsal.count_publishers('/clock') == 0


def test_a_clock_that_is_set_back_ends_a_drive_that_goes_by_it(rehearsal, errors):
    clocks = rehearsal.publisher(Clock, '/clock')
    states = rehearsal.record(BatteryState, 'battery_state', MANY)
    simulator = rehearsal.start(
        'vehicle_simulator', '-p', 'publish_clock:=false', '-p', 'use_sim_time:=true')
    for second in range(5):
        clocks.publish(Clock(clock=Time(sec=START_S + second)))
        rehearsal.advance(1.0)
    assert states.latest.header.stamp.sec > START_S
    clocks.publish(Clock(clock=Time(sec=1000)))
    assert simulator.wait() == 2
    (line,) = errors()
    assert 's; the drive cannot go back' in line


@pytest.mark.parametrize('argument, text', [
    ('speed_up:=20.0', 'speed_up: 20.0 is not allowed with publish_clock:=false; it must be 1.0'),
    ('start_time:=1000.0', 'start_time: 1000.0 is not allowed with publish_clock:=false'),
    ('wait_for_planner:=true', 'wait_for_planner: True is not allowed with'),
    ('lockstep:=true', 'lockstep: True is not allowed with publish_clock:=false; it must be False'),
    ('scenario:=clock_back', 'scenario clock_back makes the clock jump'),
])
def test_what_only_the_owner_of_the_clock_can_do_is_refused(refusal, argument, text):
    assert text in refusal('vehicle_simulator', '--ros-args', '-p', 'publish_clock:=false', '-p', argument)
