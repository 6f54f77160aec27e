# SPDX-License-Identifier: Apache-2.0
"""
The planner as a process: latency, memory and start, compared with an empty node with its interfaces.

`empty_node` describes that node; both run alternately.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
from statistics import median, quantiles
import subprocess
import sys
from time import monotonic, perf_counter
from typing import TYPE_CHECKING

from ament_index_python.packages import get_package_prefix
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan
from bev_preheat_studies.cost.figures import Figure

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

DOMAIN = '89'
ROUNDS = 5
# Starts scatter by a quarter, and are cheap to repeat.
STARTS = 21
STATES_A_ROUND = 200
PATIENCE_S = 20.0
# Single states may be lost in transit, but not this many in a row.
ATTEMPTS = 5
PLAN_PATIENCE_S = 2.0
# Interval at which a state is resent to a node that has just been found [s].
FIRST_PATIENCE_S = 0.02
# States come seconds apart: the next state finds an idle node.
PAUSE_S = 0.005
# As in an installed executable.
EMPTY = [sys.executable, '-c', 'from bev_preheat_studies.cost.empty_node import main; main()']
# Of the planner over the empty node.
MOST_LATENCY_RATIO, MOST_MEMORY_RATIO = 2.0, 1.2
LONGEST_START_S = 2.0


def planner_command() -> list[str]:
    """Return the installed planner's command line, as `ros2 run` finds it."""
    return [str(Path(get_package_prefix('bev_preheat'), 'lib', 'bev_preheat', 'planner'))]


NODES: dict[str, Callable[[], list[str]]] = {'empty': lambda: EMPTY, 'planner': planner_command}


@dataclass(frozen=True)
class Round:
    """
    The measurements of one process.

    Median and 95th percentile of the time from publishing a battery state to receiving the command [s],
    resident memory [MB].
    """

    median_s: float
    late_s: float
    memory_mb: float


@dataclass(frozen=True)
class Start:
    """One start: from the process's start to its first command [s]."""

    start_s: float


class Probe(Node):
    """Publishes states and a route, and records when commands arrive."""

    def __init__(self) -> None:
        """Load the route of the reference trip."""
        super().__init__('probe')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self.create_publisher(BatteryState, 'battery_state', 1)
        self._routes = self.create_publisher(RoutePlan, 'route_plan', latched)
        self.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)
        self.create_subscription(PreheatPlan, 'preheat_plan', self._on_plan, latched)
        self._sent_ns = 0
        self.command_at: float | None = None
        self.plan_at: float | None = None
        vehicle = load_vehicle('reference')
        self._mission = Mission('benchmark', (Leg(
            load_route('reference', vehicle.defaults), self.now_ns(), target_temperature_c=25.0),))

    def now_ns(self) -> int:
        """Return the node's time [ns]."""
        return self.get_clock().now().nanoseconds

    def send_route(self) -> None:
        """Publish the route, latched."""
        self._routes.publish(route_plan_message(self._mission))

    def send_state(self) -> None:
        """Publish a battery state; `command_at` is then None until the next command arrives."""
        state = BatteryState(temperature=-7.0, percentage=0.9)
        self._sent_ns = self.now_ns()
        state.header.stamp = time_message(self._sent_ns)
        self.command_at = None
        self._states.publish(state)

    def wait(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        """Spin until a condition holds; raise TimeoutError after `patience_s`."""
        end = monotonic() + patience_s
        while not condition():
            if monotonic() > end:
                raise TimeoutError('no answer from the node under test')
            rclpy.spin_once(self, timeout_sec=0.01)

    def wait_for_command(self) -> float:
        """Wait for the command and return the instant of its arrival."""
        self.wait(lambda: self.command_at is not None)
        assert self.command_at is not None
        return self.command_at

    def wait_for_peer(self) -> None:
        """Wait until the node under test is connected both ways."""
        self.wait(lambda: self._states.get_subscription_count() > 0
                  and self._routes.get_subscription_count() > 0
                  and self.count_publishers('hvch_command') > 0)
        # The last publisher found may not be matched yet; an answer proves that it is.
        end = monotonic() + PATIENCE_S
        self.command_at = None
        while self.command_at is None:
            self.send_state()
            try:
                self.wait(lambda: self.command_at is not None, FIRST_PATIENCE_S)
            except TimeoutError:
                if monotonic() > end:
                    raise

    def round_trip_s(self) -> float:
        """Return the time from publishing a battery state to receiving the command."""
        for _ in range(ATTEMPTS):
            started = perf_counter()
            self.send_state()
            round_trip_s = self.wait_for_command() - started
            # A plan received before the command answered the previous state.
            try:
                self.wait(lambda: self.plan_at is not None, PLAN_PATIENCE_S)
            except TimeoutError:
                # Best effort: the state was lost, and the command came from the timer.
                continue
            self._pause()
            return round_trip_s
        raise TimeoutError('no plan from the node under test')

    def _pause(self) -> None:
        end = monotonic() + PAUSE_S
        while monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.001)

    def _on_command(self, message: HvchCommand) -> None:
        if nanoseconds(message.header.stamp) < self._sent_ns:
            # A late answer to an earlier state.
            return
        self.command_at, self.plan_at = perf_counter(), None

    def _on_plan(self, message: PreheatPlan) -> None:
        self.plan_at = perf_counter()


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    try:
        results: dict[str, list[Round]] = {name: [] for name in NODES}
        for number in range(ROUNDS):
            for name, command in NODES.items():
                results[name].append(result := _one_round(command()))
                log(f'round {number + 1}, {name}: {1e3 * result.median_s:.2f} ms, 95 %: '
                    f'{1e3 * result.late_s:.2f} ms, {result.memory_mb:.1f} MB')
        starts: dict[str, list[Start]] = {name: [] for name in NODES}
        for number in range(STARTS):
            for name, command in NODES.items():
                starts[name].append(_one_start(command()))
            log(f'start {number + 1}: ' + ', '.join(
                f'{name} {its[-1].start_s:.2f} s' for name, its in starts.items()))
    finally:
        rclpy.try_shutdown()
    return [
        *_compared('state in, command out, median', 'median_s', results, 1e3, 'ms', MOST_LATENCY_RATIO),
        *_compared('state in, command out, 95 %', 'late_s', results, 1e3, 'ms', MOST_LATENCY_RATIO),
        *_compared('resident memory', 'memory_mb', results, 1.0, 'MB', MOST_MEMORY_RATIO),
        *_compared('process start to first command', 'start_s', starts, 1.0, 's', None, LONGEST_START_S)]


def _compared(what: str, field: str, results: Mapping[str, Sequence[Round | Start]], scale: float, unit: str,
              most_ratio: float | None, bound: float | None = None) -> list[Figure]:
    """Return the Figures of a field: of the planner, of the empty node, and their ratio."""
    columns = {name: [getattr(result, field) for result in rounds]
               for name, rounds in results.items()}

    # Round by round, because the machine has other work now and then.
    ratio = median(ours / its for ours, its in zip(columns['planner'], columns['empty']))
    return [Figure(f'{what}: planner', scale * median(columns['planner']), unit, bound),
            Figure(f'{what}: empty node', scale * median(columns['empty']), unit),
            Figure(f'{what}: planner / empty node', ratio, '', most_ratio)]


def _one_round(command: list[str]) -> Round:
    import psutil
    with _found(command) as (probe, process, _):
        latencies_s = [probe.round_trip_s() for _ in range(STATES_A_ROUND)]
        memory_mb = psutil.Process(process.pid).memory_info().rss / 2**20
    return Round(median(latencies_s), quantiles(latencies_s, n=20)[-1], memory_mb)


def _one_start(command: list[str]) -> Start:
    with _found(command) as (_, _, start_s):
        return Start(start_s)


@contextmanager
def _found(command: list[str]) -> Iterator[tuple[Probe, subprocess.Popen[bytes], float]]:
    """Give a probe, the process that it is connected to, and the time from its start until then [s]."""
    probe = Probe()
    try:
        probe.send_route()
        with running(command) as process:
            started = perf_counter()
            probe.wait_for_peer()
            yield probe, process, probe.wait_for_command() - started
    finally:
        probe.destroy_node()


@contextmanager
def running(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Give a process that runs inside the block."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
