# SPDX-License-Identifier: Apache-2.0
"""
Asks running planners: their action ~/prepare_battery, and their services ~/skip_departure and ~/enable.

For a terminal in the caller's thread; for the page (`Controls`) from another thread than the executor's.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future
from dataclasses import replace
import math
from queue import SimpleQueue
import time
from typing import Any, NamedTuple

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import SetBool

from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.messages.prepare_battery import goal_message
from bev_preheat.monitoring.source import Answer, Asked, CANCEL, DISABLE, ENABLE, PREPARE, SKIP
from bev_preheat.nodes.listening import Listener
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.status import Status
from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand

# A planner is found, and answers, within this time [s]; it cancels within a second.
FOUND_WITHIN_S = 10.0
# After this time [s] the answer to a goal counts as lost.
ANSWERED_WITHIN_S = 3.0
CANCELLED_WITHIN_S = 5.0
# Feedback comes every command_period, at most 10 s; after this silence [s] the planner has gone.
PLANNER_GONE_S = 30.0
SPIN_PERIOD_S = 0.1
NOT_THERE = 'no planner answers as {}: is it running, in this ROS domain and under this name?'


def goal_ahead(goal: PreparationGoal, ready_in_s: float | None, now_ns: int) -> PrepareBattery.Goal:
    """Return a goal for `ready_in_s` [s] after an instant of the planner's clock [ns]; None: at once."""
    return goal_message(goal if ready_in_s is None else replace(
        goal, ready_at_ns=now_ns + round(ready_in_s * NS_PER_S)))


class PreparationClient:
    """Sends one goal to a planner by its full name and follows it, in the caller's thread, until `is_over`."""

    def __init__(self, listener: Listener, planner: str, is_over: Callable[[], bool]) -> None:
        """Connect to the planner's action and command topic."""
        self._listener, self._planner, self._is_over = listener, planner, is_over
        self._client = ActionClient(listener.node, PrepareBattery, f'{planner}/prepare_battery')
        self._now_ns: int | None = None
        self._goal_handle: Any = None
        self._result: Any = None
        self._feedback: PrepareBattery.Feedback | None = None
        self._heard_s = time.monotonic()
        listener.node.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)

    def send(self, goal: PreparationGoal, ready_in_s: float | None) -> bool:
        """Send a `goal_ahead`; return False after a signal; raises InvalidInput if no planner answers."""
        # The planner's clock may be simulated; its commands give the time.
        if not _wait(self._listener, lambda: self._now_ns is not None and self._client.server_is_ready(),
                     FOUND_WITHIN_S, self._is_over):
            if self._is_over():
                return False
            raise InvalidInput(NOT_THERE.format(self._planner))
        sent, sent_s = self._send(goal, ready_in_s), time.monotonic()
        # Wait even after a signal, because a goal without a handle cannot be cancelled.
        end_s = sent_s + FOUND_WITHIN_S
        while not sent.done() and time.monotonic() < end_s:
            if time.monotonic() - sent_s > ANSWERED_WITHIN_S:
                # The answer of a planner that has not discovered this client yet is lost. A goal sent
                # again replaces the previous one.
                sent, sent_s = self._send(goal, ready_in_s), time.monotonic()
            self._listener.listen(SPIN_PERIOD_S)
        if not sent.done():
            raise InvalidInput(f'{self._planner} has not answered whether it accepts the goal, and may heat for '
                               'it; call its ~/enable with false to be sure')
        if not sent.result().accepted:
            raise InvalidInput(f'{self._planner} rejects the goal')
        self._goal_handle, self._heard_s = sent.result(), time.monotonic()
        self._result = self._goal_handle.get_result_async()
        return True

    def _send(self, goal: PreparationGoal, ready_in_s: float | None) -> Any:
        assert self._now_ns is not None
        return self._client.send_goal_async(goal_ahead(goal, ready_in_s, self._now_ns), self._on_feedback)

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


# Steps of a conversation with a planner; the result is its Answer.
Conversation = Generator[None, None, Answer]

# A planner that is there is found, and answers, within this time [s].
PRESENT_WITHIN_S, REPLY_WITHIN_S = 4.0, 4.0
# The first report on an accepted goal comes with the next command.
REPORTED_WITHIN_S = 2.5
STEP_PERIOD_S = 0.05
NOT_FOUND = 'The planner was not found: nothing was asked.'
NO_REPLY = (f'The planner has not answered within {REPLY_WITHIN_S:g} s; whether it does so is not known: look at '
            'its status.')


class _Unanswered(Exception):
    """The planner was not found, or has not answered; the text is a sentence."""


class _Clients(NamedTuple):
    enable: Any
    skip: Any
    prepare: ActionClient
    cancel: Any


class Controls:
    """
    Conversations with planners, by the full name of their nodes.

    `ask` may be called by any thread; all else happens in the executor's. `on_outcome(planner, text)` is called
    when a goal that was sent here ends later.
    """

    def __init__(self, node: Node, on_outcome: Callable[[str, str], object]) -> None:
        self._node, self._on_outcome = node, on_outcome
        self._asked: SimpleQueue[tuple[str, Asked, float | None, Future[Answer]]] = SimpleQueue()
        self._talks: list[tuple[Conversation, Future[Answer]]] = []
        self._clients: dict[str, _Clients] = {}
        self._guard = node.create_guard_condition(self._on_guard)
        self._timer = node.create_timer(STEP_PERIOD_S, self._on_timer,
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._timer.cancel()

    def connect(self, planner: str) -> None:
        """Make the clients for a planner, so that they are matched when they are needed."""
        if planner not in self._clients:
            node = self._node
            self._clients[planner] = _Clients(
                node.create_client(SetBool, f'{planner}/enable'),
                node.create_client(SetBool, f'{planner}/skip_departure'),
                ActionClient(node, PrepareBattery, f'{planner}/prepare_battery'),
                # A goal of another client is cancelled too.
                node.create_client(CancelGoal, f'{planner}/prepare_battery/_action/cancel_goal'))

    def disconnect(self, planner: str) -> None:
        """Destroy the clients for a planner."""
        clients = self._clients.pop(planner, None)
        if clients is not None:
            clients.prepare.destroy()
            for client in (clients.enable, clients.skip, clients.cancel):
                self._node.destroy_client(client)

    def ask(self, planner: str, asked: Asked, at_s: float | None) -> Future[Answer]:
        """Ask a planner at an instant of its clock [s], None: unknown; the Future has its Answer."""
        answer: Future[Answer] = Future()
        self._asked.put((planner, asked, at_s, answer))
        self._guard.trigger()
        return answer

    def _on_guard(self) -> None:
        while not self._asked.empty():
            planner, asked, at_s, answer = self._asked.get()
            self._talks.append((self._talk(planner, asked, at_s), answer))
        if self._talks:
            self._timer.reset()

    def _on_timer(self) -> None:
        for talk, answer in list(self._talks):
            try:
                next(talk)
                continue
            except StopIteration as end:
                result = end.value
            except _Unanswered as error:
                result = Answer(False, str(error))
            except Exception as error:
                result = Answer(False, f'The request failed: {type(error).__name__}: {error}')
            self._talks.remove((talk, answer))
            if not answer.cancelled():
                answer.set_result(result)
        if not self._talks:
            self._timer.cancel()

    def _talk(self, planner: str, asked: Asked, at_s: float | None) -> Conversation:
        self.connect(planner)
        clients = self._clients[planner]
        if asked.kind == PREPARE:
            return (yield from self._prepare(planner, clients.prepare, asked, at_s))
        if asked.kind == CANCEL:
            # A request without identification and stamp cancels all goals.
            count = len((yield from _called(clients.cancel, CancelGoal.Request())).goals_canceling)
            return Answer(count > 0, 'The preparation is cancelled.' if count else
                          'There is no preparation to cancel.')
        client, value = (clients.enable, asked.kind == ENABLE) if asked.kind in (ENABLE, DISABLE) else (
            clients.skip, asked.kind == SKIP)
        # Sent once: a second request would skip another departure.
        response = yield from _called(client, SetBool.Request(data=value))
        return Answer(bool(response.success),
                      str(response.message) or ('Done.' if response.success else 'Refused.'))

    def _prepare(self, planner: str, client: ActionClient, asked: Asked, at_s: float | None) -> Conversation:
        if at_s is None and asked.minutes is not None:
            return Answer(False, "The planner's time is not known yet: nothing was asked.")
        if not (yield from _until(client.server_is_ready, PRESENT_WITHIN_S)):
            raise _Unanswered(NOT_FOUND)
        goal = goal_ahead(PreparationGoal(target_c=asked.target_c, is_plugged_in=asked.is_plugged_in), None if (
            asked.minutes is None) else 60.0 * asked.minutes, round((at_s or 0.0) * NS_PER_S))
        reports: list[str] = []

        def on_feedback(message: Any) -> None:
            reports[:] = [str(message.feedback.explanation)]

        sent = client.send_goal_async(goal, on_feedback)
        if not (yield from _until(sent.done, REPLY_WITHIN_S)):
            raise _Unanswered(NO_REPLY)
        handle = sent.result()
        if not handle.accepted:
            return Answer(False, 'The planner rejects the goal.')
        ended = handle.get_result_async()
        yield from _until(lambda: ended.done() or bool(reports), REPORTED_WITHIN_S)
        if ended.done():
            # A refused goal is accepted by the action and ends at once, with the reason.
            result = ended.result().result
            return Answer(result.code == PreparationEnding.REACHED, str(result.explanation))
        ended.add_done_callback(lambda future: self._on_end(planner, future))
        return Answer(True, reports[0] if reports else 'The planner has accepted the goal.')

    def _on_end(self, planner: str, ended: Any) -> None:
        if not ended.cancelled() and ended.exception() is None:
            self._on_outcome(planner, str(ended.result().result.explanation))


def _called(client: Any, request: Any) -> Generator[None, None, Any]:
    """Return the response of a service."""
    if not (yield from _until(client.service_is_ready, PRESENT_WITHIN_S)):
        raise _Unanswered(NOT_FOUND)
    answered = client.call_async(request)
    if not (yield from _until(answered.done, REPLY_WITHIN_S)):
        client.remove_pending_request(answered)
        raise _Unanswered(NO_REPLY)
    return answered.result()


def _until(condition: Callable[[], bool], patience_s: float) -> Generator[None, None, bool]:
    """Yield until a condition holds; return False after `patience_s` [s]."""
    end_s = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > end_s:
            return False
        yield
    return True
