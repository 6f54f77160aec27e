# SPDX-License-Identifier: Apache-2.0
"""Asks planners: ~/enable, ~/skip_departure and ~/prepare_battery, from another thread than the executor's."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import Future
from queue import SimpleQueue
import time
from typing import Any, NamedTuple

from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import SetBool

from bev_preheat.control.preparation_goal import PreparationEnding
from bev_preheat.monitoring.planner_client import Wanted
from bev_preheat.monitoring.source import Answer, Asked, CANCEL, DISABLE, ENABLE, PREPARE, SKIP
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.action import PrepareBattery

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
        wanted = Wanted(None if asked.minutes is None else 60.0 * asked.minutes, asked.target_c,
                        is_plugged_in=asked.is_plugged_in)
        reports: list[str] = []

        def on_feedback(message: Any) -> None:
            reports[:] = [str(message.feedback.explanation)]

        sent = client.send_goal_async(wanted.goal(round((at_s or 0.0) * NS_PER_S)), on_feedback)
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
