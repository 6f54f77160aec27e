# SPDX-License-Identifier: Apache-2.0
"""The lower bound for the planner's process: a node that answers each battery state with a command and a plan."""

from __future__ import annotations

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class EmptyNode(Node):
    """Checks, learns and plans nothing; its command asks for heat from the first route on."""

    def __init__(self) -> None:
        """Create the planner's topics that the benchmark uses."""
        super().__init__('planner')
        self._heating_w = 0.0
        self._command = self.create_publisher(HvchCommand, 'hvch_command', 1)
        self._plan = self.create_publisher(PreheatPlan, 'preheat_plan', LATCHED)
        self.create_subscription(BatteryState, 'battery_state', self._on_battery_state, 1)
        self.create_subscription(RoutePlan, 'route_plan', self._on_route_plan, LATCHED)

    def _on_route_plan(self, message: RoutePlan) -> None:
        self._heating_w = 1.0

    def _on_battery_state(self, message: BatteryState) -> None:
        command = HvchCommand(battery_heating_power=self._heating_w)
        command.header.stamp = self.get_clock().now().to_msg()
        self._command.publish(command)
        self._plan.publish(PreheatPlan())


def main() -> None:
    """Spin until killed."""
    rclpy.init()
    rclpy.spin(EmptyNode())
