# SPDX-License-Identifier: Apache-2.0
"""Route plans of every kind of publisher reach the installed nodes, once, and none harms them."""

from array import array
import re

from planner_car import LATCHED, route_at
import psutil
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from waiting import poll_until

from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

# The quality of service of `ros2 topic pub`.
VOLATILE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED_BEST_EFFORT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL,
                                 reliability=ReliabilityPolicy.BEST_EFFORT)
KINDS = {'latched': LATCHED, 'volatile': VOLATILE, 'best_effort': BEST_EFFORT,
         'latched_best_effort': LATCHED_BEST_EFFORT}
ARRAYS = ('segment_duration', 'speed', 'propulsion_power', 'propulsion_power_rms',
          'ambient_temperature', 'cabin_heating_power', 'auxiliary_power')
VALUES = (0.1, 20.0, 20e3, 21e3, -7.0, 1600.0, 300.0)
LEASE_S = 2.5


def route(bench, route_id='home', **fields):
    return route_at(bench.now_ns, route_id=route_id, **fields)


def long_route(bench, route_id, segments):
    return route(bench, route_id, **{
        name: array('d', [value]) * segments for name, value in zip(ARRAYS, VALUES)})


def times_accepted(process, route_id):
    return len(re.findall(f"Route '{route_id}': ", process.output()))


@pytest.fixture(scope='module')
def reliable_planner(module_bench):
    return module_bench.start('planner')


@pytest.fixture
def reliable(module_bench, reliable_planner):
    """Give the bench and the process of a planner that tests share; no node publishes with best effort there."""
    def subscriptions():
        return module_bench.node.count_subscribers('route_plan')

    poll_until(lambda: subscriptions() >= 2, 'the planner')
    assert subscriptions() == 2
    yield module_bench, reliable_planner
    assert reliable_planner.exit_status is None
    assert subscriptions() == 2


def publish_once_matched(bench, qos, message):
    """Publish as `ros2 topic pub --once` does: wait for only one match."""
    routes = bench.publisher(RoutePlan, 'route_plan', qos)
    routes.wait_for_subscription()
    routes.publish(message)
    return routes


def expect_handled_once_each_time(planner, routes, bench):
    same = route(bench, 'same')
    before = times_accepted(planner, 'same')
    for time_sent in (1, 2, 3):
        routes.publish(same)
        poll_until(lambda: times_accepted(planner, 'same') >= before + time_sent, 'the route again')
    routes.publish(route(bench, 'last'))
    poll_until(lambda: times_accepted(planner, 'last'), 'the last route')
    assert times_accepted(planner, 'same') == before + 3


def test_a_route_arrives_from_whoever_is_reliable_and_is_handled_once_each_time(reliable):
    bench, planner = reliable
    for kind in ('latched', 'volatile'):
        routes = publish_once_matched(bench, KINDS[kind], route(bench, kind))
        poll_until(lambda: times_accepted(planner, kind), 'the route')
    expect_handled_once_each_time(planner, routes, bench)


def test_a_route_arrives_with_best_effort_and_once_three_ways(bench):
    # Latched before the planner starts.
    latched = bench.publisher(RoutePlan, 'route_plan', LATCHED)
    latched.publish(route(bench))
    planner = bench.start('planner')
    poll_until(lambda: times_accepted(planner, 'home'), 'the latched route')
    for kind in ('best_effort', 'latched_best_effort'):
        routes = publish_once_matched(bench, KINDS[kind], route(bench, kind))

        def has_arrived():
            # Messages sent before the planner has discovered the publisher are lost.
            routes.publish(route(bench, kind))
            return times_accepted(planner, kind)

        poll_until(has_arrived, f'the route, {kind}')
    # With the third subscription, which matches every publisher, like the second.
    latched.wait_for_subscription(3)
    expect_handled_once_each_time(planner, latched, bench)


def test_a_volatile_route_of_200_000_segments_with_all_arrays_arrives(reliable):
    bench, planner = reliable
    publish_once_matched(bench, VOLATILE, long_route(bench, 'long', 200_000))
    bench.wait_until(lambda: times_accepted(planner, 'long'), 'the route')


def processor_time_s(process):
    times = psutil.Process(process.pid).cpu_times()
    return times.user + times.system


def test_a_huge_route_is_refused_by_its_size_once(bench):
    commands = bench.record(HvchCommand, 'hvch_command')
    plans = bench.record(PreheatPlan, 'preheat_plan')
    planner = bench.start('planner', '-p', 'command_period:=0.2')
    routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
    routes.wait_for_subscription(2)
    routes.publish(route(bench))
    bench.wait_until(lambda: times_accepted(planner, 'home'), 'the route')
    commands.clear()
    before_s = processor_time_s(planner)
    # 7 arrays of 600 000 numbers of 8 bytes.
    routes.publish(long_route(bench, 'huge', 600_000))
    plan = plans.wait_for(lambda plan: plan.status == Status.INVALID_INPUT)
    assert re.search(r'route_plan refused: the message has 33\.6 MB; at most 11\.3 MB are read, '
                     'enough for 200000 segments', plan.explanation)
    commands.wait_for_count(4)
    # Even without other work, a command would have come within the lease.
    assert processor_time_s(planner) - before_s < LEASE_S
    routes.publish(route(bench, 'next'))
    bench.wait_until(lambda: times_accepted(planner, 'next'), 'the next route')
    assert len(re.findall(r'\[ERROR\].*the message has 33', planner.output())) == 1
