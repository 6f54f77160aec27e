# SPDX-License-Identifier: Apache-2.0
"""
Finds planners in the ROS graph by the types of their topics, whatever these are called, and follows them.

Subscriptions are best effort and of depth 1, except for latched topics: a publisher never waits for this process,
nor keeps samples for it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
from threading import Lock
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
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
from bev_preheat.nodes.topics import BEST_EFFORT, LARGEST_ROUTE_BYTES, LATCHED, MOST_SOURCES
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, HvchStatus, PreheatPlan, RoutePlan

# The full names of a planner's topics by the type of their messages; '' if it has none.
Topics = dict[str, str]

PLAN, COMMAND, SOURCE, ROUTE, ANSWER = (f'bev_preheat_msgs/msg/{name}' for name in (
    'PreheatPlan', 'HvchCommand', 'HeatSourceCommand', 'RoutePlan', 'HvchStatus'))
BATTERY = 'sensor_msgs/msg/BatteryState'
CLOCK = '/clock'
# Of each heat source a command comes at the same instant.
SOURCES = QoSProfile(depth=MOST_SOURCES, reliability=QoSReliabilityPolicy.BEST_EFFORT)
# `look` is called so often [s].
PLANNERS_PERIOD_S = 1.0
MOST_PLANNERS = 24
# A planner that has been gone for this time is forgotten [s].
FORGOTTEN_AFTER_S = 900.0
# A killed planner stays in the graph for up to 20 s beside its successor [s].
RIVALS_AFTER_S = 25.0


class Planners:
    """
    Follows the planners of the ROS graph; `boards` has the Board of each by the full name of its node.

    `look` is to be called about once a second, in the thread of the node's callbacks;
    other threads read `boards` under `lock`.
    """

    def __init__(self, node: Node) -> None:
        """Listen to diagnostics."""
        self._node, self._news = node, RepetitionFilter()
        self.lock = Lock()
        self.boards: dict[str, Board] = {}
        self._found: dict[str, Topics] = {}
        self._subscriptions: dict[str, list[Any]] = {}
        self._gone_s: dict[str, float] = {}
        # When each was the only publisher of its plan [s].
        self._alone_s: dict[str, float] = {}
        node.create_subscription(
            DiagnosticArray, '/diagnostics', self.guarded('/diagnostics', self._on_diagnostics), QoSProfile(
                depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT))

    def look(self) -> tuple[list[str], list[str]]:
        """Look for planners; return those that came back, perhaps with another vehicle, and lost ones, by name."""
        there, now_s, back = find_planners(self._node, self._found), time.monotonic(), list[str]()
        for name, topics in there.items():
            self._gone_s.pop(name, None)
            if name in self.boards and not self.boards[name].around.is_there:
                back.append(name)
            if self._found.get(name) != topics:
                self._follow(name, topics)
        forgotten = [name for name in self._found
                     if name not in there and now_s - self._gone_s.setdefault(name, now_s) > FORGOTTEN_AFTER_S]
        for name in forgotten:
            self._unsubscribe(name)
            del self._found[name], self._gone_s[name], self._alone_s[name]
            with self.lock:
                del self.boards[name]
        for name, board in self.boards.items():
            followers = {endpoint_name(endpoint) for endpoint in self._node.get_subscriptions_info_by_topic(CLOCK)}
            around = Surroundings(name in there, name in followers, self._node.count_publishers(CLOCK) > 0,
                                  self._rivals(name, now_s))
            with self.lock:
                board.around = around
        return back, forgotten

    def _rivals(self, name: str, now_s: float) -> str:
        """Return the sentence on several publishers of a planner's plan that are there for RIVALS_AFTER_S."""
        topic = self._found[name][PLAN]
        publishers = sorted(endpoint_name(endpoint) for endpoint in self._node.get_publishers_info_by_topic(topic)
                            if endpoint.topic_type == PLAN)
        if len(publishers) < 2:
            self._alone_s[name] = now_s
        return '' if now_s - self._alone_s.setdefault(name, now_s) < RIVALS_AFTER_S else (
            f'{topic} has {len(publishers)} publishers, {", ".join(publishers)}; it must have one')

    def _follow(self, name: str, topics: Topics) -> None:
        if name in self._subscriptions:
            self._unsubscribe(name)
        elif len(self.boards) >= MOST_PLANNERS:
            self.warn(f'{name}: is not shown; there is room for {MOST_PLANNERS} planners')
            return
        self._found[name] = topics
        with self.lock:
            board = self.boards.setdefault(name, Board())
        # Publishers of other qualities of service are not worth a warning each.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._subscriptions[name] = [
            self._node.create_subscription(
                message, topics[kind], self.guarded(topics[kind], partial(self._take, board)), qos,
                raw=kind == ROUTE, event_callbacks=quiet)
            for kind, message, qos in (
                (COMMAND, HvchCommand, BEST_EFFORT), (SOURCE, HeatSourceCommand, SOURCES),
                (ANSWER, HvchStatus, BEST_EFFORT), (PLAN, PreheatPlan, LATCHED),
                (BATTERY, BatteryState, BEST_EFFORT),
                # A route may be published with any quality of service.
                (ROUTE, RoutePlan, LATCHED), (ROUTE, RoutePlan, BEST_EFFORT)) if topics[kind]]

    def _unsubscribe(self, name: str) -> None:
        for subscription in self._subscriptions.pop(name):
            self._node.destroy_subscription(subscription)

    def _take(self, board: Board, message: Any) -> None:
        """Fill a Board with a message of its planner, or of the planner's inputs; a route comes as bytes."""
        now_s = time.monotonic()
        with self.lock:
            if board.around.rivals and isinstance(message, HvchCommand | HeatSourceCommand | PreheatPlan):
                return
            match message:
                case HvchCommand():
                    board.see_command(seconds(message.header.stamp), message.battery_heating_power, message.reason,
                                      now_s, seconds(message.valid_until))
                case HeatSourceCommand():
                    board.see_source(seconds(message.header.stamp), message.name, message.battery_heating_power)
                case HvchStatus():
                    event = heater_status_event(message, math.inf)
                    if isinstance(event, HeaterStatusArrived):
                        board.see_answer(event.status)
                case PreheatPlan():
                    board.see_plan(plan_seen(message), now_s)
                case BatteryState():
                    board.see_battery(seconds(message.header.stamp), read_temperatures(message, []).battery_c,
                                      message.percentage, now_s)
                # The planner refuses longer ones unread, too.
                case bytes() if len(message) <= LARGEST_ROUTE_BYTES:
                    board.see_route(route_seen(deserialize_message(message, RoutePlan)))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        at_s, now_s = seconds(message.header.stamp), time.monotonic()
        for name, board in self.boards.items():
            entries = entries_seen(message, name)
            if entries and not board.around.rivals:
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


def find_planners(node: Node, known: dict[str, Topics]) -> dict[str, Topics]:
    """Return the Topics of planners that are there, by full name; `known` are those found before."""
    found: dict[str, Topics] = {}
    for topic, types in node.get_topic_names_and_types():
        if PLAN not in types:
            continue
        for endpoint in node.get_publishers_info_by_topic(topic):
            if endpoint.topic_type != PLAN or endpoint.node_name.startswith('_'):
                continue
            name = endpoint_name(endpoint)
            # Again each time, because some may be discovered later.
            topics = _examine(node, endpoint.node_name, endpoint.node_namespace, topic) or known.get(name)
            if topics is not None:
                found[name] = topics
    return found


def _examine(node: Node, name: str, namespace: str, plan_topic: str) -> Topics | None:
    try:
        out = node.get_publisher_names_and_types_by_node(name, namespace)
        into = node.get_subscriber_names_and_types_by_node(name, namespace)
    except NodeNameNonExistentError:
        # Its endpoints are known before its name.
        return None
    topics = {PLAN: plan_topic} | {
        kind: next((topic for topic, types in ends if kind in types), '')
        for ends, kind in ((out, COMMAND), (out, SOURCE), (into, BATTERY), (into, ROUTE), (into, ANSWER))}
    # Otherwise half discovered.
    return topics if topics[COMMAND] and topics[BATTERY] else None
