# SPDX-License-Identifier: Apache-2.0
"""The planner as a process: latency, memory and start, against an empty node in the same run."""

from __future__ import annotations

from contextlib import contextmanager
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
from time import monotonic, perf_counter
from typing import TYPE_CHECKING

from ament_index_python.packages import get_package_prefix
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.experiments.cost.figures import Figure
from bev_preheat.nodes.convert import route_plan_message
from bev_preheat.route import load_route
from bev_preheat.supervision.inputs import Leg, Mission
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

DOMAIN = '89'
ROUNDS = 5
STATES_A_ROUND = 200
PATIENCE_S = 20.0
# States may get lost on the way; so many in a row do not.
ATTEMPTS = 5
PLAN_PATIENCE_S = 2.0
EMPTY = [sys.executable, '-m', 'bev_preheat.experiments.cost.empty_node']


def planner_command() -> list[str]:
    """Return the installed planner, as `ros2 run` looks it up."""
    return [str(Path(get_package_prefix('bev_preheat'), 'lib', 'bev_preheat', 'planner'))]


class Probe(Node):
    """Publishes states and a route, and notes when commands come back."""

    def __init__(self) -> None:
        """Take the route of the reference trip."""
        super().__init__('probe')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self.create_publisher(BatteryState, 'battery_state', 1)
        self._routes = self.create_publisher(RoutePlan, 'route_plan', latched)
        self.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)
        self.create_subscription(PreheatPlan, 'preheat_plan', self._on_plan, latched)
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
        """Publish a battery state; `command_at` is then None until the next command comes."""
        state = BatteryState(temperature=-7.0, percentage=0.9)
        state.header.stamp = self.get_clock().now().to_msg()
        self.command_at = None
        self._states.publish(state)

    def wait(self, condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        """Spin until a condition holds; raise TimeoutError if it does not in time."""
        end = monotonic() + patience_s
        while not condition():
            if monotonic() > end:
                raise TimeoutError('no answer from the node under test')
            rclpy.spin_once(self, timeout_sec=0.01)

    def wait_for_command(self) -> float:
        """Return the instant at which the command came, when it is there."""
        self.wait(lambda: self.command_at is not None)
        assert self.command_at is not None
        return self.command_at

    def wait_for_peer(self) -> None:
        """Wait until the node under test is connected both ways."""
        self.wait(lambda: self._states.get_subscription_count() > 0
                  and self._routes.get_subscription_count() > 0
                  and self.count_publishers('hvch_command') > 0)
        # The last publisher found may not be matched yet; an answer shows that it is.
        self.command_at = None
        while self.command_at is None:
            self.send_state()
            try:
                self.wait(lambda: self.command_at is not None, patience_s=0.2)
            except TimeoutError:
                continue

    def round_trip_s(self) -> float:
        """Return the time from a battery state out to the command in."""
        for _ in range(ATTEMPTS):
            started = perf_counter()
            self.send_state()
            round_trip_s = self.wait_for_command() - started
            # States come seconds apart: the next one does not find the node still at work on this
            # one. A plan heard before the command was that of the state before.
            try:
                self.wait(lambda: self.plan_at is not None, PLAN_PATIENCE_S)
            except TimeoutError:
                # Best effort: the state was lost, and the command was the timer's.
                continue
            return round_trip_s
        raise TimeoutError('no plan from the node under test')

    def _on_command(self, message: HvchCommand) -> None:
        self.command_at, self.plan_at = perf_counter(), None

    def _on_plan(self, message: PreheatPlan) -> None:
        self.plan_at = perf_counter()


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    try:
        results: dict[str, list[tuple[float, float, float]]] = {'planner': [], 'empty': []}
        for number in range(ROUNDS):
            for name, command in (('empty', EMPTY), ('planner', planner_command())):
                results[name].append(_one_round(command))
                latency_s, memory_mb, start_s = results[name][-1]
                log(f'round {number + 1}, {name}: {1e3 * latency_s:.2f} ms, {memory_mb:.1f} MB, '
                    f'first command after {start_s:.2f} s')
    finally:
        rclpy.try_shutdown()
    (latency_s, memory_mb, start_s), (floor_s, floor_mb, floor_start_s) = (
        [median(column) for column in zip(*results[name])] for name in ('planner', 'empty'))
    ratios = [planner[0] / empty[0]
              for planner, empty in zip(results['planner'], results['empty'])]
    return [
        Figure('state in, command out: planner, median', 1e3 * latency_s, 'ms'),
        Figure('state in, command out: empty node, median', 1e3 * floor_s, 'ms'),
        Figure('latency, planner / empty node', median(ratios), '', 1.5),
        Figure('resident memory: planner', memory_mb, 'MB'),
        Figure('resident memory: empty node', floor_mb, 'MB'),
        Figure('memory, planner / empty node', memory_mb / floor_mb, '', 1.5),
        Figure('process start to first command: planner', start_s, 's', 2.0),
        Figure('process start to first command: empty node', floor_start_s, 's'),
    ]


def _one_round(command: list[str]) -> tuple[float, float, float]:
    """Return (median latency [s], resident memory [MB], process start to first command [s])."""
    import psutil
    probe = Probe()
    try:
        probe.send_route()
        with running(command) as process:
            started = perf_counter()
            probe.wait_for_peer()
            start_s = probe.wait_for_command() - started
            latencies_s = [probe.round_trip_s() for _ in range(STATES_A_ROUND)]
            memory_mb = psutil.Process(process.pid).memory_info().rss / 2**20
        return median(latencies_s), memory_mb, start_s
    finally:
        probe.destroy_node()


@contextmanager
def running(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Give a process that runs while the block lasts."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
