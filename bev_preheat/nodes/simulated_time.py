# SPDX-License-Identifier: Apache-2.0
"""
The time that a simulated drive goes by: its own, which it publishes as `/clock`, or the node's.

`/clock` belongs to one. Of several simulators that would publish it the one that started first goes
on. Each latches a claim on CLAIM_TOPIC with the instant of its start; one that was killed claims
nothing any more, though the graph shows it for some 20 s. A publisher of `/clock` without a claim
cannot be asked to end, so the simulator ends.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING
import uuid

from rclpy.clock import Clock as NodeClock
from rclpy.clock import ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.convert import nanoseconds, time_message
from bev_preheat.nodes.listening_publisher import ListeningPublisher
from bev_preheat.simulation.pace import Pace

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any

    from builtin_interfaces.msg import Time
    from rclpy.node import Node

# As rclcpp's ClockQoS and rclpy's own subscription have it.
CLOCK_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
CLAIM_TOPIC = '/clock_claim'
CLAIM_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
LOOK_PERIOD_S = 0.1
# Real time before the first tick, so that a clock that runs is heard before it is disturbed: this
# long, and so much longer where the graph shows another publisher that may be dead.
FIRST_LOOK_S = 1.0
SILENCE_S = 1.0
# A claim may come this much later than the first tick of whoever makes it, and a simulator that is
# told to end may take so long.
CLAIM_TIME_S = 3.0
# A clock that falls back by more than this was restarted.
RESTART_S = 1.0


class OwnTime:
    """
    Simulated time that runs `speed_up` times as fast as real time, and is published as `/clock`.

    `on_lost(sentence)` is called once when `/clock` turns out to be another's.
    """

    def __init__(self, node: Node, start_ns: int, speed_up: float,
                 on_lost: Callable[[str], object]) -> None:
        """Claim the clock; simulated time starts at `start_ns` [ns], 0: now."""
        self.start_ns = start_ns or time.time_ns()
        self.pace = Pace(speed_up)
        self._node, self._on_lost, self._is_lost = node, on_lost, False
        # Not the node's clock: with use_sim_time that is the one made here.
        self._steady_clock = NodeClock(clock_type=ClockType.STEADY_TIME)
        self._clock = ListeningPublisher(node, Clock, '/clock', CLOCK_QOS, self._on_other_tick)
        self._started_s = time.monotonic()
        self._other_first_s: float | None = None
        self._other_last_s: float | None = None
        self._later_claim_s: float | None = None
        self._own_claim = Header(
            stamp=time_message(time.time_ns()),
            frame_id=f'{node.get_fully_qualified_name()} {uuid.uuid4().hex}')
        self._claims = node.create_publisher(Header, CLAIM_TOPIC, CLAIM_QOS)
        self._claims.publish(self._own_claim)
        node.create_subscription(Header, CLAIM_TOPIC, self._on_claim, CLAIM_QOS)
        self._looked_s, self._is_settled = -LOOK_PERIOD_S, False

    @property
    def has_started(self) -> bool:
        """Whether time may run: nobody else's clock was heard at the start. Ask at each tick."""
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_PERIOD_S:
            self._looked_s = now_s
            self._look(now_s)
        if not self._is_settled:
            wait_s = FIRST_LOOK_S if self._clock.is_alone else FIRST_LOOK_S + SILENCE_S
            self._is_settled = (self._other_last_s is None and now_s - self._started_s >= wait_s)
        return self._is_settled and not self._is_lost

    def elapsed_s(self) -> float:
        """Return the simulated time since the start [s], moving it on."""
        return self.pace.follow(self._steady_clock.now().nanoseconds * 1e-9)

    def stand(self) -> None:
        """Let no simulated time pass."""
        self.pace.stand(self._steady_clock.now().nanoseconds * 1e-9)

    def publish(self, stamp: Time) -> None:
        """Publish `/clock`."""
        self._clock.publish(Clock(clock=stamp))

    def _look(self, now_s: float) -> None:
        self._clock.look()
        if self._other_last_s is None:
            return
        if now_s - self._other_last_s > SILENCE_S:
            # A simulator that started later has ended.
            self._other_first_s = self._other_last_s = None
            return
        since_s = max(self._other_first_s or 0.0, self._later_claim_s or 0.0)
        if now_s - since_s > CLAIM_TIME_S:
            self._lose(self._clock.names_of_others())

    def _on_other_tick(self, serialized: bytes) -> None:
        self._other_last_s = time.monotonic()
        self._other_first_s = self._other_first_s or self._other_last_s

    def _on_claim(self, claim: Header) -> None:
        if claim.frame_id == self._own_claim.frame_id:
            return
        if _order(claim) < _order(self._own_claim):
            name = claim.frame_id.partition(' ')[0]
            own = self._node.get_fully_qualified_name()
            self._lose(f'another node named {own}' if name == own else name)
        else:
            self._later_claim_s = time.monotonic()

    def _lose(self, names: str) -> None:
        if self._is_lost:
            return
        self._is_lost = True
        self._on_lost(f'{names} publishes /clock already; set publish_clock:=false (and '
                      'use_sim_time:=true) to drive by that clock')


def _order(claim: Header) -> tuple[int, str]:
    return nanoseconds(claim.stamp), claim.frame_id


class NodeTime:
    """The node's time: another's `/clock` with use_sim_time, the system's without."""

    def __init__(self, node: Node, values: Mapping[str, Any]) -> None:
        """Raise InvalidInput where parameter values ask for what only the clock's owner can do."""
        problems = [f'{name}: {values[name]} is not allowed with publish_clock:=false; it must be '
                    f'{allowed}' for name, allowed in (
                        ('start_time', 0.0), ('speed_up', 1.0), ('wait_for_planner', False),
                        ('wait_for_listeners', 0)) if values[name] != allowed]
        if problems:
            raise InvalidInput(problems)
        self._node = node
        # 0: not known yet.
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
        """Return the time since the start [s]; raise InvalidInput where the clock was set back."""
        now_ns = self._node.get_clock().now().nanoseconds
        if now_ns < self._latest_ns - RESTART_S * NS_PER_S:
            raise InvalidInput(
                f'the clock fell back by {(self._latest_ns - now_ns) / NS_PER_S:.1f} s; the drive '
                'cannot go back')
        self._latest_ns = max(self._latest_ns, now_ns)
        return (self._latest_ns - self.start_ns) / NS_PER_S

    def stand(self) -> None:
        """Do nothing: the clock is another's."""

    def publish(self, stamp: Time) -> None:
        """Publish nothing: the clock is another's."""
