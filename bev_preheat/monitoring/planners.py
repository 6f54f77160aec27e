# SPDX-License-Identifier: Apache-2.0
"""
Finds planners in the ROS graph by the types of their topics, whatever these are called, and follows them.

Subscriptions are best effort and of depth 1, except for latched topics: a publisher never waits for this process,
nor keeps samples for it.
"""

from __future__ import annotations

import math
from threading import Lock
import time
from typing import NamedTuple, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import HeaterStatusArrived
from bev_preheat.messages.battery_state import read_temperatures
from bev_preheat.messages.fields import seconds
from bev_preheat.messages.heater import heater_status_event
from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.seen import entries_seen, plan_seen, route_seen
from bev_preheat.monitoring.view import Surroundings
from bev_preheat.nodes.node import RepetitionFilter
from bev_preheat.nodes.setup_watch import endpoint_name
from bev_preheat.nodes.topics import LARGEST_ROUTE_BYTES, MOST_SOURCES
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, HvchStatus, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from rclpy.node import Node

PLAN, COMMAND, SOURCE, ROUTE, ANSWER = (f'bev_preheat_msgs/msg/{name}' for name in (
    'PreheatPlan', 'HvchCommand', 'HeatSourceCommand', 'RoutePlan', 'HvchStatus'))
BATTERY = 'sensor_msgs/msg/BatteryState'
CLOCK = '/clock'
LATEST = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.BEST_EFFORT)
# Of each heat source a command comes at the same instant.
SOURCES = QoSProfile(depth=MOST_SOURCES, reliability=QoSReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
# `look` is called so often [s].
PLANNERS_PERIOD_S = 1.0
MOST_PLANNERS = 24
# A planner that has been gone for this time is forgotten [s].
FORGOTTEN_AFTER_S = 900.0


class PlannerFound(NamedTuple):
    """A planner by the full name of its node, and the full names of its topics; '' if it has none."""

    name: str
    plan_topic: str
    command_topic: str
    battery_topic: str
    route_topic: str
    answer_topic: str = ''
    source_topic: str = ''


class Planners:
    """
    Follows the planners of the ROS graph; `boards` has the Board of each by the full name of its node.

    `wanted` chooses planners by name. `look` is to be called about once a second, in the thread of the node's
    callbacks; other threads read `boards` under `lock`.
    """

    def __init__(self, node: Node, wanted: Callable[[str], bool] = lambda name: True) -> None:
        """Listen to diagnostics."""
        self._node, self._wanted, self._news = node, wanted, RepetitionFilter()
        self.lock = Lock()
        self.boards: dict[str, Board] = {}
        self._found: dict[str, PlannerFound] = {}
        self._ears: dict[str, Ears] = {}
        self._gone_s: dict[str, float] = {}
        node.create_subscription(
            DiagnosticArray, '/diagnostics', self.guarded('/diagnostics', self._on_diagnostics), QoSProfile(
                depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT))

    def look(self) -> tuple[list[str], list[str]]:
        """Look for planners; return those that came back, perhaps with another vehicle, and lost ones, by name."""
        there, now_s, back = find_planners(self._node, self._found), time.monotonic(), list[str]()
        for name, planner in there.items():
            self._gone_s.pop(name, None)
            if not self._wanted(name):
                continue
            if name in self.boards and not self.boards[name].around.is_there:
                back.append(name)
            if self._found.get(name) != planner:
                self._follow(planner)
        forgotten = [name for name in self._found
                     if name not in there and now_s - self._gone_s.setdefault(name, now_s) > FORGOTTEN_AFTER_S]
        for name in forgotten:
            self._ears.pop(name).close()
            del self._found[name], self._gone_s[name]
            with self.lock:
                del self.boards[name]
        for name, board in self.boards.items():
            followers = {endpoint_name(endpoint) for endpoint in self._node.get_subscriptions_info_by_topic(CLOCK)}
            around = Surroundings(name in there, name in followers, self._node.count_publishers(CLOCK) > 0)
            with self.lock:
                board.around = around
        return back, forgotten

    def _follow(self, planner: PlannerFound) -> None:
        name = planner.name
        if name in self._ears:
            self._ears.pop(name).close()
        elif len(self.boards) >= MOST_PLANNERS:
            self.warn(f'{name}: is not shown; there is room for {MOST_PLANNERS} planners')
            return
        self._found[name] = planner
        with self.lock:
            board = self.boards.setdefault(name, Board())
        self._ears[name] = Ears(self._node, planner, board, self.lock, self.guarded)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        at_s, now_s = seconds(message.header.stamp), time.monotonic()
        for name, board in self.boards.items():
            entries = entries_seen(message, name)
            if entries:
                with self.lock:
                    board.see_diagnostics(at_s, entries, now_s)

    def guarded(self, what: str, action: Callable[..., None]) -> Callable[..., None]:
        """Return an action that logs exceptions, because messages and answers come from any node."""
        def guarded(*arguments: Any) -> None:
            try:
                action(*arguments)
            except Exception as error:
                self.warn(f'{what}: {type(error).__name__}: {error}')
        return guarded

    def warn(self, sentence: str) -> None:
        """Log a warning, once."""
        if self._news.has(sentence):
            self._node.get_logger().warning(sentence)


class Ears:
    """Fills a Board, under its lock, with the messages of a planner and of its inputs."""

    def __init__(self, node: Node, planner: PlannerFound, board: Board, lock: Lock,
                 guarded: Callable[[str, Callable[..., None]], Callable[..., None]]) -> None:
        """Subscribe; `guarded(what, action)` makes the callbacks."""
        self._node, self._board, self._lock = node, board, lock
        # Publishers of other qualities of service are not worth a warning each.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)

        def subscribe(kind: type, topic: str, see: Callable[[Any], None], qos: QoSProfile,
                      raw: bool = False) -> Any:
            return node.create_subscription(kind, topic, guarded(topic, see), qos, raw=raw,
                                            event_callbacks=quiet)
        self._subscriptions = [
            subscribe(HvchCommand, planner.command_topic, self._on_command, LATEST),
            subscribe(PreheatPlan, planner.plan_topic, self._on_plan, LATCHED),
            subscribe(BatteryState, planner.battery_topic, self._on_battery, LATEST)]
        if planner.source_topic:
            self._subscriptions.append(subscribe(
                HeatSourceCommand, planner.source_topic, self._on_source, SOURCES))
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

    def _on_command(self, message: HvchCommand) -> None:
        with self._lock:
            self._board.see_command(seconds(message.header.stamp), message.battery_heating_power, message.reason,
                                    time.monotonic(), seconds(message.valid_until))

    def _on_source(self, message: HeatSourceCommand) -> None:
        with self._lock:
            self._board.see_source(seconds(message.header.stamp), message.name, message.battery_heating_power)

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


def find_planners(node: Node, known: dict[str, PlannerFound]) -> dict[str, PlannerFound]:
    """Return the planners that are there, by name; those in `known` are not examined again."""
    found: dict[str, PlannerFound] = {}
    for topic, types in node.get_topic_names_and_types():
        if PLAN not in types:
            continue
        for endpoint in node.get_publishers_info_by_topic(topic):
            if endpoint.topic_type != PLAN or endpoint.node_name.startswith('_'):
                continue
            name = endpoint_name(endpoint)
            earlier = known.get(name)
            if earlier is not None and earlier.plan_topic == topic:
                found[name] = earlier
                continue
            planner = _examine(node, name, endpoint.node_name, endpoint.node_namespace, topic)
            if planner is not None:
                found[name] = planner
    return found


def _examine(node: Node, full_name: str, name: str, namespace: str, plan_topic: str) -> PlannerFound | None:
    try:
        out = node.get_publisher_names_and_types_by_node(name, namespace)
        into = node.get_subscriber_names_and_types_by_node(name, namespace)
    except NodeNameNonExistentError:
        # Its endpoints are known before its name.
        return None
    command, source, battery, route, answer = (
        next((topic for topic, types in topics if kind in types), '')
        for topics, kind in ((out, COMMAND), (out, SOURCE), (into, BATTERY), (into, ROUTE), (into, ANSWER)))
    # Half discovered.
    return (PlannerFound(full_name, plan_topic, command, battery, route, answer, source)
            if command and battery else None)
