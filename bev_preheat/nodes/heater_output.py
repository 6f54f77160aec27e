# SPDX-License-Identifier: Apache-2.0
"""
Executes `hvch_command` on CAN by the rules of `heater.controller`, and answers with `hvch_status`.

While a valid command is in force, the frames carry its power; at all other times 0 W. Frames end with the
process, or with the bus; the heater's own timeout applies then.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock, ClockType

from bev_preheat.heater.controller import (
    HeaterAnswer,
    HeaterController,
    HeaterLimits,
    Instant,
    Refusal,
    SERVED,
    Verdict,
)
from bev_preheat.nodes.bus_messages import bus_entry
from bev_preheat.nodes.can_heater import LAST_FRAMES
from bev_preheat.nodes.command_senders import CommandSenders, HEARD_DEPTH
from bev_preheat.nodes.heater_messages import heater_command, LEVELS, RefusalNews, status_message, STATUS_PERIOD_S
from bev_preheat.nodes.process import LAST_WORDS_TIME
from bev_preheat_msgs.msg import HvchCommand, HvchStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node

    from bev_preheat.bus.can_source import CanSource

COMMAND, STATUS = 'hvch_command', 'hvch_status'


class HeaterOutput:
    """A HeaterController whose heater is a frame on CAN."""

    def __init__(self, node: Node, source: CanSource, longest_lease_s: float, clock_s: Callable[[], float],
                 log: Callable[[bool, str], None]) -> None:
        """Subscribe and begin to send; `clock_s` is the readings' clock, `log(is_refused, sentence)` logs."""
        assert source.heater_frame is not None
        self._node, self._source, self._clock_s, self._log = node, source, clock_s, log
        self._controller = HeaterController(HeaterLimits(
            source.heater_frame.highest_w, longest_lease_s=longest_lease_s))
        self._senders, self._refusal_news = CommandSenders(), RefusalNews()
        self._answer = HeaterAnswer(0.0, 0.0, Refusal.NO_COMMAND, 'no command has arrived yet')
        self._measured_w: float | None = None
        self._told, self._told_at_s = (Refusal.NO_COMMAND, 0.0), 0.0
        self._unsent = ''
        self._sent = 0
        self._status_publisher = node.create_publisher(HvchStatus, STATUS, 1)
        node.create_subscription(HvchCommand, COMMAND, self._on_command, HEARD_DEPTH)
        node.create_timer(source.heater_frame.period_s, self._on_frame,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _now(self) -> Instant:
        return Instant(self._node.get_clock().now().nanoseconds, time.monotonic_ns())

    def _on_command(self, message: HvchCommand, info: Mapping[str, int]) -> None:
        sender = self._senders.sender(info.get('publication_sequence_number'))
        self._controller.take(heater_command(message, sender), self._now())

    def _on_frame(self) -> None:
        now = self._now()
        self._measured_w, fault = self._source.heater_status(self._clock_s())
        answer = self._controller.step(now, obstacle=Verdict(Refusal.HEATER_FAULT, fault) if fault else SERVED)
        unsent = self._source.send_power(answer.active_w)
        if unsent and answer.active_w > 0.0:
            answer = answer._replace(active_w=0.0, refusal=Refusal.HEATER_FAULT, sentence=unsent)
        self._unsent, self._answer = unsent, answer
        self._sent += not unsent
        self._tell(now)

    def _tell(self, now: Instant) -> None:
        """Publish the status at a change, and every STATUS_PERIOD_S."""
        answer, now_s = self._answer, now.steady_ns * 1e-9
        news = answer.refusal, answer.requested_w
        if news == self._told and now_s - self._told_at_s < STATUS_PERIOD_S:
            return
        is_refused, sentence = self._refusal_news.sentence(answer)
        if sentence:
            self._log(is_refused, sentence)
        self._told, self._told_at_s = news, now_s
        self._status_publisher.publish(status_message(answer, now.clock_ns, self._measured_w))

    def end(self) -> None:
        """Send 0 W a few times, and say so."""
        for _ in range(LAST_FRAMES):
            self._source.send_power(0.0)
        self._status_publisher.publish(status_message(HeaterAnswer(
            0.0, 0.0, Refusal.NOT_ACTIVE, 'the gateway is shutting down'), self._now().clock_ns))
        self._status_publisher.wait_for_all_acked(LAST_WORDS_TIME)

    def entry(self, node_name: str, hardware: str) -> DiagnosticStatus:
        """Return the DiagnosticStatus `NODE: heater command`."""
        answer = self._answer
        level = LEVELS.get(answer.refusal)
        sentences = [f'{answer.refusal.name}: {answer.sentence}'] if answer.sentence else []
        errors, warnings = (sentences, []) if level == DiagnosticStatus.ERROR else ([], sentences if level else [])
        measured_w = self._measured_w
        return bus_entry(
            node_name, 'heater command', hardware, [*errors, *([self._unsent] if self._unsent else [])], warnings,
            f'{answer.active_w:g} W',
            {'requested power [W]': f'{answer.requested_w:g}', 'active power [W]': f'{answer.active_w:g}',
             'measured power [W]': 'not measured' if measured_w is None else f'{measured_w:g}',
             'frames': str(self._sent)})
