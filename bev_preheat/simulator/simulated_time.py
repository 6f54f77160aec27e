# SPDX-License-Identifier: Apache-2.0
"""
The time of a simulated drive: its own, which it publishes as `/clock`, or the node's.

Only one node may publish `/clock`. A simulator that receives another's clock ends.
"""
from __future__ import annotations

import time
from typing import TYPE_CHECKING

from rclpy.clock import Clock as NodeClock
from rclpy.clock import ClockType
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.publishers import ListeningPublisher
from bev_preheat.nodes.setup_watch import RESTART_S
from bev_preheat.numerics import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from builtin_interfaces.msg import Time
    from rclpy.node import Node

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


# As rclcpp's ClockQoS and rclpy's own subscription have it.
CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
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
    """
    Simulated time that runs `speed_up` times as fast as real time, and is published as `/clock`.

    `on_lost(sentence)` is called once if another node publishes `/clock`, too.
    """

    def __init__(self, node: Node, start_ns: int, speed_up: float,
                 on_lost: Callable[[str], object]) -> None:
        """Advertise the clock; simulated time starts at `start_ns` [ns], 0: now."""
        self.start_ns = start_ns or time.time_ns()
        self.pace = Pace(speed_up)
        self._on_lost, self._is_lost = on_lost, False
        # Not the node's clock: with use_sim_time that is the one published here.
        self._steady_clock = NodeClock(clock_type=ClockType.STEADY_TIME)
        self._clock = ListeningPublisher(node, Clock, '/clock', CLOCK_QOS, self._on_other_tick)
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
        return self.pace.follow(self._steady_clock.now().nanoseconds * 1e-9)

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
