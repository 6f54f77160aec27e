# SPDX-License-Identifier: Apache-2.0
"""The heater's energy along a drive: as commanded and as delivered, and the spans without a valid command."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.vehicle.heater_controller import Refusal

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.control.heater_power import HeaterStatus

WH_PER_W_NS = 1.0 / 3600.0 / NS_PER_S
# An answer of the heater's controller holds this long without another one [ns].
ANSWER_HOLDS_NS = 5 * NS_PER_S
# The recorded power of a log's heater holds this long without another one, and answers that far apart belong
# together [ns].
RECORDED_HOLD_NS = 60 * NS_PER_S
# A longer time between two steps is a clock that was set [ns].
LONGEST_SPAN_NS = 86400 * NS_PER_S
KEPT_SPANS = 10_000
# With these the heater's controller has no command that it may follow.
WITHOUT = frozenset((Refusal.NO_COMMAND, Refusal.INVALID_COMMAND, Refusal.INVALID_LEASE, Refusal.COMMAND_CONFLICT))


class Span(NamedTuple):
    """A period between two instants [ns]."""

    from_ns: int
    to_ns: int

    @property
    def length_s(self) -> float:
        """Its length [s]."""
        return (self.to_ns - self.from_ns) / NS_PER_S


class HeaterAccount:
    """
    Adds up the heater's energy; `command` and `answer` take the instants in order.

    A command counts until the next one or the end of its lease. Between two answers of the heater's controller
    (`hvch_status`) the mean of their powers counts, and after the last one before a long silence its power for
    ANSWER_HOLDS_NS. Without a valid command is the heater after the end of a lease, and
    while its controller reports that it has none: the controller's clock may be ahead of the planner's.
    """

    def __init__(self) -> None:
        """Start without energy."""
        self._commanded_wh = self._delivered_wh = 0.0
        # Instant [ns], power [W] and end [ns] of the latest command and of the latest delivery.
        self._command: tuple[int, float, int] | None = None
        self._answer: tuple[int, float, int] | None = None
        self._lapsed: list[Span] = []
        self._unserved: list[Span] = []
        self._is_unserved = False

    def command(self, now_ns: int, power_w: float, until_ns: int) -> None:
        """Take the command [W] that holds at an instant, and the end of its lease [ns]."""
        if self._command is not None:
            before_ns, before_w, end_ns = self._command
            self._commanded_wh += before_w * _held_ns(before_ns, now_ns, end_ns) * WH_PER_W_NS
            if max(before_ns, end_ns) < now_ns <= before_ns + LONGEST_SPAN_NS:
                _add(self._lapsed, max(before_ns, end_ns), now_ns)
        self._command = now_ns, power_w, until_ns

    def deliver(self, now_ns: int, power_w: float, until_ns: int) -> None:
        """Take the delivered power [W] from an instant on, until the next one or `until_ns` [ns]."""
        self._pay(now_ns)
        self._answer = now_ns, power_w, until_ns

    def answer(self, status: HeaterStatus) -> None:
        """Take an answer of the heater's controller; a repeated answer counts once."""
        now_ns, before = status.stamp_ns, self._answer
        if before is not None and before[0] == now_ns:
            return
        if self._is_unserved and before is not None and before[0] < now_ns:
            _add(self._unserved, before[0], min(now_ns, before[2]))
        if before is not None and 0 < now_ns - before[0] <= RECORDED_HOLD_NS:
            self._answer = before[0], 0.5 * (before[1] + status.confirmed_w), now_ns
        self.deliver(now_ns, status.confirmed_w, now_ns + ANSWER_HOLDS_NS)
        # Before the planner's first command there is nothing to serve.
        self._is_unserved = status.refusal in WITHOUT and self._command is not None

    def _pay(self, now_ns: int) -> None:
        if self._answer is not None:
            before_ns, before_w, end_ns = self._answer
            self._delivered_wh += before_w * _held_ns(before_ns, now_ns, end_ns) * WH_PER_W_NS

    @property
    def commanded_wh(self) -> float | None:
        """The commanded energy [Wh]; None: there was no command."""
        return None if self._command is None else self._commanded_wh

    @property
    def delivered_wh(self) -> float | None:
        """The delivered energy [Wh]; None: nothing reported it."""
        return None if self._answer is None else self._delivered_wh

    @property
    def without_command(self) -> list[Span]:
        """The spans without a valid command, in order."""
        return united([*self._lapsed, *self._unserved])

    def latest_without_command(self, most: int) -> list[Span]:
        """Return some of the spans without a valid command: those among the latest ones, in order."""
        return united([*self._lapsed[-most:], *self._unserved[-most:]])[-most:]


def united(spans: Iterable[Span]) -> list[Span]:
    """Return the union of spans, in order."""
    found: list[Span] = []
    for span in sorted(spans):
        _add(found, *span)
    return found


def _held_ns(before_ns: int, now_ns: int, end_ns: int) -> int:
    return max(min(now_ns, end_ns) - before_ns, 0)


def _add(spans: list[Span], from_ns: int, to_ns: int) -> None:
    """Add a span that begins no earlier than the last one; it continues that if they touch."""
    if spans and spans[-1].from_ns <= from_ns <= spans[-1].to_ns:
        spans[-1] = Span(spans[-1].from_ns, max(spans[-1].to_ns, to_ns))
    elif to_ns > from_ns:
        spans.append(Span(from_ns, to_ns))
        # Of a command that fails for days the latest spans are kept.
        del spans[:-KEPT_SPANS]
