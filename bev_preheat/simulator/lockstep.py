# SPDX-License-Identifier: Apache-2.0
"""
Lockstep of a simulated drive with the nodes around it: the clock goes on once they have handled every message.

A node is asked for parameters, which each node of rclpy and rclcpp answers unless that is switched off. In each
turn its executor looks at all topics, then at all services, and runs the callbacks of all that arrived: timers
first, then subscriptions, then one request of each service. A message that arrives after the look at its topic and
before the look at the service runs a turn after the request behind it, but before a second request. So after two
answers a message is handled, and timers that are due by a new `/clock` run before any message that is sent later.
A command with the stamp of a new `/clock` shows this without a request: it is from the turn of these timers.
All callbacks run in one order, however busy the computer is.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rcl_interfaces.srv import GetParameters
from rclpy.task import Future

from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.setup_watch import endpoint_name, NAMELESS

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Sequence

    from rclpy.client import Client
    from rclpy.node import Node

# A node answers a request for an unknown parameter with no value.
SIM_TIME = GetParameters.Request(names=['use_sim_time'])
COMMAND_PERIOD = GetParameters.Request(names=['command_period'])
# Longest simulated time between two clock messages [s], so that a planner soon notices missing battery states.
LONGEST_TICK_S = 1.0
# Listeners are waited for once in this many instants: fewer messages than their queues hold.
INSTANTS_BETWEEN_LISTENERS = 10
# Real time [s] between two looks for the nodes, and until a request of the start is repeated: a node that has not
# discovered its client yet sends no answer.
GRAPH_PERIOD_S, REPEAT_S = 0.05, 1.0


class NoAnswer(Exception):
    """A node did not answer, or not within the time limit; the text names it."""


class Lockstep:
    """
    The planner of a simulated drive and the other listeners to its battery states, which are waited for.

    The node's executor has to run `look` every GRAPH_PERIOD_S or so.
    """

    def __init__(self, node: Node, limit_s: float, topics: Iterable[str]) -> None:
        """
        Begin without nodes; no answer is waited for longer than `limit_s` [s of real time].

        `topics` are those that a planner must be connected to.
        """
        self._node, self._limit_s = node, limit_s
        self._topics = [node.resolve_topic_name(topic) for topic in topics]
        self._planner: Client | None = None
        self._listeners: list[Client] = []
        self._instants = 0
        # The error message if the wait takes too long, and its begin.
        self._awaited: tuple[str, float] | None = None
        self._next_look = Future()
        # Whether a command came for the latest /clock, once that is known.
        self._is_answered, self._is_overdue = Future(), False
        self.tick_s = LONGEST_TICK_S

    def look(self) -> None:
        """Go on looking for nodes; raises NoAnswer after the time limit."""
        look, self._next_look = self._next_look, Future()
        look.set_result(None)
        if not self._is_answered.done():
            if self._is_overdue:
                self._is_answered.set_result(False)
            self._is_overdue = True
        if self._awaited is not None:
            whom, since_s = self._awaited
            if time.monotonic() - since_s > self._limit_s:
                raise NoAnswer(f'{whom} within {self._limit_s:g} s of real time (lockstep_limit): it has ended, '
                               'it hangs, or this computer is too slow')

    async def meet(self, listeners: int, is_ready: Callable[[], bool]) -> list[str]:
        """
        Wait for a planner, `listeners` subscriptions of the first topic and `is_ready()`; return all their nodes.

        Raises InvalidInput if the planner does not follow /clock.
        """
        node, (state_topic, *_) = self._node, self._topics
        self._awaited = 'No planner that is connected to hvch_command and battery_state', time.monotonic()
        while True:
            await self._next_look
            planners = node.get_publishers_info_by_topic(node.resolve_topic_name('hvch_command'))
            heard = {bytes(each.endpoint_gid): each for each in node.get_subscriptions_info_by_topic(state_topic)}
            everybody = [*planners, *heard.values()]
            if not planners or len(heard) < listeners or any(each.node_name == NAMELESS for each in everybody):
                continue
            names = {endpoint_name(each) for each in planners}
            if len(names) > 1:
                raise InvalidInput(f'{" and ".join(sorted(names))} publish hvch_command; lockstep needs one')
            (planner,) = names
            if is_ready() and all(planner in self._listening_to(topic) for topic in self._topics):
                break
        # Created last: a node that answers knows all publishers of this node. The graph shows its own endpoints in
        # the order of their creation, /clock first.
        self._planner = self._client(planner)
        others = sorted(set(map(endpoint_name, heard.values())) - {planner})
        self._listeners = [self._client(name) for name in others if self._answers(name)]
        await self._greet(self._planner)
        for client in self._listeners:
            await self._greet(client)
        return sorted(map(endpoint_name, heard.values()))

    def _listening_to(self, topic: str) -> set[str]:
        return {endpoint_name(each) for each in self._node.get_subscriptions_info_by_topic(topic)}

    def _answers(self, name: str) -> bool:
        """Return whether a node has parameter services; the graph shows them before its subscriptions."""
        return self._node.count_services(f'{name}/get_parameters') > 0

    def _client(self, name: str) -> Client:
        return self._node.create_client(GetParameters, f'{name}/get_parameters')

    async def _greet(self, client: Client) -> None:
        """Wait until a node answers."""
        service = client.srv_name
        self._awaited = f'No answer of {service}', time.monotonic()
        while not client.service_is_ready():
            await self._next_look
        future, asked_s = client.call_async(SIM_TIME), time.monotonic()
        while not future.done():
            await self._next_look
            if time.monotonic() - asked_s > REPEAT_S:
                client.remove_pending_request(future)
                future, asked_s = client.call_async(SIM_TIME), time.monotonic()
        self._awaited = None
        if client is self._planner and not any(value.bool_value for value in future.result().values):
            raise InvalidInput(f'{service.rpartition("/")[0]} does not follow /clock: start it with '
                               'use_sim_time:=true')

    async def pause(self, duration_s: float) -> None:
        """Wait for a real time [s]."""
        end_s = time.monotonic() + duration_s
        while time.monotonic() < end_s:
            await self._next_look

    def hear(self) -> None:
        """Note a command with the stamp of the latest /clock."""
        if not self._is_answered.done():
            self._is_answered.set_result(True)

    async def clock(self, is_command_due: bool) -> None:
        """Wait until the planner has received the latest /clock, which may have made its next command due."""
        if is_command_due:
            self._is_answered, self._is_overdue = Future(), False
            if await self._is_answered:
                return
        await self.planner()

    async def planner(self) -> None:
        """Wait until the planner has handled every message sent so far, and its own answers are here."""
        assert self._planner is not None
        (periods,) = await self._all([self._planner])
        self.tick_s = min([value.double_value for value in periods.values if value.double_value > 0.0]
                          + [LONGEST_TICK_S])

    async def listeners(self, is_due: bool = False) -> None:
        """Wait for the other listeners, once in a while or if it `is_due`."""
        self._instants += 1
        if is_due or self._instants % INSTANTS_BETWEEN_LISTENERS == 0:
            await self._all(self._listeners)

    async def _all(self, clients: Sequence[Client]) -> list[GetParameters.Response]:
        """Wait for two answers of each node; return the second ones, with the command_period."""
        futures = [(client, client.call_async(SIM_TIME), client.call_async(COMMAND_PERIOD)) for client in clients]
        responses = []
        for client, first, second in futures:
            self._awaited = f'No answer of {client.srv_name}', time.monotonic()
            await first
            responses.append(await second)
        self._awaited = None
        # Commands that left before the last answer may be one turn of this node's executor behind it.
        executor = self._node.executor
        assert executor is not None
        executor.wake()
        await _OneTurn()
        return responses


class _OneTurn:
    """Awaited by a task: the executor makes a turn."""

    def __await__(self) -> Generator[None, None, None]:
        yield
