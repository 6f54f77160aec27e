# SPDX-License-Identifier: Apache-2.0
"""
The installed `planner` over DDS: what DDS and its process decide; test_planner_node.py has its decisions.

The tests share a planner in real time. A test that ends it leaves it to the next one to start another.
"""

from collections import Counter
import os
import signal
import subprocess
import sys

from node_bench import repeating
import pytest
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = QoSReliabilityPolicy.RELIABLE
LEASE_S = 5.0
QUICK = ('-p', 'command_period:=0.2', '-p', f'command_lease:={LEASE_S}', '-p', 'battery_state_timeout:=60.0',
         '-p', 'estimation:=false', '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0')
STATE_PERIOD_S = 0.2
FROZEN_SUBSCRIBER = """
import rclpy
from bev_preheat_msgs.msg import HvchCommand
rclpy.init()
node = rclpy.create_node('frozen')
node.create_subscription(HvchCommand, 'hvch_command', lambda message: print('.', flush=True), 1)
rclpy.spin(node)
"""


def heats(command):
    return command.battery_heating_power > 0.0


class Car:
    """A battery and routes in real time."""

    def __init__(self, bench, namespace='', battery_topic='battery_state'):
        self.bench = bench
        self.commands = bench.record(HvchCommand, f'{namespace}/hvch_command', 100)
        self.plans = bench.record(PreheatPlan, f'{namespace}/preheat_plan', 100)
        self.states = bench.publisher(BatteryState, f'{namespace}/{battery_topic}')
        self.routes = bench.publisher(RoutePlan, f'{namespace}/route_plan', LATCHED)
        self.process = None

    def start(self, *arguments):
        self.process = self.bench.start('planner', *QUICK, *arguments)

    def stamp(self):
        return time_message(self.bench.node.get_clock().now().nanoseconds)

    def send_state(self):
        message = BatteryState(temperature=-7.0, percentage=0.8)
        message.header.stamp = self.stamp()
        self.states.publish(message)

    def send_route(self, route_id='home'):
        """Publish a route of 20 min, too short to reach 25 degC from -7 degC: heats at once."""
        message = RoutePlan(
            route_id=route_id, segment_duration=[30.0] * 40, speed=[20.0], propulsion_power=[20e3],
            ambient_temperature=[-7.0], charging_planned=True, target_battery_temperature=25.0)
        message.header.stamp = self.stamp()
        self.routes.publish(message)

    def heat(self):
        """Wait until it heats, and forget its earlier messages."""
        self.send_route()
        self.commands.clear()
        self.commands.wait_for(heats, 'heat')
        self.plans.clear()


@pytest.fixture(scope='module')
def shared(module_bench):
    shared = Car(module_bench)
    with repeating(shared.send_state, STATE_PERIOD_S):
        yield shared


@pytest.fixture
def last_drive(shared):
    """Return the car that tests share, heating; its planner may end."""
    if shared.process is None or shared.process.exit_status is not None:
        shared.start()
    shared.heat()
    return shared


@pytest.fixture
def car(last_drive):
    """Return the car that tests share, heating; its planner must keep running."""
    yield last_drive
    assert last_drive.process.exit_status is None, 'the planner has ended'


def offered(endpoints):
    """Count the (reliability, durability) of endpoints."""
    return Counter((endpoint.qos_profile.reliability, endpoint.qos_profile.durability) for endpoint in endpoints)


def test_it_offers_what_any_partner_needs_and_never_an_old_command(car):
    node, volatile, latched = car.bench.node, QoSDurabilityPolicy.VOLATILE, QoSDurabilityPolicy.TRANSIENT_LOCAL
    assert offered(node.get_publishers_info_by_topic('hvch_command')) == {(RELIABLE, volatile): 1}
    # Best effort and volatile match every publisher.
    assert offered(node.get_subscriptions_info_by_topic('battery_state')) == {
        (QoSReliabilityPolicy.BEST_EFFORT, volatile): 1}
    assert offered(node.get_subscriptions_info_by_topic('route_plan')) == {
        (RELIABLE, latched): 1, (RELIABLE, volatile): 1}


def test_who_comes_late_gets_the_plan(car):
    late = car.bench.record(PreheatPlan, 'preheat_plan', LATCHED)
    assert late.wait_for().route_id == 'home'


def test_its_commands_are_repeated_in_real_time(car):
    first, last = car.commands.wait_for_count(12)[::11]
    # Each battery state is answered by a command, too; a busy computer sends fewer.
    assert nanoseconds(last.header.stamp) - nanoseconds(first.header.stamp) >= 5 * 0.19e9


@pytest.mark.deep
def test_bytes_that_are_no_message_do_no_harm(car):
    car.states.publish(b'\x00\x01\x00\x00' + b'\xff' * 60)
    car.heat()
    # An unreadable route may have been a cancellation of the trip.
    car.routes.publish(b'\x00\x01\x00\x00\x01')
    car.plans.wait_for(lambda plan: plan.status == Status.INVALID_INPUT
                       and 'route_plan refused: the message cannot be read' in plan.explanation)
    car.heat()


def test_its_services_answer(car):
    call = car.bench.call
    names = ['value_of_time']

    def set_to(value):
        return call(SetParameters, '/planner/set_parameters', SetParameters.Request(parameters=[
            Parameter(names[0], value=value).to_parameter_msg()])).results[0]

    assert set_to(12.0).successful
    assert 'value_of_time' in set_to(-1.0).reason
    assert call(GetParameters, '/planner/get_parameters', GetParameters.Request(names=names)
                ).values[0].double_value == 12.0
    assert call(DescribeParameters, '/planner/describe_parameters', DescribeParameters.Request(names=names)
                ).descriptors[0].description.endswith('[per h]')
    for is_on, condition in ((False, lambda command: command.reason == Status.DISABLED), (True, heats)):
        assert call(SetBool, '/planner/enable', SetBool.Request(data=is_on)).success
        car.commands.wait_for(condition, f'the answer to {is_on}')


def test_no_solver_and_no_plots_are_in_the_process(car):
    with open(f'/proc/{car.process.process_id}/maps', encoding='utf-8') as maps:
        loaded = maps.read()
    assert [name for name in ('casadi', 'matplotlib', 'scipy') if f'/{name}' in loaded] == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_told_to_end_it_switches_off_and_ends_well(last_drive, number):
    car = last_drive
    car.process.send_signal(number)
    last = car.commands.wait_for(lambda command: command.reason == Status.SHUTTING_DOWN, 'the last command')
    assert car.process.wait() == 0
    assert car.commands.messages[-1].reason == Status.SHUTTING_DOWN
    # A heater's controller may ignore an expired command and keep heating.
    assert last.battery_heating_power == 0.0 and nanoseconds(last.valid_until) > nanoseconds(last.header.stamp)


def test_a_listener_that_hangs_does_not_keep_it_from_ending(last_drive):
    car = last_drive
    domain = {'ROS_DOMAIN_ID': str(car.bench.node.context.get_domain_id()),
              'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    with subprocess.Popen([sys.executable, '-c', FROZEN_SUBSCRIBER],
                          stdout=subprocess.PIPE, env={**os.environ, **domain}) as listener:
        try:
            # Its output reports the first command.
            assert listener.stdout.readline()
            listener.send_signal(signal.SIGSTOP)
            car.process.send_signal(signal.SIGTERM)
            assert car.process.wait() == 0
        finally:
            listener.kill()


def test_two_cars_have_topics_of_their_own(bench):
    # The first has other names for everything.
    first, second = Car(bench, '/car1', 'bms/state'), Car(bench, '/car2')
    first.start('-r', '__ns:=/car1', '-r', 'battery_state:=bms/state')
    second.start('-r', '__ns:=/car2')
    with repeating(first.send_state, STATE_PERIOD_S):
        first.heat()
        second.commands.wait_for_count(5)
        assert not any(map(heats, second.commands.messages))
