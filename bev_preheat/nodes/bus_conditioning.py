# SPDX-License-Identifier: Apache-2.0
"""Serves BatteryConditioning of VSS with the planner's action `prepare_battery`, and reports its state back."""

from __future__ import annotations

from collections.abc import Mapping
import math
from queue import SimpleQueue
from typing import Any

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from bev_preheat.bus.conditioning import (
    ConditioningGoal,
    ConditioningRequest,
    INACTIVE,
    IS_ACTIVE,
    IS_ONGOING,
    MODE,
)
from bev_preheat.bus.source import steady_s
from bev_preheat.bus.vss_source import VssSource
from bev_preheat.control.preparation_goal import PreparationGoal
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.messages.diagnostics import judged
from bev_preheat.messages.heater import heater_command
from bev_preheat.messages.prepare_battery import goal_message
from bev_preheat.nodes.heater_execution import instant_of
from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.heater_controller import HeaterController, HeaterLimits
from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand

GOAL_PERIOD_S = 0.1
# A refusal is shown in the diagnostics for this time [s].
REFUSAL_SHOWN_S = 60.0
# A planner that has just started knows no battery yet: a goal that it refuses within STARTING_S is sent again [s].
STARTING_S, GOAL_AGAIN_S = 5.0, 0.5
# A planner has lost the goal if it does not answer for this long, or for the longest lease of its commands:
# feedback comes more often than a lease lasts. The graph shows a killed planner for some 20 s [s].
ANSWER_S, MOST_SILENCE_S = 5.0, 60.0


class BusConditioning:
    """
    Turns requests into goals: one at a time, the latest counts.

    A goal that ends, for whatever reason but the planner's shutdown, sets RequestedMode back to INACTIVE. A
    planner that restarts gets the goal again.
    """

    def __init__(self, node: Node, planner: str, broker: VssSource, requests: SimpleQueue[Mapping[str, Any]],
                 longest_lease_s: float) -> None:
        """`planner` is the planner's name; `requests` are values requested of the actuators of the broker."""
        self._node, self._broker, self._requests = node, broker, requests
        self._request = ConditioningRequest()
        # It executes nothing; it reports whether the battery is being heated.
        self._heater = HeaterController(HeaterLimits(math.inf, longest_lease_s=longest_lease_s))
        try:
            node.resolve_topic_name(action := f'{planner}/prepare_battery')
        except RuntimeError as error:
            raise InvalidInput(f'planner: {quoted(planner)} is not allowed; it must be the name of a '
                               'node') from error
        self._client = ActionClient(node, PrepareBattery, action)
        self._wanted: ConditioningGoal | None = None
        self._sent: ConditioningGoal | None = None
        self._handle: Any = None
        self._told: dict[str, Any] = {}
        self._connections = 0
        # Since when planner and battery are there [s], None: they are not; and when a goal may be sent again [s].
        self._ready_since_s: float | None = None
        self._retry_at_s = 0.0
        # Each sent goal has a number of its own; until when its planner counts as alive [s].
        self._number = 0
        self._alive_until_s, self._silence_s = math.inf, ANSWER_S
        self._refusal, self._refused_s = '', -REFUSAL_SHOWN_S
        # Of the car, for the next goal: whether its battery is known and charged, and the air around it [deg C],
        # None: unknown.
        self.has_battery = self.is_plugged_in = False
        self.ambient_c: float | None = None
        node.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)
        node.create_timer(GOAL_PERIOD_S, self._on_look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # Requests

    def _on_look(self) -> None:
        while not self._requests.empty():
            self._take(self._requests.get())
        is_there = self._client.server_is_ready()
        if self._sent is not None and not (is_there and steady_s() < self._alive_until_s):
            # Its planner has gone; the next one gets the goal again.
            self._sent = self._handle = None
            self._ready_since_s = None
        if not (is_there and self.has_battery):
            self._ready_since_s = None
        elif self._ready_since_s is None:
            self._ready_since_s = steady_s()
        if self._wanted != self._sent:
            self._send()
        self._tell()

    def _take(self, values: Mapping[str, Any]) -> None:
        try:
            self._request = self._request.after(values)
        except (InvalidInput, TypeError, ValueError) as error:
            self._refuse(f'BatteryConditioning refused: {error}')
            # The cabin sees the values that count.
            self._told = {}
            return
        self._wanted = self._request.goal()

    def _refuse(self, sentence: str) -> None:
        self._refusal, self._refused_s = sentence, steady_s()
        self._node.get_logger().warning(sentence)

    # Goals

    def _send(self) -> None:
        if self._wanted is None:
            if self._handle is not None:
                self._handle.cancel_goal_async()
            self._sent = self._handle = None
            return
        if self._ready_since_s is None or steady_s() < self._retry_at_s:
            return
        goal = self._wanted
        self._sent, self._handle, self._alive_until_s = goal, None, steady_s() + self._silence_s
        self._number += 1
        message = goal_message(PreparationGoal(
            round(goal.ready_at_s * NS_PER_S), goal.target_c, self.is_plugged_in, self.ambient_c))
        number = self._number
        future = self._client.send_goal_async(message, lambda feedback: self._on_feedback(number))
        future.add_done_callback(lambda future: self._on_accepted(number, future))

    def _is_current(self, number: int) -> bool:
        """Return whether the goal sent with a number is still wanted."""
        return self._sent is not None and number == self._number

    def _on_accepted(self, number: int, future: Future) -> None:
        handle = future.result()
        if handle is None or not handle.accepted:
            if self._is_current(number):
                self._end('the planner has rejected the goal', True)
            return
        if not self._is_current(number):
            # Withdrawn before the planner answered; a later goal replaces this one by itself.
            if self._wanted is None:
                handle.cancel_goal_async()
            return
        self._handle, self._alive_until_s = handle, steady_s() + self._silence_s
        handle.get_result_async().add_done_callback(lambda future: self._on_result(number, future))

    def _on_feedback(self, number: int) -> None:
        if self._is_current(number):
            self._alive_until_s = steady_s() + self._silence_s

    def _on_result(self, number: int, future: Future) -> None:
        if not self._is_current(number):
            return
        answer = future.result()
        code = answer.result.code
        if code == PrepareBattery.Result.SHUTTING_DOWN or answer.status == GoalStatus.STATUS_UNKNOWN:
            self._sent = self._handle = None
            return
        is_starting = self._ready_since_s is None or steady_s() - self._ready_since_s < STARTING_S
        if code == PrepareBattery.Result.REFUSED and is_starting:
            self._sent, self._handle, self._retry_at_s = None, None, steady_s() + GOAL_AGAIN_S
            return
        self._end(answer.result.explanation,
                  code not in (PrepareBattery.Result.REACHED, PrepareBattery.Result.CANCELED))

    def _end(self, explanation: str, is_refusal: bool) -> None:
        if is_refusal:
            self._refuse(f'BatteryConditioning: {explanation}')
        else:
            self._node.get_logger().info(f'BatteryConditioning: {explanation}')
        self._request = self._request.after({MODE: INACTIVE})
        self._wanted = self._sent = self._handle = None

    # State

    def _on_command(self, message: HvchCommand) -> None:
        command = heater_command(message)
        self._heater.take(command, instant_of(self._node))
        lease_s = (command.valid_until_ns - command.stamp_ns) / NS_PER_S
        self._silence_s = min(max(self._silence_s, lease_s), MOST_SILENCE_S)

    @property
    def _is_heating(self) -> bool:
        return self._heater.step(instant_of(self._node)).active_w > 0.0

    def _tell(self) -> None:
        """Publish the state if it, or the connection, is new."""
        values = {**self._request.values(), IS_ACTIVE: self._handle is not None or self._is_heating,
                  IS_ONGOING: self._is_heating}
        connections = self._broker.connections
        if connections != self._connections:
            self._connections, self._told = connections, {}
        news = {path: value for path, value in values.items() if self._told.get(path) != value}
        if news:
            self._broker.publish(news)
            self._told.update(news)

    def end(self) -> None:
        """Publish that nothing is active any more."""
        self._broker.publish({IS_ACTIVE: False, IS_ONGOING: False})

    def entry(self) -> DiagnosticStatus:
        """Return the entry `conditioning` of the diagnostics."""
        refusal = self._refusal if steady_s() - self._refused_s < REFUSAL_SHOWN_S else ''
        waits = ''
        if self._wanted is not None and self._sent is None:
            waits = ('the request waits for the battery' if not self.has_battery else
                     'the planner does not answer: its action prepare_battery is not there'
                     if self._ready_since_s is None else 'the planner is starting')
        return judged('conditioning', [], [waits, refusal], self._request.mode,
                      {'mode': self._request.mode, 'active': str(self._handle is not None).lower(),
                       'heating': str(self._is_heating).lower()})
