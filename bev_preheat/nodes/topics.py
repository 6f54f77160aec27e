# SPDX-License-Identifier: Apache-2.0
"""
Publishers that notice the other publishers of their topic, and the receiver of route plans of any publisher.

Of `/clock` and the heater's commands, only received messages count: a killed process stays in the graph for some
20 s, and must not keep its successor from working. The graph shows when to listen, and the names of the nodes.

Each route plan is received once. No single subscription suits all publishers: a latched subscription does not
match volatile publishers, and a best-effort subscription may lose parts of a long route.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
import time
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from bev_preheat.control.decision import Command
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.heater import command_message, source_messages
from bev_preheat.nodes.node import ProgramNode
from bev_preheat.nodes.setup_watch import endpoint_name
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.segments import MOST_SEGMENTS
from bev_preheat.vehicle.description import Vehicle
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, RoutePlan

# A ROS message; rclpy has no type for it.
Message = Any


LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Match reliable and best-effort publishers.
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
LISTENING = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
PUBLICATIONS_KEPT = 256
# DDS stores the instant of a publication in units of 2^-32 s.
DDS_RESOLUTION_NS = 1000
LONGEST_LEASE_NS = 30 * NS_PER_S
MOST_SOURCES = 20


class ListeningPublisher:
    """Publishes, and passes others' messages to `on_other`; subscribes only while another publisher is there."""

    def __init__(self, node: Node, message_type: type[Message], topic: str, qos: QoSProfile | int,
                 on_other: Callable[[bytes], object]) -> None:
        self._node, self._message_type, self._on_other = node, message_type, on_other
        self.publisher = node.create_publisher(message_type, topic, qos)
        self._publications: deque[tuple[int, int]] = deque(maxlen=PUBLICATIONS_KEPT)
        self._subscription: Subscription | None = None

    @property
    def is_alone(self) -> bool:
        """Whether the graph showed no other publisher at the last look."""
        return self._subscription is None

    def publish(self, message: Message) -> None:
        """Publish a message."""
        before_ns = time.time_ns()
        self.publisher.publish(message)
        self._publications.append((before_ns - DDS_RESOLUTION_NS, time.time_ns() + DDS_RESOLUTION_NS))

    def look(self) -> None:
        """Listen while the graph shows another publisher; call it periodically."""
        topic = self.publisher.topic_name
        has_others = self._node.count_publishers(topic) > 1
        if has_others and self.is_alone:
            self._subscription = self._node.create_subscription(
                self._message_type, topic, self._on_message, LISTENING, raw=True)
        elif not has_others and not self.is_alone:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def names_of_others(self) -> str:
        """Return the names of the other publishers' nodes, as the graph shows them."""
        own = self._node.get_fully_qualified_name()
        names = [endpoint_name(endpoint) for endpoint in
                 self._node.get_publishers_info_by_topic(self.publisher.topic_name)]
        others = sorted(set(names) - {own})
        if names.count(own) > 1:
            others.append(f'another node named {own}')
        return ' and '.join(others) or 'another node'

    def _on_message(self, serialized: bytes, info: Mapping[str, int]) -> None:
        # The node also receives its own messages, which were sent while `publish` ran. A message older than all
        # recorded publications cannot be assigned.
        sent_ns = info['source_timestamp']
        if self._publications and sent_ns < self._publications[0][0]:
            return
        if not any(begin_ns <= sent_ns <= end_ns for begin_ns, end_ns in self._publications):
            self._on_other(serialized)


class CommandPublisher:
    """
    Publishes a node's HvchCommands and HeatSourceCommands, and knows its rivals.

    A rival exists until the lease of its last received command expires, and only while the graph shows a
    second publisher.
    """

    def __init__(self, node: Node, lease_ns: Callable[[], int], on_rival: Callable[[], object]) -> None:
        """
        Advertise.

        `lease_ns()` returns the node's own lease [ns], the shortest lifetime of a rival. `on_rival()` is called
        when a command of another node is received.

        The initial lease is also the deadline and the liveliness that DDS offers to a heater's controller; DDS
        counts in real time. Only a command asserts liveliness, so a planner that hangs counts as gone.
        """
        lease = Duration(nanoseconds=lease_ns())

        def publisher(message_type: type[Message], topic: str, depth: int) -> ListeningPublisher:
            return ListeningPublisher(node, message_type, topic, QoSProfile(
                depth=depth, deadline=lease, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                liveliness_lease_duration=lease), partial(self._on_other, message_type))

        self.hvch = publisher(HvchCommand, 'hvch_command', 1)
        # Messages of several sources at once must not replace each other.
        self._sources = publisher(HeatSourceCommand, 'heat_source_command', MOST_SOURCES)
        self._own: frozenset[str] = frozenset()
        self._node, self._lease_ns, self._on_rival = node, lease_ns, on_rival
        self._heard_ns: int | None = None
        self._heard_on = self.hvch
        self._believed_ns = 0
        self._names = ''

    def command(self, command: Command, vehicle: Vehicle, now_ns: int) -> None:
        """Publish a Command of now [ns] to the heat sources of a Vehicle, the HVCH last."""
        self._own = frozenset(source.name for source in vehicle.heat_sources)
        for message in source_messages(command, vehicle, now_ns):
            self._sources.publish(message)
        self.hvch.publish(command_message(command, now_ns))

    def look(self) -> None:
        """Listen while the graph shows another publisher; call it periodically."""
        self.hvch.look()
        self._sources.look()
        if self._heard_ns is not None:
            # A publisher is discovered shortly before the name of its node.
            self._names = self._heard_on.names_of_others()

    def rivals(self, now_ns: int) -> str:
        """Return the names of the other commanding nodes at an instant [ns]; '' without others."""
        if self._heard_ns is None:
            return ''
        if self._heard_on.is_alone or not 0 <= now_ns - self._heard_ns <= self._believed_ns:
            self._heard_ns = None
            self._names = ''
        return self._names

    def _on_other(self, message_type: type[Message], serialized: bytes) -> None:
        lease_ns = 0
        # A message that cannot be read is a rival's, too.
        with suppress(Exception):
            message = deserialize_message(serialized, message_type)
            # Another node may command sources that are not in the vehicle file.
            if message_type is HeatSourceCommand and message.name not in self._own:
                return
            lease_ns = nanoseconds(message.valid_until) - nanoseconds(message.header.stamp)
        self._heard_ns = self._node.get_clock().now().nanoseconds
        self._heard_on = self.hvch if message_type is HvchCommand else self._sources
        self._believed_ns = max(self._lease_ns(), min(lease_ns, LONGEST_LEASE_NS))
        self._names = self._names or self._heard_on.names_of_others()
        self._on_rival()


TOPIC = 'route_plan'
RELIABLE = QoSProfile(depth=1)
# Seven arrays of numbers of 8 bytes, and room for the rest: identification, stops.
LARGEST_ROUTE_BYTES = MOST_SEGMENTS * 7 * 8 + 100_000
# A latched sample arrives again with every new subscription.
MESSAGES_REMEMBERED = 64
PUBLISHER_PERIOD_S = 0.5


class RouteListener:
    """
    Calls `on_route(message)` for each RoutePlan and `on_refused(InvalidInput)` for unreadable ones.

    The first subscription is latched, the second matches volatile publishers; a third one is created once the
    graph shows a best-effort publisher. Duplicates of a message are dropped. A message longer than the longest
    route is refused before it is converted.
    """

    def __init__(self, node: ProgramNode, on_route: Callable[[RoutePlan], object],
                 on_refused: Callable[[InvalidInput], object]) -> None:
        self._node, self._on_route, self._on_refused = node, on_route, on_refused
        self._handled: deque[tuple[int, int, int]] = deque(maxlen=MESSAGES_REMEMBERED)
        for profile in (LATCHED, RELIABLE):
            self._subscribe(profile)
        # In real time: publishers come and go independently of the node's clock.
        self._timer = node.look_regularly(PUBLISHER_PERIOD_S, TOPIC, self._look)

    def _subscribe(self, profile: QoSProfile) -> None:
        self._node.create_subscription(
            RoutePlan, TOPIC, self._on_bytes, profile, raw=True,
            # Together they match every publisher, so a single mismatch is not worth a report.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))

    def _on_bytes(self, serialized: bytes, info: Mapping[str, int]) -> None:
        key = (info['source_timestamp'], info['publication_sequence_number'], len(serialized))
        if key in self._handled:
            return
        self._handled.append(key)
        if len(serialized) > LARGEST_ROUTE_BYTES:
            self._on_refused(InvalidInput(
                f'the message has {len(serialized) / 1e6:.1f} MB; at most '
                f'{LARGEST_ROUTE_BYTES / 1e6:.1f} MB are read, enough for {MOST_SEGMENTS} segments'))
            return
        try:
            message = deserialize_message(serialized, RoutePlan)
        except Exception as error:
            self._on_refused(InvalidInput(f'the message cannot be read: {type(error).__name__}: {error}'))
            return
        self._on_route(message)

    def _look(self) -> None:
        if any(endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
               for endpoint in self._node.get_publishers_info_by_topic(TOPIC)):
            self._timer.cancel()
            self._subscribe(BEST_EFFORT)
