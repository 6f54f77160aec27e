# SPDX-License-Identifier: Apache-2.0
"""A real PlannerNode in this process: publications are recorded instead of sent, its clock is set by hand."""

from contextlib import contextmanager
from dataclasses import dataclass, field

import rclpy
from rclpy.logging import LoggingSeverity

from bev_preheat.nodes.installed_processes import reserved_domain_id
from bev_preheat.nodes.planner_node import PlannerNode


class Recorder:
    """Takes the place of a publisher."""

    def __init__(self):
        self.last = None
        self.count = 0

    def publish(self, message):
        self.last, self.count = message, self.count + 1

    def wait_for_all_acked(self, timeout):
        return True


@dataclass
class RehearsedPlanner:
    """The node and its publications."""

    node: PlannerNode
    commands: Recorder = field(default_factory=Recorder)
    plans: Recorder = field(default_factory=Recorder)
    others: Recorder = field(default_factory=Recorder)

    def __post_init__(self):
        self.node._command_publisher, self.node._plan_publisher = self.commands, self.plans
        self.node._temperature_publisher = self.node._diagnostics_publisher = self.others

    def set_clock(self, now_ns):
        self.node._now_ns = lambda: now_ns


@contextmanager
def rehearsed_planner():
    """A RehearsedPlanner in a ROS domain of its own."""
    with reserved_domain_id() as domain_id:
        rclpy.init(domain_id=domain_id)
        node = PlannerNode()
        try:
            node.get_logger().set_level(LoggingSeverity.FATAL)
            yield RehearsedPlanner(node)
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
