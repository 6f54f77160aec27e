# SPDX-License-Identifier: Apache-2.0
"""
The subscriptions to one planner.

Best effort and of depth 1, except for latched topics: a publisher never waits for this process, nor keeps samples
for it.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import HeaterStatusArrived
from bev_preheat.dashboard.messages import plan_seen, route_seen, seconds
from bev_preheat.messages.battery_state import read_temperatures
from bev_preheat.messages.heater import heater_status_event
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.route_listener import LARGEST_ROUTE_BYTES
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable
    from threading import Lock
    from typing import Any

    from rclpy.node import Node

    from bev_preheat.dashboard.board import Board
    from bev_preheat.dashboard.discovery import PlannerFound

LATEST = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Ears:
    """Fills a Board, under its lock, with the messages of a planner and of its inputs."""

    def __init__(self, node: Node, planner: PlannerFound, board: Board, lock: Lock) -> None:
        """Subscribe."""
        self._node, self._board, self._lock = node, board, lock
        self._news = RepetitionFilter()
        # Publishers of other qualities of service are not worth a warning each.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)

        def subscribe(kind: type, topic: str, see: Callable[[Any], None], qos: QoSProfile,
                      raw: bool = False) -> Any:
            return node.create_subscription(kind, topic, self._guarded(topic, see), qos, raw=raw,
                                            event_callbacks=quiet)
        self._subscriptions = [
            subscribe(HvchCommand, planner.command_topic, self._on_command, LATEST),
            subscribe(PreheatPlan, planner.plan_topic, self._on_plan, LATCHED),
            subscribe(BatteryState, planner.battery_topic, self._on_battery, LATEST)]
        if planner.answer_topic:
            self._subscriptions.append(subscribe(HvchStatus, planner.answer_topic, self._on_answer, LATEST))
        if planner.route_topic:
            # Of a route only the reserve is shown; it may be published with any quality of service.
            self._subscriptions += [subscribe(RoutePlan, planner.route_topic, self._on_route, qos, raw=True)
                                    for qos in (LATCHED, LATEST)]

    def close(self) -> None:
        """Unsubscribe."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _guarded(self, topic: str, see: Callable[[Any], None]) -> Callable[[Any], None]:
        def callback(message: Any) -> None:
            try:
                see(message)
            except Exception as error:
                sentence = f'{topic}: cannot be shown: {type(error).__name__}: {error}'
                if self._news.has(sentence):
                    self._node.get_logger().warning(sentence)
        return callback

    def _on_command(self, message: HvchCommand) -> None:
        with self._lock:
            self._board.see_command(seconds(message.header.stamp), message.battery_heating_power, message.reason,
                                    time.monotonic(), seconds(message.valid_until))

    def _on_answer(self, message: HvchStatus) -> None:
        event = heater_status_event(message, math.inf)
        if isinstance(event, HeaterStatusArrived):
            with self._lock:
                self._board.see_answer(event.status)

    def _on_plan(self, message: PreheatPlan) -> None:
        plan = plan_seen(message)
        with self._lock:
            self._board.see_plan(plan, time.monotonic())

    def _on_battery(self, message: BatteryState) -> None:
        temperature_c = read_temperatures(message, []).battery_c
        with self._lock:
            self._board.see_battery(seconds(message.header.stamp), temperature_c, message.percentage,
                                    time.monotonic())

    def _on_route(self, data: bytes) -> None:
        if len(data) > LARGEST_ROUTE_BYTES:
            # The planner refuses it unread, too.
            return
        route = route_seen(deserialize_message(data, RoutePlan))
        with self._lock:
            self._board.see_route(route)
