# SPDX-License-Identifier: Apache-2.0
"""The floor: a node of the planner's shape that plans nothing."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import BatteryState, Temperature
from std_srvs.srv import SetBool

from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan


class EmptyNode(Node):
    """
    Answers each battery state with the planner's three messages, empty.

    But for the command: once a route has come it asks for heat, so that one hears it has.
    """

    def __init__(self) -> None:
        """Make publishers, subscriptions, service and timer as the planner does."""
        super().__init__('planner')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._command = self.create_publisher(HvchCommand, 'hvch_command', 1)
        self._temperature = self.create_publisher(
            Temperature, 'predicted_arrival_temperature', 1)
        self._plan = self.create_publisher(PreheatPlan, 'preheat_plan', latched)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_subscription(
            BatteryState, 'battery_state', self._on_battery_state,
            QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT))
        self.create_subscription(RoutePlan, 'route_plan', self._on_route_plan, latched)
        self._heating_w = 0.0
        self.create_service(SetBool, '~/enable', lambda request, response: response)
        self.create_timer(1.0, lambda: self._diagnostics.publish(DiagnosticArray()))

    def _on_route_plan(self, message: RoutePlan) -> None:
        self._heating_w = 1.0

    def _on_battery_state(self, message: BatteryState) -> None:
        self._command.publish(HvchCommand(battery_heating_power=self._heating_w))
        self._temperature.publish(Temperature())
        self._plan.publish(PreheatPlan())


def main() -> None:
    """Spin until killed."""
    rclpy.init()
    rclpy.spin(EmptyNode())


if __name__ == '__main__':
    main()
