# SPDX-License-Identifier: Apache-2.0
"""
Receives each route plan once, from publishers of any quality of service.

No single subscription suits all publishers: a latched subscription does not match volatile publishers, and a
best-effort subscription may lose parts of a long route.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from bev_preheat.errors import InvalidInput
from bev_preheat.route.segments import MOST_SEGMENTS
from bev_preheat_msgs.msg import RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from bev_preheat.nodes.node import ProgramNode

TOPIC = 'route_plan'
LATCHED_ROUTE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = QoSProfile(depth=1)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
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
        """Subscribe."""
        self._node, self._on_route, self._on_refused = node, on_route, on_refused
        self._handled: deque[tuple[int, int, int]] = deque(maxlen=MESSAGES_REMEMBERED)
        for profile in (LATCHED_ROUTE, RELIABLE):
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
