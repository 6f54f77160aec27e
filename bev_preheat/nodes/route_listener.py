# SPDX-License-Identifier: Apache-2.0
"""
Receives each route plan once, from publishers of any quality of service.

No single subscription suits all publishers: a latched subscription does not match volatile publishers, and a
best-effort subscription may lose parts of a long route.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import given_parameters
from bev_preheat.route.segments import MOST_SEGMENTS
from bev_preheat_msgs.msg import RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node
    from rclpy.subscription import Subscription

TOPIC = 'route_plan'
RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
            QoSPolicyKind.DURABILITY)
# Seven arrays of numbers of 8 bytes, and room for the rest: identification, stops.
LARGEST_ROUTE_BYTES = MOST_SEGMENTS * 7 * 8 + 100_000
# A latched sample arrives again with every new subscription.
MESSAGES_REMEMBERED = 64
PUBLISHER_PERIOD_S = 0.5


class RouteListener:
    """
    Calls `on_route(message)` for each RoutePlan and `on_refused(InvalidInput)` for unreadable ones.

    The first subscription is latched (reliable, transient local, depth 1), and its quality of
    service can be overridden by parameters; the second matches volatile publishers. A third one is
    created once the graph shows a best-effort publisher. Duplicates of a message are dropped. A message longer
    than the longest route is refused before it is converted.
    """

    def __init__(self, node: Node, on_route: Callable[[RoutePlan], object],
                 on_refused: Callable[[InvalidInput], object]) -> None:
        """Subscribe; raises InvalidInput if an override of the quality of service is wrong."""
        self._node, self._on_route, self._on_refused = node, on_route, on_refused
        check_overrides(node)
        self._handled: deque[tuple[int, int, int]] = deque(maxlen=MESSAGES_REMEMBERED)
        self._publishers_of_long_route: set[tuple[int, ...]] | None = None
        self._news, self._hears_best_effort = RepetitionFilter(), False
        first = self._subscribe(
            QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            QoSOverridingOptions(POLICIES))
        self._latching_profile = first.qos_profile
        self._subscriptions = [first, self._subscribe(RELIABLE)]
        # In real time: publishers come and go independently of the node's clock.
        node.create_timer(PUBLISHER_PERIOD_S, self._on_timer, clock=Clock(
            clock_type=ClockType.STEADY_TIME))

    def _subscribe(self, profile: QoSProfile,
                   overriding: QoSOverridingOptions | None = None) -> Subscription:
        return self._node.create_subscription(
            RoutePlan, TOPIC, self._on_bytes, profile, raw=True,
            # Together they match every publisher, so a single mismatch is not worth a report.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=overriding)

    def _on_bytes(self, serialized: bytes, info: Mapping[str, int]) -> None:
        try:
            self._handle(serialized, info)
        except Exception as error:
            self._on_refused(InvalidInput(
                f'the message cannot be read: {type(error).__name__}: {error}'))

    def _handle(self, serialized: bytes, info: Mapping[str, int]) -> None:
        key = (info['source_timestamp'], info['publication_sequence_number'], len(serialized))
        if key in self._handled:
            return
        self._handled.append(key)
        if len(serialized) > LARGEST_ROUTE_BYTES:
            self._free_buffers()
            self._on_refused(InvalidInput(
                f'the message has {len(serialized) / 1e6:.1f} MB; at most '
                f'{LARGEST_ROUTE_BYTES / 1e6:.1f} MB are read, enough for {MOST_SEGMENTS} segments'))
            return
        message = deserialize_message(serialized, RoutePlan)
        self._latch_again()
        self._on_route(message)

    # The middleware holds a buffer of the longest message as long as a subscription exists.

    def _free_buffers(self) -> None:
        """Subscribe again, but not to latched samples: the long one would arrive at once."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions, self._hears_best_effort = [self._subscribe(RELIABLE)], False
        self._publishers_of_long_route = self._publishers()

    def _latch_again(self) -> None:
        if self._publishers_of_long_route is not None:
            self._publishers_of_long_route = None
            self._subscriptions.append(self._subscribe(self._latching_profile))

    def _on_timer(self) -> None:
        try:
            self._look()
        except Exception as error:
            sentence = f'{TOPIC}: {type(error).__name__}: {error}'
            if self._news.has(sentence):
                self._node.get_logger().error(sentence)

    def _look(self) -> None:
        endpoints = self._node.get_publishers_info_by_topic(TOPIC)
        if not self._hears_best_effort and any(
                endpoint.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
                for endpoint in endpoints):
            self._hears_best_effort = True
            self._subscriptions.append(self._subscribe(BEST_EFFORT))
        # Another publisher may have latched a good route.
        if (self._publishers_of_long_route is not None
                and self._publishers() != self._publishers_of_long_route):
            self._latch_again()

    def _publishers(self) -> set[tuple[int, ...]]:
        return {tuple(endpoint.endpoint_gid)
                for endpoint in self._node.get_publishers_info_by_topic(TOPIC)}


def check_overrides(node: Node) -> None:
    """Raise InvalidInput if a qos_overrides parameter for the route's subscription is wrong."""
    topic = node.resolve_topic_name(TOPIC)
    problems = []
    for name, parameter in given_parameters(node).items():
        prefix, _, rest = name.partition('qos_overrides.')
        given_topic, _, kind = rest.partition('.')
        if prefix or not kind.startswith('subscription.'):
            continue
        if given_topic == f'/{TOPIC}' != topic:
            problems.append(f'{name}: {TOPIC} of this node is {topic}; write '
                            f'qos_overrides.{topic}.{kind}')
        elif given_topic == topic:
            problems += _value_problems(name, kind.partition('.')[2], parameter.value)
    if problems:
        raise InvalidInput(problems)


def _value_problems(name: str, policy: str, value: object) -> list[str]:
    texts = {'durability': DurabilityPolicy, 'reliability': ReliabilityPolicy,
             'history': HistoryPolicy}.get(policy)
    if texts is not None:
        allowed = [member.name.lower() for member in texts if member.name != 'UNKNOWN']
        if value not in allowed:
            return [f'{name}: {value!r} is not allowed; it must be one of {", ".join(allowed)}']
    elif policy == 'depth' and (type(value) is not int or value < 1):
        return [f'{name}: {value!r} is not allowed; it must be a whole number from 1 on']
    return []
