# SPDX-License-Identifier: Apache-2.0
"""Finds other nodes on a node's topics that cannot exchange messages with it."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from rclpy.qos import qos_check_compatible, QoSCompatibility

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from rclpy.node import Node
    from rclpy.qos import QoSProfile
    from rclpy.topic_endpoint_info import TopicEndpointInfo

# rmw's name for an endpoint whose node it has not discovered.
NAMELESS = '_NODE_NAME_UNKNOWN_'
# Prefix of the hash of a message definition (REP 2016).
HASH = 'RIHS01_'


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of the node that a TopicEndpointInfo belongs to."""
    if endpoint.node_name == NAMELESS:
        return 'a node whose name is unknown'
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


class Surroundings:
    """Finds publishers and subscriptions whose type or quality of service does not fit a node's own."""

    def __init__(self, node: Node, subscribes: Iterable[str], publishes: Iterable[str],
                 single: Iterable[str] = ()) -> None:
        """Watch the topics that the node subscribes to and publishes; those in `single` need one publisher."""
        self._node = node
        self._single = frozenset(node.resolve_topic_name(topic) for topic in single)
        self._subscribes = [node.resolve_topic_name(topic) for topic in subscribes]
        self._publishes = [node.resolve_topic_name(topic) for topic in publishes]

    def problems(self) -> list[str]:
        """Return a sentence for each incompatible endpoint."""
        node, problems = self._node, []
        for topic in self._subscribes:
            own = self._own(node.get_subscriptions_info_by_topic(topic))
            publishers = node.get_publishers_info_by_topic(topic)
            if topic in self._single and len(publishers) > 1:
                names = ', '.join(sorted(map(endpoint_name, publishers)))
                problems.append(f'{topic} has {len(publishers)} publishers, {names}; it must have one')
            for other in publishers:
                problems.append(_problem(
                    other, f'publishes {topic}', own, partial(
                        qos_check_compatible, other.qos_profile)))
        for topic in self._publishes:
            own = self._own(node.get_publishers_info_by_topic(topic))
            for other in node.get_subscriptions_info_by_topic(topic):
                problems.append(_problem(
                    other, f'subscribes to {topic}', own, partial(
                        qos_check_compatible, subscription_qos=other.qos_profile)))
        return [problem for problem in problems if problem]

    def _own(self, endpoints: Iterable[TopicEndpointInfo]) -> list[TopicEndpointInfo]:
        own_name = self._node.get_fully_qualified_name()
        return [endpoint for endpoint in endpoints if endpoint_name(endpoint) == own_name]


def _problem(other: TopicEndpointInfo, what: str, own: Sequence[TopicEndpointInfo],
             check: Callable[[QoSProfile], tuple[QoSCompatibility, str]]) -> str:
    """Return a sentence on an endpoint that fits none of the node's own; '' if it fits."""
    if not own:
        return ''
    expected, version = own[0].topic_type, str(own[0].topic_type_hash)
    sentence = f'{endpoint_name(other)} {what}'
    if other.topic_type != expected:
        return f'{sentence} as {other.topic_type}; the type must be {expected}'
    other_version = str(other.topic_type_hash)
    # Not every middleware reports it.
    if version != other_version and version.startswith(HASH) and other_version.startswith(HASH):
        return (f'{sentence} as another version of {expected}; build both nodes from the same '
                'message definitions')
    reasons: set[str] = set()
    for endpoint in own:
        compatibility, reason = check(endpoint.qos_profile)
        if compatibility != QoSCompatibility.ERROR:
            return ''
        reasons.update(part.strip().removeprefix('ERROR: ').lower()
                       for part in reason.split(';') if part.strip())
    return f'{sentence} with an incompatible quality of service: {", ".join(sorted(reasons))}'
