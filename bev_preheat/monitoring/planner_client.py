# SPDX-License-Identifier: Apache-2.0
"""Asks a running planner for a terminal: its action ~/prepare_battery and its service ~/skip_departure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
import time
from typing import Any

from rclpy.action import ActionClient
from std_srvs.srv import SetBool

from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import highest_given, nanoseconds, time_message
from bev_preheat.nodes.listening import Listener
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand

# An rclpy future, None before the request: rclpy's have no types.
Future = Any

# A planner is found, and answers, within this time [s]; it cancels within a second.
FOUND_WITHIN_S = 10.0
# After this time [s] the answer to a goal counts as lost.
ANSWERED_WITHIN_S = 3.0
CANCELLED_WITHIN_S = 5.0
# Feedback comes every command_period, at most 10 s; after this silence [s] the planner has gone.
PLANNER_GONE_S = 30.0
SPIN_PERIOD_S = 0.1
NOT_THERE = 'no planner answers as {}: is it running, in this ROS domain and under this name?'


@dataclass(frozen=True)
class Wanted:
    """
    A goal in a user's terms: `ready_in_s` [s] from now, None: as soon as possible; degC or None.

    The battery is then to have at most `most_c` [deg C]; None: it may be warmer.
    """

    ready_in_s: float | None = None
    target_c: float | None = None
    ambient_c: float | None = None
    is_plugged_in: bool = False
    most_c: float | None = None

    def goal(self, now_ns: int) -> PrepareBattery.Goal:
        """Return the goal at an instant of the planner's clock [ns]."""
        goal = PrepareBattery.Goal(plugged_in=self.is_plugged_in, maximum_arrival_temperature=highest_given(
            math.inf if self.most_c is None else self.most_c))
        if self.ready_in_s is not None:
            goal.ready_at = time_message(now_ns + round(self.ready_in_s * NS_PER_S))
        for name, value in (('target_battery_temperature', self.target_c),
                            ('ambient_temperature', self.ambient_c)):
            setattr(goal, f'has_{name}', value is not None)
            setattr(goal, name, value or 0.0)
        return goal


class PreparationClient:
    """Sends one goal to a planner by its full name and follows it, in the caller's thread, until `is_over`."""

    def __init__(self, listener: Listener, planner: str, is_over: Callable[[], bool]) -> None:
        """Connect to the planner's action and command topic."""
        self._listener, self._planner, self._is_over = listener, planner, is_over
        self._client = ActionClient(listener.node, PrepareBattery, f'{planner}/prepare_battery')
        self._now_ns: int | None = None
        self._goal_handle: Any = None
        self._result: Future = None
        self._feedback: PrepareBattery.Feedback | None = None
        self._heard_s = time.monotonic()
        listener.node.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)

    def send(self, wanted: Wanted) -> bool:
        """Send the goal; return False after a signal; raises InvalidInput if no planner answers."""
        # The planner's clock may be simulated; its commands give the time.
        if not _wait(self._listener, lambda: self._now_ns is not None and self._client.server_is_ready(),
                     FOUND_WITHIN_S, self._is_over):
            if self._is_over():
                return False
            raise InvalidInput(NOT_THERE.format(self._planner))
        sent, sent_s = self._send(wanted), time.monotonic()
        # Wait even after a signal, because a goal without a handle cannot be cancelled.
        end_s = sent_s + FOUND_WITHIN_S
        while not sent.done() and time.monotonic() < end_s:
            if time.monotonic() - sent_s > ANSWERED_WITHIN_S:
                # The answer of a planner that has not discovered this client yet is lost. A goal sent
                # again replaces the previous one.
                sent, sent_s = self._send(wanted), time.monotonic()
            self._listener.listen(SPIN_PERIOD_S)
        if not sent.done():
            raise InvalidInput(f'{self._planner} has not answered whether it accepts the goal, and may heat for '
                               'it; call its ~/enable with false to be sure')
        if not sent.result().accepted:
            raise InvalidInput(f'{self._planner} rejects the goal')
        self._goal_handle, self._heard_s = sent.result(), time.monotonic()
        self._result = self._goal_handle.get_result_async()
        return True

    def _send(self, wanted: Wanted) -> Future:
        assert self._now_ns is not None
        return self._client.send_goal_async(wanted.goal(self._now_ns), self._on_feedback)

    def follow(self, show: Callable[[PrepareBattery.Feedback], object]) -> PrepareBattery.Result | None:
        """Show feedback until the goal ends; return its result, None after a signal; silence is InvalidInput."""
        while not self._result.done() and not self._is_over():
            self._listener.listen(SPIN_PERIOD_S)
            if self._feedback is not None:
                show(self._feedback)
            if time.monotonic() - self._heard_s > PLANNER_GONE_S:
                raise InvalidInput(f'{self._planner} has been silent for {PLANNER_GONE_S:g} s; a restarted '
                                   'planner has lost the goal')
        return self._result.result().result if self._result.done() else None

    def cancel(self) -> bool:
        """Cancel the goal; return whether the planner confirms that it has ended."""
        self._goal_handle.cancel_goal_async()
        return _wait(self._listener, self._result.done, CANCELLED_WITHIN_S)

    def _on_command(self, message: HvchCommand) -> None:
        self._now_ns, self._heard_s = nanoseconds(message.header.stamp), time.monotonic()

    def _on_feedback(self, message: Any) -> None:
        self._feedback, self._heard_s = message.feedback, time.monotonic()


def feedback_line(feedback: PrepareBattery.Feedback) -> str:
    """Return a feedback in one line."""
    try:
        status = Status(feedback.status).name
    except ValueError:
        status = f'status {feedback.status}'
    left = '-' if math.isnan(feedback.time_left) else duration_text(feedback.time_left)
    return (f'{status}: battery {_degrees(feedback.battery_temperature)}, in {left} '
            f'{_degrees(feedback.predicted_battery_temperature)}, heater '
            f'{feedback.battery_heating_power:.0f} W')


def _degrees(value: float) -> str:
    return f'{value:.1f} degC' if math.isfinite(value) else '-'


def skip_departure(listener: Listener, planner: str, is_skipped: bool) -> tuple[bool, str]:
    """Skip a planner's next departure, or unskip all; return its answer; raises InvalidInput if none comes."""
    client = listener.node.create_client(SetBool, f'{planner}/skip_departure')
    if not _wait(listener, client.service_is_ready, FOUND_WITHIN_S):
        raise InvalidInput(NOT_THERE.format(planner))
    # Sent once: a second request would skip another departure.
    answer = client.call_async(SetBool.Request(data=is_skipped))
    if not _wait(listener, answer.done, FOUND_WITHIN_S + ANSWERED_WITHIN_S):
        raise InvalidInput(
            f'{planner} has not answered; the page of dashboard shows whether the departure is skipped')
    response = answer.result()
    return bool(response.success), str(response.message)


def _wait(listener: Listener, condition: Callable[[], bool], patience_s: float,
          is_over: Callable[[], bool] = lambda: False) -> bool:
    """Listen until a condition holds; return whether it does, False after `patience_s` [s] or a signal."""
    end_s = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end_s or is_over():
            return False
        listener.listen(SPIN_PERIOD_S)
    return True
