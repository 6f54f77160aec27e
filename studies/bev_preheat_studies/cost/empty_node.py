# SPDX-License-Identifier: Apache-2.0
"""
The lower bound: a node with the planner's interfaces that plans nothing.

It has the planner's publishers, subscriptions, service, action server, timers and parameters, with the same
qualities of service, clocks and event handlers, and its messages have the size of the planner's on the
reference trip (a test compares both nodes). It checks, learns and plans nothing, publishes prepared messages
beside the command, and loads no module of the planner. Like any node it logs one line when it is ready.
"""

from __future__ import annotations

from array import array
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
import rclpy
from rclpy.action import ActionServer
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    LivelinessPolicy,
    QoSDurabilityPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
)
from sensor_msgs.msg import BatteryState, Temperature
from std_srvs.srv import SetBool

from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan, RoutePlan, RouteProgress

PARAMETERS: dict[str, Any] = {
    'vehicle': 'reference', 'method': 'value_function', 'target_battery_temperature': 0.0,
    'battery_state_timeout': 5.0, 'clock_tolerance': 1.0, 'command_period': 1.0,
    'command_lease': 2.5, 'planning_step': 30.0, 'arrival_soc_margin': 0.0, 'estimation': True,
    'minimum_on_time': 20.0, 'minimum_off_time': 120.0, 'route_progress_timeout': 10.0,
    'energy_price': 0.6, 'value_of_time': 10.0, 'heat_while_charging': False,
    'compiled_core': True, 'coldest_cell_limits': True, 'flight_recorder': '',
    'flight_recorder_size': 500.0, 'state_file': '',
    'departures': '', 'grid_prices': '', 'locked': False, 'lifecycle': False}
# Of the plan for the reference trip: steps, heating intervals, characters of its sentence.
STEPS, STRETCHES, CHARACTERS = 120, 2, 120
# Size of the diagnostics.
ENTRIES, VALUES = 4, 9
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
LATEST = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)


class EmptyNode(Node):
    """
    Answers each battery state with the planner's three messages.

    Its command asks for heat once a route has arrived, as a sign that it has.
    """

    def __init__(self) -> None:
        """Create the planner's interfaces."""
        super().__init__('planner')
        for name, value in PARAMETERS.items():
            self.declare_parameter(name, value)
        self._lease = Duration(seconds=PARAMETERS['command_lease'])
        self._command = self.create_publisher(HvchCommand, 'hvch_command', QoSProfile(
            depth=1, deadline=self._lease, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
            liveliness_lease_duration=self._lease))
        self._temperature = self.create_publisher(
            Temperature, 'predicted_arrival_temperature', 1)
        self._plan = self.create_publisher(PreheatPlan, 'preheat_plan', LATCHED)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_subscription(BatteryState, 'battery_state', self._on_battery_state, LATEST)
        self.create_subscription(RouteProgress, 'route_progress', _ignore, LATEST)
        self.create_subscription(HvchStatus, 'hvch_status', _ignore, LATEST)
        for profile in (LATCHED, QoSProfile(depth=1)):
            self.create_subscription(
                RoutePlan, 'route_plan', self._on_route_plan, profile, raw=True,
                event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))
        self._heating_w = 0.0
        for service in ('~/enable', '~/skip_departure'):
            self.create_service(SetBool, service, lambda request, response: response)
        self._server = ActionServer(self, PrepareBattery, '~/prepare_battery', _ignore)
        self.add_on_set_parameters_callback(
            lambda parameters: SetParametersResult(successful=True))
        self.add_post_set_parameters_callback(_ignore)
        self.create_timer(PARAMETERS['command_period'], self._on_repeat)
        self._stale_timer = self.create_timer(
            PARAMETERS['battery_state_timeout'], self._on_repeat)
        # Timers of the check for best-effort publishers, of the state file, and of the search for other nodes.
        for period_s in (0.5, 60.0, 0.5):
            self.create_timer(period_s, _ignore, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._plan_message, self._diagnostics_message = plan_message(), diagnostics_message()
        self.get_logger().info('Waiting for a route plan.')

    def _on_route_plan(self, serialized: bytes) -> None:
        self._heating_w = 1.0

    def _on_battery_state(self, message: BatteryState) -> None:
        self._publish_command()
        self._plan.publish(self._plan_message)
        self._temperature.publish(Temperature())
        self._stale_timer.reset()

    def _publish_command(self) -> None:
        now = self.get_clock().now()
        command = HvchCommand(battery_heating_power=self._heating_w,
                              valid_until=(now + self._lease).to_msg())
        command.header.stamp = now.to_msg()
        self._command.publish(command)

    def _on_repeat(self) -> None:
        self._publish_command()
        self._diagnostics.publish(self._diagnostics_message)


def _ignore(*arguments: object) -> None:
    """Do nothing."""


def plan_message() -> PreheatPlan:
    """Return a PreheatPlan of the size for the reference trip."""
    message = PreheatPlan(route_id='benchmark', method='value_function', explanation=CHARACTERS * '.')
    edges, steps, intervals = (array('d', bytes(8 * count)) for count in (STEPS + 1, STEPS, STRETCHES))
    message.time = message.battery_temperature = message.soc = edges
    message.hvch_power = steps
    message.stretch_start = message.stretch_end = message.stretch_energy = intervals
    message.stretch_reason = bytes(STRETCHES)
    return message


def diagnostics_message() -> DiagnosticArray:
    """Return a DiagnosticArray of about the planner's size."""
    values = [KeyValue(key='battery temperature [degC]', value='-7.00')] * VALUES
    return DiagnosticArray(status=[DiagnosticStatus(
        name='planner: preheating', hardware_id='reference', message=CHARACTERS * '.',
        values=values)] * ENTRIES)


def main() -> None:
    """Spin until killed."""
    rclpy.init()
    rclpy.spin(EmptyNode())


if __name__ == '__main__':
    main()
