# SPDX-License-Identifier: Apache-2.0
"""Data received from a planner: the latest messages, their arrivals, and a short history."""

from __future__ import annotations

from collections import deque
import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import qos_profile_sensor_data, QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState, Temperature

from bev_preheat.nodes.route_listener import RouteListener
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticStatus
    from rclpy.node import Node

    # A ROS message of any kind: rclpy's have no types.
    Message = Any
    # (stamp [s], value).
    History = deque[tuple[float, float]]

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
# Topic: (type, QoS, age from which it is marked as late [s of real time]; None: it is sent once).
TOPICS = {
    'battery_state': (BatteryState, qos_profile_sensor_data, 5.0),
    'route_plan': (RoutePlan, LATCHED, None),
    'hvch_command': (HvchCommand, 1, 2.5),
    'preheat_plan': (PreheatPlan, LATCHED, 10.0),
    'predicted_arrival_temperature': (Temperature, 1, 10.0),
    '/diagnostics': (DiagnosticArray, 10, 5.0),
}
HISTORY_POINTS = 4000


class Heard:
    """
    The latest message of each topic, its arrival, and the history of measurements and commands.

    `latest` and `came_s` (time.monotonic) are by topic; `temperatures` holds (stamp [s], deg C),
    `powers` (stamp [s], W). `entries` are the planner's entries of /diagnostics by name.
    """

    def __init__(self, planner: str = 'planner',
                 clock_s: Callable[[], float] = time.monotonic) -> None:
        """Start without messages; `planner` is the prefix of the planner's diagnostics."""
        self._planner, self._clock_s = planner.lstrip('/'), clock_s
        self.latest: dict[str, Message] = {}
        self.came_s: dict[str, float] = {}
        self.entries: dict[str, DiagnosticStatus] = {}
        self.temperatures: History = deque(maxlen=HISTORY_POINTS)
        self.powers: History = deque(maxlen=HISTORY_POINTS)

    @property
    def silent_topics(self) -> list[str]:
        """Topics without a message so far."""
        return [topic for topic in TOPICS if topic not in self.latest]

    def hear(self, topic: str, message: Message) -> None:
        """Record a message."""
        if topic == '/diagnostics':
            own = [status for status in message.status
                   if status.name.startswith(f'{self._planner}: ')]
            if not own:
                return
            self.entries.update((status.name, status) for status in own)
        self.latest[topic], self.came_s[topic] = message, self._clock_s()
        if topic == 'battery_state':
            self._note(self.temperatures, message, message.temperature)
        elif topic == 'hvch_command':
            self._note(self.powers, message, message.battery_heating_power)

    def age_s(self, topic: str) -> float:
        """Return the age of the latest message of a topic [s]."""
        return self._clock_s() - self.came_s[topic]

    def _note(self, history: History, message: Message, value: float) -> None:
        instant_s = stamp_s(message.header.stamp)
        if history and instant_s < history[-1][0]:
            # The clock was set back, so later entries belong to another drive.
            history.clear()
        history.append((instant_s, value))


def stamp_s(stamp: Time) -> float:
    """Return a builtin_interfaces/Time in seconds."""
    return stamp.sec + 1e-9 * stamp.nanosec


def subscribe(node: Node, heard: Heard) -> None:
    """Subscribe a node to all topics."""
    for topic, (kind, qos, _) in TOPICS.items():
        def hear(message: Message, topic: str = topic) -> None:
            heard.hear(topic, message)

        if kind is RoutePlan:
            # The publisher is unknown; messages too long for the planner are not shown, either.
            RouteListener(node, hear, lambda error: None)
        else:
            node.create_subscription(kind, topic, hear, qos)
