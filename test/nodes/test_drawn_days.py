# SPDX-License-Identifier: Apache-2.0
"""Drawn days with the installed planner over DDS: a trip that has ended stays ended."""

import signal

from drawn_days import AMBIENT_C, DAYS, DRIVE_W, SPEED_MPS, TARGET_C, violations_of, World
from hypothesis import given, HealthCheck, settings
from node_bench import poll_until
import pytest
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from spinning import take_down

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan, RouteProgress

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class WorldOverDds(World):
    """A world whose planner is an installed process; its inputs are messages."""

    def __init__(self, bench, state_file):
        super().__init__()
        self.planner, self._bench, self._state_file, self._process = None, bench, state_file, None
        self._commands = bench.record(HvchCommand, 'hvch_command', 10)
        self._plans = bench.record(PreheatPlan, 'preheat_plan', LATCHED)
        self._clock = bench.publisher(Clock, '/clock', 1)
        self._states = bench.publisher(BatteryState, 'battery_state')
        self._routes = bench.publisher(RoutePlan, 'route_plan', LATCHED)
        self._positions = bench.publisher(RouteProgress, 'route_progress')
        self._parameters = bench.node.create_client(GetParameters, 'planner/get_parameters')
        self.restart()

    def restart(self):
        if self._process is not None:
            self._process.send_signal(signal.SIGTERM)
            assert self._process.wait() == 0
        self._commands.clear()
        self._process = self._bench.start(
            'planner', '-p', 'use_sim_time:=true', '-p', 'estimation:=false', '-p', 'battery_state_timeout:=12.0',
            '-p', 'minimum_on_time:=0.0', '-p', 'minimum_off_time:=0.0', '-p', f'state_file:={self._state_file}')
        for publisher in (self._clock, self._states, self._routes, self._positions):
            publisher.wait_for_subscription()
        self._commands.wait_for_publisher()
        self._plans.wait_for_publisher()
        # The answer of a server that has not yet discovered the client is lost, so the first call is repeated.
        self._bench.call(GetParameters, 'planner/get_parameters', GetParameters.Request(names=['method']))
        assert self._parameters.wait_for_service(10.0)

    def close(self):
        self._process.send_signal(signal.SIGTERM)
        assert self._process.wait() == 0
        take_down(self._bench.node, lambda: self._bench.node.destroy_client(self._parameters))
        for endpoint in (self._commands, self._plans, self._clock, self._states, self._routes, self._positions):
            endpoint.destroy()

    @property
    def answer(self):
        plan = self._plans.latest
        return (Status.NO_ROUTE, '', 0) if plan is None else (
            Status(plan.status), plan.explanation, round(plan.delay * NS_PER_S))

    def _tell_time(self):
        self._clock.publish(Clock(clock=time_message(self.clock_ns)))
        self._wait()

    def _wait(self):
        """Wait until the planner has handled all that it has received."""
        future = self._parameters.call_async(GetParameters.Request(names=['method']))
        poll_until(future.done, 'an answer of the planner')

    def give_route(self, route_id, stamp_ns, durations_s):
        self._tell_time()
        message = RoutePlan(
            route_id=route_id, segment_duration=durations_s, speed=[SPEED_MPS], propulsion_power=[DRIVE_W],
            ambient_temperature=[AMBIENT_C], charging_planned=True, target_battery_temperature=TARGET_C)
        message.header.stamp = time_message(stamp_ns)
        self._routes.publish(message)
        self._wait()

    def give_position(self, route_id, stamp_ns, distance_m):
        message = RouteProgress(route_id=route_id, distance=distance_m, has_distance=True,
                                route_stamp=time_message(stamp_ns))
        message.header.stamp = time_message(self.clock_ns)
        self._positions.publish(message)
        self._wait()

    def give_battery_state(self, volts, amperes):
        self._tell_time()
        # As in sensor_msgs: negative while the battery is discharged.
        message = BatteryState(
            temperature=self.temperature_c, percentage=self.soc, voltage=volts, current=-amperes)
        message.header.stamp = time_message(self.clock_ns)
        self._states.publish(message)
        command = poll_until(self._answered, 'a command of now')
        self.command_w = command.battery_heating_power
        self._wait()

    def _answered(self):
        command, plan = self._commands.latest, self._plans.latest
        if command is None or plan is None or nanoseconds(command.header.stamp) < self.clock_ns:
            return None
        return command if nanoseconds(plan.header.stamp) >= self.clock_ns else None


@pytest.mark.deep
def test_no_watt_after_arrival_over_dds(bench, tmp_path):
    days = []

    @settings(max_examples=20, suppress_health_check=list(HealthCheck))
    @given(DAYS)
    def drive(day):
        world = WorldOverDds(bench, tmp_path / f'state{len(days)}.json')
        days.append(day)
        try:
            assert violations_of(day, world) == []
        finally:
            world.close()

    drive()
    assert len(days) >= 20
