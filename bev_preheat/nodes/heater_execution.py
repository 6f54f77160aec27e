# SPDX-License-Identifier: Apache-2.0
"""Executes commands to a heat source by the rules of `vehicle.heater_controller`, and answers with its status."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
import math
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile

from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.live_map import load_live_map
from bev_preheat.bus.source import steady_s
from bev_preheat.control.heater import SOURCE_STATUS
from bev_preheat.errors import InvalidInput, LONGEST_PROBLEM, shortened
from bev_preheat.messages.diagnostics import entry, ERROR, judged, OK, WARN
from bev_preheat.messages.heater import heater_command, status_message
from bev_preheat.nodes.process import LAST_WORDS_TIME
from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.description import HVCH
from bev_preheat.vehicle.heater_controller import (
    HeaterAnswer,
    HeaterController,
    HeaterLimits,
    Instant,
    Refusal,
    SERVED,
    Verdict,
)
from bev_preheat_msgs.msg import HeatSourceCommand, HeatSourceStatus, HvchCommand, HvchStatus

# Sets the heater's power [W]; returns the measured power [W], None if it is not measured.
Output = Callable[[float], float | None]

# The status is published so often, and at each change [s].
STATUS_PERIOD_S = 0.5
# Others are OK: the heater follows the command within its limits.
LEVELS = {
    **dict.fromkeys((Refusal.NO_COMMAND, Refusal.LOW_CHARGE, Refusal.HOT_BATTERY, Refusal.IN_MOTION,
                     Refusal.OTHER), WARN),
    **dict.fromkeys((Refusal.INVALID_COMMAND, Refusal.INVALID_LEASE, Refusal.COMMAND_CONFLICT,
                     Refusal.HEATER_FAULT), ERROR),
}
# The oldest sender is forgotten beyond this number.
MOST_SENDERS = 16
# Two planners answer the same battery state at nearly the same instant, and with depth 1 the later command would
# hide the earlier one, and with it the conflict.
HEARD_DEPTH = 20
# Frames of 0 W in the end.
LAST_FRAMES = 3


class CommandSenders:
    """
    Numbers the senders by the sequence numbers of their publications, which rise by publisher.

    rclpy does not say who sent a message, and a killed publisher stays in the graph for some 20 s, so the graph
    alone cannot distinguish two commanders from a restarted one.
    """

    def __init__(self) -> None:
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


def instant_of(node: Node) -> Instant:
    """Return the Instant of now, by a node's clock."""
    return Instant(node.get_clock().now().nanoseconds, time.monotonic_ns())


class HeaterExecution:
    """A HeaterController between the topics and an output; call `apply` periodically."""

    def __init__(self, node: Node, limits: HeaterLimits, output: Output, obstacle: Callable[[Instant], Verdict],
                 tell: Callable[[str, bool], object], deadline_s: float | None = None, name: str = HVCH) -> None:
        """
        Start with the heat source of a name off.

        `obstacle(now)` is the Verdict of the car's own conditions; `tell(sentence, is_refused)` logs; `deadline_s`
        [s] is requested of the publisher, None: nothing.
        """
        self._node, self._output, self._obstacle, self._log = node, output, obstacle, tell
        self._controller, self._senders = HeaterController(limits), CommandSenders()
        # As logged: a heater starts without a command.
        self._refusal, self._refused_as = Refusal.NO_COMMAND, ''
        self.answer = HeaterAnswer(0.0, 0.0, Refusal.NO_COMMAND, 'no command has arrived yet')
        self._measured_w: float | None = None
        # The latest refusal and requested power [W] that were published, and when [s].
        self._told, self._told_at_s = (Refusal.NO_COMMAND, 0.0), -math.inf
        self._name = name
        self.topics = ('hvch_command', 'hvch_status') if name == HVCH else ('heat_source_command', SOURCE_STATUS)
        command_type, status_type = (HvchCommand, HvchStatus) if name == HVCH else (
            HeatSourceCommand, HeatSourceStatus)
        self._status_publisher = node.create_publisher(status_type, self.topics[1], 1)
        qos, events = QoSProfile(depth=HEARD_DEPTH), SubscriptionEventCallbacks()
        if deadline_s is not None:
            within = Duration(seconds=deadline_s)
            qos = QoSProfile(depth=HEARD_DEPTH, deadline=within, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                             liveliness_lease_duration=within)
            events = SubscriptionEventCallbacks(
                deadline=lambda event: self._lose_sender('the command missed its deadline'),
                liveliness=self._on_liveliness)
        node.create_subscription(command_type, self.topics[0], self._on_command, qos, event_callbacks=events)

    def _on_command(self, message: HvchCommand | HeatSourceCommand, info: Mapping[str, int]) -> None:
        sender = self._senders.sender(info.get('publication_sequence_number'))
        if getattr(message, 'name', HVCH) != self._name:
            return
        self._controller.take(heater_command(message, sender), instant_of(self._node))
        self.apply()

    def _on_liveliness(self, event: object) -> None:
        if getattr(event, 'alive_count', 0) == 0:
            self._lose_sender(f'no node that publishes {self.topics[0]} is alive')

    def _lose_sender(self, sentence: str) -> None:
        self._controller.lose_sender(sentence)
        self.apply()

    def apply(self) -> None:
        """Set the power of now, and publish the status at a change, and every STATUS_PERIOD_S."""
        now, self._measured_w = instant_of(self._node), None
        answer = HeaterAnswer(0.0, 0.0, Refusal.OTHER)
        try:
            answer = self._controller.step(now, obstacle=self._obstacle(now))
            self._measured_w = self._output(answer.active_w)
        except Exception as error:
            answer = answer._replace(active_w=0.0, refusal=Refusal.HEATER_FAULT, sentence=shortened(
                f'{type(error).__name__}: {error}', LONGEST_PROBLEM))
            self._switch_off()
        self.answer = answer
        now_s, news = now.steady_ns / NS_PER_S, (answer.refusal, answer.requested_w)
        if news == self._told and now_s - self._told_at_s < STATUS_PERIOD_S:
            return
        self._log_refusal(answer)
        self._told, self._told_at_s = news, now_s
        self._status_publisher.publish(status_message(answer, now.clock_ns, self._measured_w, self._name))

    def _log_refusal(self, answer: HeaterAnswer) -> None:
        """Log that a refusal has begun or ended."""
        if answer.refusal is self._refusal:
            return
        before, is_refused = self._refused_as, answer.refusal in LEVELS
        self._refusal, self._refused_as = answer.refusal, answer.refusal.name if is_refused else ''
        if is_refused or before:
            now = f'{answer.refusal.name}: {answer.sentence}' if is_refused else 'the command is served'
            self._log(f'{before} is over; {now}' if before else now, is_refused)

    def _switch_off(self) -> None:
        try:
            self._output(0.0)
        except Exception as error:
            self._log(f'the heater cannot be switched off: {type(error).__name__}: {error}', True)

    def end(self, sentence: str) -> None:
        """Switch the heater off before the process ends, and say so."""
        self._switch_off()
        self._status_publisher.publish(status_message(
            HeaterAnswer(0.0, 0.0, Refusal.NOT_ACTIVE, sentence), instant_of(self._node).clock_ns,
            name=self._name))
        self._status_publisher.wait_for_all_acked(LAST_WORDS_TIME)

    def entry(self, part: str) -> DiagnosticStatus:
        """Return the entry of the diagnostics on the command, by its name there."""
        answer, measured_w = self.answer, self._measured_w
        return entry(
            part, LEVELS.get(answer.refusal, OK),
            f'{answer.refusal.name}: {answer.sentence}' if answer.sentence else 'the command is served',
            {'requested power [W]': f'{answer.requested_w:.1f}', 'active power [W]': f'{answer.active_w:.1f}',
             'measured power [W]': 'not measured' if measured_w is None else f'{measured_w:g}'})


class CanHeater:
    """
    The output of a heater whose frame a CanSource sends; call it at least every `period_s` [s].

    Frames end with the calls, and the heater's own timeout applies then: no thread goes on for a controller that
    hangs.
    """

    def __init__(self, source: CanSource, name: str) -> None:
        self._source, self._name = source, name
        self.period_s, self.maximum_w = source.frames[name].period_s, source.frames[name].highest_w
        self._next_s, self._sent, self._unsent = -1.0, 0, ''

    @property
    def bus_problem(self) -> str:
        """A sentence if the bus does not work, else ''."""
        return f'{self._source.name}: {self._source.problem}' if self._source.problem else ''

    def obstacle(self, now: Instant) -> Verdict:
        """Return the Verdict of bus and heater."""
        fault = self._source.heaters_problem(self._name) or self._source.heater_status(self._name)[1]
        return Verdict(Refusal.HEATER_FAULT, fault) if fault else SERVED

    def __call__(self, power_w: float) -> float | None:
        """Send the power [W] if the next frame is due; return the measured one [W], None if it is not known."""
        now_s = time.monotonic()
        # A timer's jitter must neither skip a frame nor send two.
        if now_s >= self._next_s - 0.5 * self.period_s:
            self._next_s = now_s + self.period_s
            self._unsent = self._source.send_power(power_w, self._name)
            self._sent += not self._unsent
            if self._unsent and power_w > 0.0:
                raise ConnectionError(self._unsent)
        return self._source.heater_status(self._name)[0]

    def end(self) -> None:
        """Send 0 W a few times."""
        for _ in range(LAST_FRAMES):
            self._source.send_power(0.0, self._name)

    def close(self) -> None:
        """Close the bus."""
        self._source.close()

    def entry(self) -> DiagnosticStatus:
        """Return the entry `bus` of the diagnostics."""
        return judged('bus', [self.bus_problem or self._unsent], self._source.doubts().values(),
                      f'{self._source.name}: works',
                      {**self._source.figures(), 'sent frames': str(self._sent)})


def open_can_heater(name_or_file: str, maximum_power_w: float, name: str = HVCH) -> CanHeater:
    """Open the bus of a signal map for a heat source; raises InvalidInput if no frame carries its power."""
    live_map = load_live_map(name_or_file)
    key = 'live.heater_command' if name == HVCH else f'live.heat_sources.{name}.command'
    where = f'{live_map.signals.path}: {key}'
    if not live_map.can or name not in live_map.heaters:
        raise InvalidInput(f"{where}: is missing; it names the frame with the heater's power")
    source = CanSource(live_map, steady_s, {name: maximum_power_w})
    heater = CanHeater(source, name)
    if heater.maximum_w < maximum_power_w:
        raise InvalidInput(f'{where}: carries at most {heater.maximum_w:g} W; the maximum_power_w of {name} in '
                           f'the vehicle file is {maximum_power_w:g} W')
    source.start()
    return heater
