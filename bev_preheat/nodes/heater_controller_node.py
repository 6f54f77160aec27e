# SPDX-License-Identifier: Apache-2.0
"""
`heater_controller`: executes `hvch_command` by the rules of `heater.controller`, and answers with `hvch_status`.

`main(output)` runs it with a car's own heater: `output(power_w)` sets the power [W] and returns the measured one
[W], or None. The executable writes the power to CAN by a signal map (`signals`); without one it has no heater
behind it and shows the rules only.
"""

from __future__ import annotations

import math
import sys
import time
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile

from bev_preheat.errors import LONGEST_PROBLEM, shortened
from bev_preheat.heater.controller import HeaterAnswer, HeaterController, HeaterLimits, Instant, Refusal, Verdict
from bev_preheat.nodes.can_heater import CanHeater
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.command_senders import CommandSenders, HEARD_DEPTH
from bev_preheat.nodes.gate_inputs import GateInputs
from bev_preheat.nodes.heater_messages import (
    heater_command,
    heater_diagnostics,
    RefusalNews,
    status_message,
    STATUS_PERIOD_S,
)
from bev_preheat.nodes.managed import LIFECYCLE, ManagedStates, NOT_ACTIVE
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import declare, Parameter
from bev_preheat.nodes.process import LAST_WORDS_TIME, run_node
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, SetupWatch
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, HvchStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    # Sets the heater's power [W]; returns the measured power [W], None if it is not measured.
    Output = Callable[[float], float | None]

PARAMETERS = (
    Parameter('vehicle', 'reference', "Vehicle, for the heater's maximum power and heating_gates: a name in "
              'config/vehicles or a YAML file.', read_only=True),
    Parameter('period', 0.1, 'The power is set this often', 's', (0.01, 1.0), read_only=True),
    Parameter('power_rise', 0.0, 'The power rises at most at this rate; it falls at once', 'W/s', (1.0, 1e6),
              unset_means='no limit', read_only=True),
    Parameter('longest_lease', 10.0, 'A command with a longer lease is refused', 's', (0.05, 60.0),
              read_only=True),
    Parameter('clock_tolerance', 1.0, 'A command may be stamped this far in the future', 's', (0.0, 10.0),
              read_only=True),
    Parameter('command_deadline', 2.5, 'Deadline and liveliness requested of the publisher, at least its '
              'command_lease', 's', (0.05, 60.0), unset_means='none requested', read_only=True),
    Parameter('battery_state_timeout', 5.0, 'heating_gates that look at the battery or the speed close if the '
              'latest value is older than this', 's', (0.1, 60.0), read_only=True),
    Parameter('signals', '', "Signal map with live.heater_command, the heater's frame on CAN: a name in "
              'config/signals or a YAML file. Empty: no heater.', read_only=True),
    LIFECYCLE,
)
PROGRAM = NodeProgram(
    'heater_controller', 'Executes the heater command within its lease and the limits, and reports the result.',
    PARAMETERS,
    subscribes=(('hvch_command', 'bev_preheat_msgs/HvchCommand'),
                ('battery_state', 'sensor_msgs/BatteryState, if heating_gates look at the battery'),
                ('vehicle_speed', 'std_msgs/Float64 [m/s], if the vehicle heats only while it stands')),
    publishes=(('hvch_status', 'bev_preheat_msgs/HvchStatus'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))


class HeaterControllerNode(Node):
    """Wires topics and a steady timer to a HeaterController and the heater's output."""

    def __init__(self, output: Output | None = None) -> None:
        """Start with the heater off; raises InvalidInput if a parameter is not allowed."""
        super().__init__('heater_controller')
        values = declare(self, PARAMETERS)
        self._vehicle = vehicle = load_vehicle(values['vehicle'])
        self._controller = HeaterController(HeaterLimits(
            vehicle.hvch.maximum_power_w, _or_none(values['power_rise']) or math.inf,
            vehicle.heating_gates.power_steps_w, values['longest_lease'], values['clock_tolerance']))
        self._can = CanHeater(values['signals'], vehicle.hvch.maximum_power_w) if values['signals'] else None
        self._output = output or self._can or _without_heater
        self._senders, self._news, self._bus_problem = CommandSenders(), RepetitionFilter(), ''
        self._refusal_news = RefusalNews()
        self._answer = HeaterAnswer(0.0, 0.0, Refusal.NO_COMMAND, 'no command has arrived yet')
        # The latest refusal and requested power [W] that were published, and when [s].
        self._told, self._told_at_s = (Refusal.NO_COMMAND, 0.0), -math.inf

        self._status_publisher = self.create_publisher(HvchStatus, 'hvch_status', 1)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._subscribe_to_commands(_or_none(values['command_deadline']))
        self._gate_inputs = GateInputs(self, vehicle.heating_gates, values['battery_state_timeout'], self._tell)
        # Not the node's clock: that may stand or be set.
        self._is_active = not values['lifecycle']
        self._managed: ManagedStates | None = None
        if values['lifecycle']:
            self._managed = ManagedStates(self, self._on_activation)
            self.finished = self._managed.finished
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(min([values['period'], *([] if self._can is None else [self._can.period_s])]),
                          self._on_period, clock=steady)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._publish_diagnostics, clock=steady)
        self._setup = SetupWatch(self, ('hvch_command', *self._gate_inputs.topics), ('hvch_status',),
                                 single=('hvch_command', 'hvch_status'))
        self.get_logger().info(f'Executing hvch_command for vehicle {vehicle.name}, up to '
                               f'{vehicle.hvch.maximum_power_w:g} W.')

    def _subscribe_to_commands(self, deadline_s: float | None) -> None:
        qos, events = QoSProfile(depth=HEARD_DEPTH), SubscriptionEventCallbacks()
        if deadline_s is not None:
            within = Duration(seconds=deadline_s)
            qos = QoSProfile(depth=HEARD_DEPTH, deadline=within, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                             liveliness_lease_duration=within)
            events = SubscriptionEventCallbacks(deadline=self._on_missed_deadline, liveliness=self._on_liveliness)
        self.create_subscription(HvchCommand, 'hvch_command', self._on_command, qos, event_callbacks=events)

    # Input

    def _now(self) -> Instant:
        return Instant(self.get_clock().now().nanoseconds, time.monotonic_ns())

    def _on_command(self, message: HvchCommand, info: Mapping[str, int]) -> None:
        sender = self._senders.sender(info.get('publication_sequence_number'))
        self._controller.take(heater_command(message, sender), self._now())
        self._apply()

    def _on_missed_deadline(self, event: object) -> None:
        self._controller.lose_sender('the command missed its deadline')
        self._apply()

    def _on_liveliness(self, event: object) -> None:
        if getattr(event, 'alive_count', 0) == 0:
            self._controller.lose_sender('no node that publishes hvch_command is alive')
            self._apply()

    def _on_activation(self, is_active: bool) -> None:
        self._is_active = is_active
        self._apply()

    # Output

    def _obstacle(self, now: Instant) -> Verdict:
        """Return the Verdict of the car's own conditions."""
        if not self._is_active:
            return Verdict(Refusal.NOT_ACTIVE, NOT_ACTIVE)
        fault = '' if self._can is None else self._can.fault()
        if fault:
            return Verdict(Refusal.HEATER_FAULT, fault)
        return self._gate_inputs.verdict(now)

    def _on_period(self) -> None:
        self._apply()

    def _apply(self) -> None:
        """Set the power of now, and publish the status if it is due."""
        now, measured_w = self._now(), None
        answer = HeaterAnswer(0.0, 0.0, Refusal.OTHER)
        try:
            answer = self._controller.step(now, obstacle=self._obstacle(now))
            measured_w = self._output(answer.active_w)
        except Exception as error:
            answer = answer._replace(active_w=0.0, refusal=Refusal.HEATER_FAULT, sentence=shortened(
                f'{type(error).__name__}: {error}', LONGEST_PROBLEM))
            self._switch_off()
        self._answer = answer
        now_s = now.steady_ns / NS_PER_S
        news = answer.refusal, answer.requested_w
        if news == self._told and now_s - self._told_at_s < STATUS_PERIOD_S:
            return
        is_refused, sentence = self._refusal_news.sentence(answer)
        if sentence:
            self._tell(sentence, is_refused)
        self._told, self._told_at_s = news, now_s
        self._status_publisher.publish(status_message(answer, now.clock_ns, measured_w))

    def _switch_off(self) -> None:
        try:
            self._output(0.0)
        except Exception as error:
            self._tell(f'the heater cannot be switched off: {type(error).__name__}: {error}')

    def _publish_diagnostics(self) -> None:
        name = self.get_fully_qualified_name()
        self._tell_bus()
        self._diagnostics_publisher.publish(heater_diagnostics(
            name, self._vehicle.name, self._answer, self._now().clock_ns, [
                self._setup.entry(self._vehicle.name), *([] if self._can is None else [self._can.entry(name)])]))

    def _tell_bus(self) -> None:
        """Log a new problem of the bus, also before the first command."""
        problem = '' if self._can is None else self._can.bus_problem
        if problem and not self._bus_problem:
            self._tell(problem)
        self._bus_problem = problem

    def _tell(self, sentence: str, is_refused: bool = True) -> None:
        if not self._news.has(sentence):
            return
        # One call for each severity: rclpy raises if a line of code logs with a second one.
        if is_refused:
            self.get_logger().warning(sentence)
        else:
            self.get_logger().info(sentence)

    def last_words(self) -> None:
        """Switch the heater off before the process ends, and say so."""
        self._switch_off()
        if self._can is not None:
            self._can.end()
        self._status_publisher.publish(status_message(HeaterAnswer(
            0.0, 0.0, Refusal.NOT_ACTIVE, 'the controller is shutting down'), self._now().clock_ns))
        self._status_publisher.wait_for_all_acked(LAST_WORDS_TIME)


def _or_none(value: float) -> float | None:
    """Return a parameter's value, None if it is unset (0 or NaN)."""
    return value if value > 0.0 else None


def _without_heater(power_w: float) -> None:
    """Stand for the heater in the executable."""


def main(output: Output | None = None) -> None:
    """Run the controller until a signal ends it; see the module on `output`."""
    sys.exit(run_node(lambda: HeaterControllerNode(output), PROGRAM))


if __name__ == '__main__':
    main()
