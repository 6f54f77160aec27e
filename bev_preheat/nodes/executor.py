# SPDX-License-Identifier: Apache-2.0
"""
An executor with little to do between a message and its callback.

rclpy's own builds its wait set anew before each wait, two or three times a callback, looks at all that
may be ready before it takes a message, and runs each callback as a coroutine. A node that plans has some
forty parts to wait for, so that this takes longer than a plan.
"""

from __future__ import annotations

from contextlib import ExitStack
from itertools import chain
import threading
from typing import TYPE_CHECKING

from rclpy.exceptions import InvalidHandle
from rclpy.executors import (
    ConditionReachedException,
    ExternalShutdownException,
    ShutdownException,
    SingleThreadedExecutor,
    TimeoutException,
)
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription
from rclpy.waitable import NumberOfEntities

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import Any

    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.timer import Timer

# What a wait set says is ready, beyond messages and timers.
OTHERS = ('guard_condition', 'client', 'service')
FOREVER_NS = -1


class PromptExecutor(SingleThreadedExecutor):
    """
    Runs callbacks in the thread that calls `run`, those of messages first.

    What is waited for is listed once, and again when something is created or destroyed. Messages and
    timers are served here; all else that is ready, and tasks, get a turn of rclpy's own executor. All
    that is ready gets its turn before the next wait, so that no stream of messages keeps a timer waiting.
    Callbacks of subscriptions and timers must be functions, not coroutines.
    """

    def __init__(self, *, context: Context | None = None) -> None:
        """Take the context, None for the default one."""
        self._is_listed = False
        # Keeps what is waited for from being destroyed meanwhile.
        self._held = ExitStack()
        self._thread: int | None = None
        super().__init__(context=context)

    def wake(self) -> None:
        """Let the wait end: something was created or destroyed, or the process is to end."""
        self._is_listed = False
        if threading.get_ident() == self._thread:
            # What a callback destroys goes at once: the middleware lets go of a topic's buffers only
            # when the last of its subscriptions goes, and the callback may be about to make another.
            self._held.close()
        super().wake()

    def add_node(self, node: Node) -> bool:
        """Serve a node; return whether it is new."""
        is_new = bool(super().add_node(node))
        self.wake()
        return is_new

    def remove_node(self, node: Node) -> None:
        """Serve a node no more."""
        super().remove_node(node)
        self.wake()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Execute no more callbacks."""
        self._is_listed = False
        self._held.close()
        return bool(super().shutdown(timeout_sec))

    def run(self, is_done: Callable[[], bool]) -> None:
        """
        Execute callbacks until `is_done()`, which is asked after each wait; `wake` ends a wait.

        Raises what a callback raises, and ExternalShutdownException where the context was shut down.
        """
        self._thread = threading.get_ident()
        while self._context.ok() and not is_done():
            if not self._is_listed:
                self._list()
            self._wait_set.clear_entities()
            for add, part in self._additions:
                add(part)
            self._wait_set.wait(FOREVER_NS)
            if not self._context.ok():
                raise ExternalShutdownException
            self._serve(is_done)

    def _list(self) -> None:
        """List what there is to wait for."""
        # First: what is created or destroyed from here on is for the next list.
        self._is_listed = True
        held, nodes = ExitStack(), self.get_nodes()
        try:
            held.enter_context(self._context.handle)
            subscriptions = _present(held, chain(*(node.subscriptions for node in nodes)))
            timers = _present(held, chain(*(node.timers for node in nodes)))
            clients = _present(held, chain(*(node.clients for node in nodes)))
            services = _present(held, chain(*(node.services for node in nodes)))
            guards = _present(held, [
                *chain(*(node.guards for node in nodes)), self._guard, self._sigint_gc])
            self._waitables = [waitable for waitable in chain(*(node.waitables for node in nodes))
                               if _is_held(held, waitable)]
            count = NumberOfEntities(
                len(subscriptions), len(guards), len(timers), len(clients), len(services))
            for waitable in self._waitables:
                count += waitable.get_num_entities()
            self._wait_set = wait_set = rclpy_implementation.WaitSet(
                count.num_subscriptions, count.num_guard_conditions, count.num_timers,
                count.num_clients, count.num_services, count.num_events, self._context.handle)
        except BaseException:
            held.close()
            raise
        self._held.close()
        self._held = held
        self._subscriptions = {part.handle.pointer: part for part in subscriptions}
        self._timers = {part.handle.pointer: part for part in timers}
        self._additions: list[tuple[Callable[[Any], object], Any]] = [
            *((wait_set.add_subscription, part.handle) for part in subscriptions),
            *((wait_set.add_timer, part.handle) for part in timers),
            *((wait_set.add_client, part.handle) for part in clients),
            *((wait_set.add_service, part.handle) for part in services),
            *((wait_set.add_guard_condition, part.handle) for part in guards),
            *((part.add_to_wait_set, wait_set) for part in self._waitables)]

    def _serve(self, is_done: Callable[[], bool]) -> None:
        """Run the callbacks of all that is ready."""
        wait_set = self._wait_set
        for pointer in wait_set.get_ready_entities('subscription'):
            # One that is unknown belongs to a waitable.
            if pointer in self._subscriptions:
                _hear(self._subscriptions[pointer])
        for pointer in wait_set.get_ready_entities('timer'):
            if pointer in self._timers:
                _tick(self._timers[pointer])
        # `all` would stop at the first, and some of them note here what is ready.
        if any([*map(wait_set.get_ready_entities, OTHERS),
                *(waitable.is_ready(wait_set) for waitable in self._waitables)]):
            self._serve_others(is_done)

    def _serve_others(self, is_done: Callable[[], bool]) -> None:
        """Let rclpy's own executor take turns until there is nothing left to do."""
        # What a turn has run may have made tasks, of which the guard condition tells only once.
        while self._take_turn(is_done):
            pass

    def _take_turn(self, is_done: Callable[[], bool]) -> bool:
        """Let rclpy's own executor run what is ready now; return whether anything was."""
        has_run = False
        while True:
            try:
                task, _, _ = self.wait_for_ready_callbacks(timeout_sec=0.0, condition=is_done)
            except TimeoutException:
                return has_run
            except (ConditionReachedException, ShutdownException):
                return False
            task()
            # Raises what the callback raised.
            task.result()
            has_run = has_run or task.done()


def _is_held(held: ExitStack, part: Any) -> bool:
    """Return whether a part was there to be held."""
    try:
        held.enter_context(part)
    except InvalidHandle:
        return False
    return True


def _present(held: ExitStack, parts: Iterable[Any]) -> list[Any]:
    """Hold the handles of parts; return those that are there."""
    return [part for part in parts if _is_held(held, part.handle)]


def _hear(subscription: Subscription) -> None:
    """Take a message and run its callback."""
    try:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
    except InvalidHandle:
        # The callback before has destroyed it.
        return
    if taken is None:
        return
    # rclpy has no public name for whether a callback takes the message's information, too.
    if subscription._callback_type is Subscription.CallbackType.MessageOnly:
        subscription.callback(taken[0])
    else:
        subscription.callback(*taken)


def _tick(timer: Timer) -> None:
    """Run the callback of a timer that has run out."""
    try:
        with timer.handle:
            # A message may have reset it.
            if not timer.handle.is_timer_ready():
                return
            timer.handle.call_timer()
    except InvalidHandle:
        return
    timer.callback()
