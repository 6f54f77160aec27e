# SPDX-License-Identifier: Apache-2.0
"""The installed `planner` over DDS: what DDS and its process decide; test_planner_node.py has its decisions."""

from collections import Counter
import os
import signal
import subprocess
import sys

from planner_car import heats, LATCHED, PlannerCar, QUICK
import pytest
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import BatteryState

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

RELIABLE = QoSReliabilityPolicy.RELIABLE
COMMAND_LEASE_S = 1.5
FROZEN_SUBSCRIBER = """
import rclpy
from bev_preheat_msgs.msg import HvchCommand
rclpy.init()
node = rclpy.create_node('frozen')
node.create_subscription(HvchCommand, 'hvch_command', lambda message: print('.', flush=True), 1)
rclpy.spin(node)
"""


class Car(PlannerCar):
    """A battery and routes in real time."""

    def heat(self):
        """Wait until it heats, and forget its earlier messages."""
        self.send_route()
        self.wait_for_heat()
        self.plans.clear()


@pytest.fixture(scope='module')
def shared(module_bench):
    shared = Car(module_bench)
    with shared.feeding():
        yield shared


@pytest.fixture
def last_drive(shared):
    """Return the car that tests share, heating; its planner may end."""
    if shared.process is None or shared.process.exit_status is not None:
        shared.start(*QUICK)
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


@pytest.mark.deep
def test_bytes_that_are_no_message_do_no_harm(car):
    car.publishers[BatteryState].publish(b'\x00\x01\x00\x00' + b'\xff' * 60)
    car.heat()
    # An unreadable route may have been a cancellation of the trip.
    car.publishers[RoutePlan].publish(b'\x00\x01\x00\x00\x01')
    car.plans.wait_for(lambda plan: plan.status == Status.INVALID_INPUT
                       and 'route_plan refused: the message cannot be read' in plan.explanation)
    car.heat()


def test_no_solver_and_no_plots_are_in_the_process(car):
    with open(f'/proc/{car.process.pid}/maps', encoding='utf-8') as maps:
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
    first, second = Car(bench, '/car1', battery_topic='bms/state'), Car(bench, '/car2')
    first.start(*QUICK, '-r', '__ns:=/car1', '-r', 'battery_state:=bms/state')
    second.start(*QUICK, '-r', '__ns:=/car2')
    with first.feeding():
        first.heat()
        second.commands.wait_for_count(5)
        assert not any(map(heats, second.commands.messages))


# Deadline and liveliness of the commands, for a heater's controller that asks for them

class Controller:
    """A heater's controller: its commands, and the DDS events on them."""

    def __init__(self, node, deadline_s, liveliness):
        """Subscribe with a deadline and a liveliness lease of `deadline_s` [s]."""
        self.commands, self.alive, self.missed, self.misfits = [], [], [], []
        within = Duration(seconds=deadline_s)
        node.create_subscription(
            HvchCommand, 'hvch_command', self.commands.append,
            QoSProfile(depth=1, deadline=within, liveliness=liveliness,
                       liveliness_lease_duration=within),
            event_callbacks=SubscriptionEventCallbacks(
                deadline=self.missed.append, incompatible_qos=self.misfits.append,
                liveliness=lambda event: self.alive.append(event.alive_count)))


@pytest.mark.parametrize('liveliness', [
    pytest.param(LivelinessPolicy.AUTOMATIC, marks=pytest.mark.deep), LivelinessPolicy.MANUAL_BY_TOPIC])
def test_a_planner_that_hangs_misses_its_deadline_and_is_not_alive(bench, liveliness):
    controller = Controller(bench.node, COMMAND_LEASE_S, liveliness)
    planner = bench.start('planner', '-p', f'command_lease:={COMMAND_LEASE_S}', '-p', 'command_period:=0.3')
    bench.wait_until(lambda: len(controller.commands) >= 3 and controller.alive, 'commands')
    assert controller.alive[-1] == 1
    os.kill(planner.pid, signal.SIGSTOP)
    try:
        controller.missed.clear()
        bench.wait_until(lambda: controller.missed, 'a missed deadline')
        bench.wait_until(lambda: controller.alive[-1] == 0, 'the loss of liveliness')
        controller.commands.clear()
    finally:
        os.kill(planner.pid, signal.SIGCONT)
    bench.wait_until(lambda: controller.commands and controller.alive[-1] == 1, 'its return')


def test_who_asks_for_more_than_the_lease_is_told(bench):
    controller = Controller(bench.node, 0.5 * COMMAND_LEASE_S, LivelinessPolicy.AUTOMATIC)
    bench.start('planner', '-p', f'command_lease:={COMMAND_LEASE_S}')
    bench.wait_until(lambda: controller.misfits, 'the news that the quality of service does not fit')
    assert not controller.commands
