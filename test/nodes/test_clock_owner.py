# SPDX-License-Identifier: Apache-2.0
"""Only one node may publish `/clock`: a simulator ends if another does, or drives by that clock."""

import re
import signal
from statistics import median

from builtin_interfaces.msg import Time
from node_bench import repeating
import pytest
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState

from bev_preheat_msgs.msg import RoutePlan

MANY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
START_S = 1_000_000
# The graph shows a killed node for about this time.
GRAPH_FORGETS_S = 20.0


def start_in(bench, namespace, *arguments):
    return bench.start('vehicle_simulator', '-r', f'__ns:={namespace}', *arguments)


def error_lines(process):
    return [line for line in process.output().splitlines() if 'error:' in line]


def test_the_simulator_that_comes_later_ends_and_says_why(bench, call_main):
    clock = bench.record(Clock, '/clock', MANY)
    first = start_in(bench, '/car1', '-p', f'start_time:={START_S}.0')
    # Long enough ago that the first node stays.
    clock.wait_for(lambda message: message.clock.sec > START_S + 3)
    second = call_main(
        'vehicle_simulator', '--ros-args', '-r', '__ns:=/car2', '-p', f'start_time:={2 * START_S}.0')
    assert second.returncode == 2
    (line,) = (line for line in second.stderr.splitlines() if 'error:' in line)
    assert line == (
        'vehicle_simulator: error: /car1/vehicle_simulator also publishes /clock; set '
        'publish_clock:=false (and use_sim_time:=true) to drive by that clock')
    # Only the first clock keeps running.
    clock.clear()
    assert all(START_S <= message.clock.sec < 2 * START_S
               for message in clock.wait_for_count(100))
    assert first.exit_status is None


def test_a_running_simulator_ends_if_another_clock_appears_and_stays(bench):
    clock = bench.record(Clock, '/clock', MANY)
    simulator = start_in(bench, '/car1')
    clock.wait_for()
    clocks = bench.publisher(Clock, '/clock')
    with repeating(lambda: clocks.publish(Clock(clock=Time(sec=START_S))), 0.02):
        assert simulator.wait() == 2
    (line,) = error_lines(simulator)
    assert '/tester also publishes /clock' in line


def test_two_of_one_name_are_told_apart(bench, call_main):
    clock = bench.record(Clock, '/clock', MANY)
    bench.start('vehicle_simulator')
    clock.wait_for()
    second = call_main('vehicle_simulator')
    assert second.returncode == 2
    # The graph may not show the name yet.
    assert re.search('another node( named /vehicle_simulator)? also publishes /clock', second.stderr)


def test_a_clock_of_somebody_else_is_left_alone(bench, call_main):
    clocks = bench.publisher(Clock, '/clock')
    with repeating(lambda: clocks.publish(Clock(clock=Time(sec=START_S))), 0.02):
        simulator = call_main('vehicle_simulator')
    assert simulator.returncode == 2
    (line,) = (line for line in simulator.stderr.splitlines() if 'error:' in line)
    assert '/tester also publishes /clock; set publish_clock:=false' in line


def test_a_killed_simulator_does_not_keep_the_next_one_from_starting(bench):
    clock = bench.record(Clock, '/clock', MANY)
    first = start_in(bench, '/car1')
    clock.wait_for()
    first.send_signal(signal.SIGKILL)
    first.wait()
    clock.clear()
    second = start_in(bench, '/car2', '-p', f'start_time:={START_S}.0')
    clock.wait_for(lambda message: message.clock.sec >= START_S, timeout_s=GRAPH_FORGETS_S)
    assert second.exit_status is None


@pytest.mark.deep
def test_another_simulator_drives_by_the_clock_of_the_first(bench, wait_until):
    states = bench.record(BatteryState, '/car2/battery_state', MANY)
    second = start_in(bench, '/car2', '-p', 'publish_clock:=false', '-p', 'use_sim_time:=true')
    start_in(bench, '/car1', '-p', f'start_time:={START_S}.0', '-p', 'speed_up:=5.0')
    received = states.wait_for_count(20)
    first, last = received[0], received[-1]
    assert START_S <= first.header.stamp.sec < last.header.stamp.sec < START_S + 3600
    # One state a second of the first one's time, and no second clock; a busy computer leaves some out.
    steps_s = [after.header.stamp.sec - before.header.stamp.sec for before, after in zip(received, received[1:])]
    assert median(steps_s) == 1 and last.header.stamp.sec - first.header.stamp.sec >= 15
    assert last.percentage < first.percentage

    def topics_of_second():
        try:
            return dict(bench.node.get_publisher_names_and_types_by_node(
                'vehicle_simulator', '/car2'))
        except NodeNameNonExistentError:
            return {}

    wait_until(lambda: '/car2/battery_state' in topics_of_second(), 'the second in the graph')
    assert '/clock' not in topics_of_second()
    route = bench.record(RoutePlan, '/car2/route_plan', LATCHED).wait_for()
    assert START_S <= route.header.stamp.sec <= first.header.stamp.sec
    assert second.exit_status is None


def test_without_a_clock_of_its_own_it_can_drive_in_real_time(bench):
    states = bench.record(BatteryState, 'battery_state', MANY)
    bench.start('vehicle_simulator', '-p', 'publish_clock:=false', '-p',
                'battery_state_period:=0.1')
    now_s = bench.node.get_clock().now().nanoseconds * 1e-9
    message = states.wait_for_count(3)[-1]
    # Neither simulated time nor another day's.
    assert abs(message.header.stamp.sec - now_s) < 600.0
    assert bench.node.get_publishers_info_by_topic('/clock') == []


def test_a_clock_that_is_set_back_ends_a_drive_that_goes_by_it(bench, wait_until):
    clocks = bench.publisher(Clock, '/clock')
    states = bench.record(BatteryState, 'battery_state', MANY)
    simulator = bench.start(
        'vehicle_simulator', '-p', 'publish_clock:=false', '-p', 'use_sim_time:=true')
    ticks_s = iter(range(START_S, 2 * START_S))

    def drives():
        clocks.publish(Clock(clock=Time(sec=next(ticks_s))))
        return states.messages

    wait_until(drives, 'a battery state')

    def has_ended():
        clocks.publish(Clock(clock=Time(sec=1000)))
        return simulator.exit_status is not None

    wait_until(has_ended, 'the end')
    assert simulator.exit_status == 2
    assert 's; the drive cannot go back' in error_lines(simulator)[0]


@pytest.mark.parametrize('arguments, text', [
    (('speed_up:=20.0',), 'speed_up: 20.0 is not allowed with publish_clock:=false; it must be 1.0'),
    (('start_time:=1000.0',), 'start_time: 1000.0 is not allowed with publish_clock:=false'),
    (('wait_for_planner:=true',), 'wait_for_planner: True is not allowed with'),
    (('lockstep:=true',), 'lockstep: True is not allowed with publish_clock:=false; it must be False'),
    (('scenario:=clock_back',), 'scenario clock_back makes the clock jump'),
])
def test_what_only_the_owner_of_the_clock_can_do_is_refused(call_main, arguments, text):
    done = call_main('vehicle_simulator', '--ros-args', '-p', 'publish_clock:=false',
                     *(part for argument in arguments for part in ('-p', argument)))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert text in line
