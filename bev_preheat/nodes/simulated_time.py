# SPDX-License-Identifier: Apache-2.0
"""
The time of a simulated drive: its own, which it publishes as `/clock`, or the node's; lockstep and its limit.

Only one node may publish `/clock`. A simulator that receives another's clock ends.

In lockstep the clock goes on once the nodes around the drive have handled every message. A node is asked for
parameters, which each node of rclpy and rclcpp answers unless that is switched off. In each turn its executor
looks at all topics, then at all services, and runs the callbacks of all that arrived: timers first, then
subscriptions, then one request of each service. A message that arrives after the look at its topic and before the
look at the service runs a turn after the request behind it, but before a second request. So after two answers a
message is handled, and timers that are due by a new `/clock` run before any message that is sent later. A command
with the stamp of a new `/clock` shows this without a request: it is from the turn of these timers. All callbacks
run in one order, however busy the computer is.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
import time
from typing import Any

from builtin_interfaces.msg import Time
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client
from rclpy.node import Node
from rclpy.task import Future
from rosgraph_msgs.msg import Clock

from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.setup_watch import endpoint_name, NAMELESS, RESTART_S
from bev_preheat.nodes.topics import BEST_EFFORT, ListeningPublisher
from bev_preheat.numerics import NS_PER_S

# Simulated time between two clock messages [s]: the time resolution of the nodes.
TICK_S = 0.5
# Longest real time between them [s], so that slow simulations run smoothly.
LONGEST_REAL_TICK_S = 0.01


class Pace:
    """
    Simulated seconds since the start, `speed_up` per real second.

    If a call is late, on a busy computer, the simulation slows down instead of jumping:
    leases and time limits that use its clock see at most two ticks at once. `lost_s` is the
    total simulated time [s] skipped in this way.
    """

    def __init__(self, speed_up: float) -> None:
        """Stay at 0 until the first call of `follow`."""
        self.speed_up = speed_up
        self.elapsed_s = 0.0
        self.lost_s = 0.0
        self._real_s: float | None = None

    @property
    def real_tick_s(self) -> float:
        """Suitable real time between two calls of `follow` [s]."""
        return min(LONGEST_REAL_TICK_S, TICK_S / self.speed_up)

    def follow(self, real_s: float) -> float:
        """Return the simulated seconds at a real instant [s of any steady clock]."""
        if self._real_s is not None:
            tick_s = (real_s - self._real_s) * self.speed_up
            self.lost_s += max(0.0, tick_s - 2.0 * TICK_S)
            self.elapsed_s += min(tick_s, 2.0 * TICK_S)
        self._real_s = real_s
        return self.elapsed_s


LOOK_PERIOD_S = 0.1
# Real time before the first tick, so that a running clock is received before it is disturbed: longer if the
# graph shows another publisher. That one may be dead: a killed node stays in the graph for some 20 s.
FIRST_LOOK_S = 1.0
CLOCK_SILENCE_S = 1.0
# Real time from the first tick of another node to the end. A simulator that started less than STARTED_AGO_S ago
# ends soon, once the name of the other node is known: discovery takes up to 3 s. An older one first gives the
# other time to end.
STARTED_AGO_S = 4.0
PATIENCE_OF_YOUNG_S = 0.5
OTHER_CLOCK_S = 5.0


class OwnTime:
    """Simulated time, `speed_up` times as fast; publishes `/clock`, `on_lost(sentence)` if another does too."""

    def __init__(self, node: Node, start_ns: int, speed_up: float,
                 on_lost: Callable[[str], object]) -> None:
        """Advertise the clock; simulated time starts at `start_ns` [ns], 0: now."""
        self.start_ns = start_ns or time.time_ns()
        self.pace = Pace(speed_up)
        self._on_lost, self._is_lost = on_lost, False
        # Best effort as in rclcpp's ClockQoS and rclpy's own subscription.
        self._clock = ListeningPublisher(node, Clock, '/clock', BEST_EFFORT, self._on_other_tick)
        self._started_s = time.monotonic()
        # When another node's ticks began, and its latest one.
        self._other_ticks_s: tuple[float, float] | None = None
        self._looked_s, self._is_settled = -LOOK_PERIOD_S, False

    @property
    def has_started(self) -> bool:
        """Whether time may run: no other clock was received at the start. Call it at each tick."""
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_PERIOD_S:
            self._looked_s = now_s
            self._look(now_s)
        if not self._is_settled:
            wait_s = FIRST_LOOK_S if self._clock.is_alone else FIRST_LOOK_S + CLOCK_SILENCE_S
            self._is_settled = self._other_ticks_s is None and now_s - self._started_s >= wait_s
        return self._is_settled and not self._is_lost

    def elapsed_s(self) -> float:
        """Return the simulated time since the start [s], moving it on."""
        # Not of the node's clock: with use_sim_time that is the one published here.
        return self.pace.follow(time.monotonic())

    def publish(self, stamp: Time) -> None:
        """Publish `/clock`."""
        self._clock.publish(Clock(clock=stamp))

    def _look(self, now_s: float) -> None:
        self._clock.look()
        if self._other_ticks_s is None:
            return
        first_s, latest_s = self._other_ticks_s
        patience_s = PATIENCE_OF_YOUNG_S if first_s - self._started_s < STARTED_AGO_S else OTHER_CLOCK_S
        if now_s - latest_s > CLOCK_SILENCE_S:
            self._other_ticks_s = None
        elif now_s - first_s > patience_s and not self._is_lost:
            self._is_lost = True
            self._on_lost(f'{self._clock.names_of_others()} also publishes /clock; set publish_clock:=false (and '
                          'use_sim_time:=true) to drive by that clock')

    def _on_other_tick(self, serialized: bytes) -> None:
        now_s = time.monotonic()
        self._other_ticks_s = (now_s if self._other_ticks_s is None else self._other_ticks_s[0], now_s)


class NodeTime:
    """The node's time: another node's `/clock` with use_sim_time, otherwise the system's."""

    def __init__(self, node: Node, values: Mapping[str, Any]) -> None:
        """Raise InvalidInput if a parameter value needs the owner of the clock."""
        problems = [f'{name}: {values[name]} is not allowed with publish_clock:=false; it must be '
                    f'{allowed}' for name, allowed in (
                        ('start_time', 0.0), ('speed_up', 1.0), ('wait_for_planner', False),
                        ('wait_for_listeners', 0), ('lockstep', False)) if values[name] != allowed]
        if problems:
            raise InvalidInput(problems)
        self._node = node
        # 0: unknown.
        self.start_ns = 0
        self.pace = Pace(1.0)
        self._latest_ns = 0

    @property
    def has_started(self) -> bool:
        """Whether the clock shows a time; the start is the first one seen."""
        if self.start_ns == 0:
            self.start_ns = self._node.get_clock().now().nanoseconds
        return self.start_ns != 0

    def elapsed_s(self) -> float:
        """Return the time since the start [s]; raise InvalidInput if the clock was set back."""
        now_ns = self._node.get_clock().now().nanoseconds
        if now_ns < self._latest_ns - RESTART_S * NS_PER_S:
            raise InvalidInput(
                f'the clock fell back by {(self._latest_ns - now_ns) / NS_PER_S:.1f} s; the drive '
                'cannot go back')
        self._latest_ns = max(self._latest_ns, now_ns)
        return (self._latest_ns - self.start_ns) / NS_PER_S

    def publish(self, stamp: Time) -> None:
        """Publish nothing: another node owns the clock."""


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
        """Return the nodes of a planner and `listeners` once they are there; InvalidInput if it ignores /clock."""
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
            if is_ready() and all(any(endpoint_name(each) == planner for each in
                                      node.get_subscriptions_info_by_topic(topic)) for topic in self._topics):
                break
        # Created last: a node that answers knows all publishers of this node. The graph shows its own endpoints in
        # the order of their creation, /clock first.
        self._planner = self._client(planner)
        others = sorted(set(map(endpoint_name, heard.values())) - {planner})
        # A node has parameter services if it answers; the graph shows them before its subscriptions.
        self._listeners = [self._client(name) for name in others if node.count_services(f'{name}/get_parameters')]
        await self._greet(self._planner)
        for client in self._listeners:
            await self._greet(client)
        return sorted(map(endpoint_name, heard.values()))

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
