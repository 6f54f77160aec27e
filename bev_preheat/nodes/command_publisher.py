# SPDX-License-Identifier: Apache-2.0
"""Publishes the heater's commands, and detects another node that commands the same heater."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from bev_preheat.messages.fields import nanoseconds
from bev_preheat.nodes.listening_publisher import ListeningPublisher
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat_msgs.msg import HvchCommand

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node

LONGEST_LEASE_NS = 30 * NS_PER_S


class CommandPublisher(ListeningPublisher):
    """
    Publishes a node's HvchCommands and knows its rivals.

    A rival exists until the lease of its last received command expires, and only while the graph shows a
    second publisher.
    """

    def __init__(self, node: Node, lease_ns: Callable[[], int],
                 on_rival: Callable[[], object]) -> None:
        """
        Advertise.

        `lease_ns()` returns the node's own lease [ns], the shortest lifetime of a rival. `on_rival()` is called
        when a command of another node is received.

        The initial lease is also the deadline and the liveliness that DDS offers to a heater's controller; DDS
        counts in real time. Only a command asserts liveliness, so a planner that hangs counts as gone.
        """
        lease = Duration(nanoseconds=lease_ns())
        qos = QoSProfile(depth=1, deadline=lease, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                         liveliness_lease_duration=lease)
        super().__init__(node, HvchCommand, 'hvch_command', qos, self._on_other_command)
        self._lease_ns, self._on_rival = lease_ns, on_rival
        self._heard_ns: int | None = None
        self._believed_ns = 0
        self._names = ''

    def look(self) -> None:
        """Listen while the graph shows another publisher; call it periodically."""
        super().look()
        if self._heard_ns is not None:
            # A publisher is discovered shortly before the name of its node.
            self._names = self.names_of_others()

    def rivals(self, now_ns: int) -> str:
        """Return the names of the other commanding nodes at an instant [ns]; '' without others."""
        if self._heard_ns is None:
            return ''
        if self.is_alone or not 0 <= now_ns - self._heard_ns <= self._believed_ns:
            self._heard_ns = None
            self._names = ''
        return self._names

    def _on_other_command(self, serialized: bytes) -> None:
        self._heard_ns = self._node.get_clock().now().nanoseconds
        self._believed_ns = max(self._lease_ns(), min(_lease_ns(serialized), LONGEST_LEASE_NS))
        self._names = self._names or self.names_of_others()
        self._on_rival()


def _lease_ns(serialized: bytes) -> int:
    """Return the lease of a serialized HvchCommand [ns]; 0 if it cannot be read."""
    try:
        message = deserialize_message(serialized, HvchCommand)
    except Exception:
        return 0
    return nanoseconds(message.valid_until) - nanoseconds(message.header.stamp)
