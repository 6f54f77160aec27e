# SPDX-License-Identifier: Apache-2.0
"""Tells the senders of one topic apart, although rclpy does not say who sent a message."""

from __future__ import annotations

from collections import OrderedDict

# The oldest sender is forgotten beyond this number.
MOST_SENDERS = 16
# Depth of a heater's subscription: two planners answer the same battery state at nearly the same instant, and with
# depth 1 the later command would hide the earlier one, and with it the conflict.
HEARD_DEPTH = 20


class CommandSenders:
    """
    Numbers the senders by the sequence numbers of their publications, which rise by publisher.

    A killed publisher stays in the graph for some 20 s, so the graph alone cannot tell two commanders from a
    restarted one.
    """

    def __init__(self) -> None:
        """Know no sender yet."""
        # The latest sequence number by sender, the longest silent first.
        self._latest: OrderedDict[int, int] = OrderedDict()
        self._known = 0

    def sender(self, sequence_number: int | None) -> int:
        """
        Return the number of the sender of a publication.

        Its own sequence continues nearest below. Without numbers, which some middlewares do not give, all
        publications count as one sender's.
        """
        if sequence_number is None:
            return 0
        before = [(latest, sender) for sender, latest in self._latest.items() if latest < sequence_number]
        if before:
            _, sender = max(before)
        else:
            self._known += 1
            sender = self._known
        self._latest[sender] = sequence_number
        self._latest.move_to_end(sender)
        if len(self._latest) > MOST_SENDERS:
            self._latest.popitem(last=False)
        return sender
