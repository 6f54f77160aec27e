# SPDX-License-Identifier: Apache-2.0
"""The planner's process beside an empty node: latency, memory, start, and restart while heating."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
from pathlib import Path
from statistics import median, quantiles
import subprocess
import sys
from time import monotonic, perf_counter

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

DOMAIN = '89'
ROUNDS = 5
# Starts scatter by a quarter.
STARTS, RESTARTS = 11, 10
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
# Bounds: latency, memory over the empty node's, start, restart to first heat.
MOST_LATENCY_MS, MOST_MEMORY_RATIO, MOST_START_S, MOST_RESTART_S = 10.0, 1.2, 2.0, 10.0
# Too short a drive for the target: heating starts at once. After this time, no message of a killed process is in
# transit [s].
SHORT_DRIVE_S, SILENCE_S, STATE_PERIOD_S = 1200.0, 0.3, 0.1


def planner_command() -> list[str]:
    """Return the installed planner's command line, as `ros2 run` finds it."""
    return [str(Path(get_package_prefix('bev_preheat'), 'lib', 'bev_preheat', 'planner'))]


NODES: dict[str, Callable[[], list[str]]] = {'empty node': lambda: EMPTY, 'planner': planner_command}


class Probe(Node):
    """Publishes states and a route, and records when commands arrive."""

    def __init__(self, remaining_s: float | None = None) -> None:
        """Load the route of the reference trip, or its last part [s]."""
        super().__init__('probe')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._states = self.create_publisher(BatteryState, 'battery_state', 1)
        self._routes = self.create_publisher(RoutePlan, 'route_plan', latched)
        self.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)
        self.create_subscription(PreheatPlan, 'preheat_plan', self._on_plan, latched)
        self._sent_ns = 0
        self.heats = False
        self.command_at: float | None = None
        self.plan_at: float | None = None
        vehicle = load_vehicle('reference')
        route = load_route('reference', vehicle.defaults)
        if remaining_s is not None:
            route = route.after(route.total_duration_s - remaining_s)
        self._mission = Mission('benchmark', (Leg(route, self.now_ns(), target_temperature_c=25.0),))

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
            self.listen(PAUSE_S)
            return round_trip_s
        raise TimeoutError('no plan from the node under test')

    def listen(self, duration_s: float) -> None:
        """Spin for a duration [s]."""
        end = monotonic() + duration_s
        while monotonic() < end:
            rclpy.spin_once(self, timeout_sec=0.001)

    def _on_command(self, message: HvchCommand) -> None:
        self.heats = message.battery_heating_power > 0.0
        if nanoseconds(message.header.stamp) < self._sent_ns:
            # A late answer to an earlier state.
            return
        self.command_at, self.plan_at = perf_counter(), None

    def _on_plan(self, message: PreheatPlan) -> None:
        self.plan_at = perf_counter()


def measure(log: Callable[[str], object]) -> list[tuple[str, float, str, float | None]]:
    """Return name, value, unit and bound of each figure; `log` takes a line of progress."""
    os.environ.update(ROS_DOMAIN_ID=DOMAIN, ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    rclpy.init()
    found: dict[str, dict[str, list[float]]] = {
        name: {'latency_s': [], 'memory_mb': [], 'start_s': [], 'restart_s': []} for name in NODES}
    try:
        # The nodes alternate, because the machine has other work now and then.
        for number in range(STARTS):
            for name, command in NODES.items():
                with _found(command()) as (probe, process, start_s):
                    found[name]['start_s'].append(start_s)
                    if number < ROUNDS:
                        found[name]['latency_s'] += [probe.round_trip_s() for _ in range(STATES_A_ROUND)]
                        found[name]['memory_mb'].append(_memory_mb(process))
            log(f'start {number + 1}: ' + ', '.join(
                f'{name} {its["start_s"][-1]:.2f} s' for name, its in found.items()))
        for name, command in NODES.items():
            found[name]['restart_s'] = _restarts_s(command())
            log(f'{name}, start to first heat: ' + ', '.join(f'{each:.2f}' for each in found[name]['restart_s']))
    finally:
        rclpy.try_shutdown()
    figures = []
    for name, its in found.items():
        ours = name == 'planner'
        figures += [
            (f'{name}: state in, command out, median', 1e3 * median(its['latency_s']), 'ms',
             MOST_LATENCY_MS if ours else None),
            (f'{name}: state in, command out, 95 %', 1e3 * quantiles(its['latency_s'], n=20)[-1], 'ms', None),
            (f'{name}: resident memory', median(its['memory_mb']), 'MB', None),
            (f'{name}: process start to first command, median', median(its['start_s']), 's',
             MOST_START_S if ours else None),
            (f'{name}: restart after SIGKILL to first heat, median', median(its['restart_s']), 's', None),
            (f'{name}: restart after SIGKILL to first heat, longest', max(its['restart_s']), 's',
             MOST_RESTART_S if ours else None)]
    ratio = median(found['planner']['memory_mb']) / median(found['empty node']['memory_mb'])
    return [*figures, ('resident memory: planner / empty node', ratio, '', MOST_MEMORY_RATIO)]


def _memory_mb(process: subprocess.Popen[bytes]) -> float:
    import psutil
    return float(psutil.Process(process.pid).memory_info().rss) / 2**20


def _restarts_s(command: list[str]) -> list[float]:
    """Return the times from a start to the first heat [s], after the process before was killed while it heated."""
    probe, times_s = Probe(SHORT_DRIVE_S), []
    try:
        probe.send_route()
        probe.create_timer(STATE_PERIOD_S, probe.send_state)
        # The first start does not count.
        for _ in range(RESTARTS + 1):
            probe.listen(SILENCE_S)
            probe.heats = False
            started = perf_counter()
            with running(command) as process:
                probe.wait(lambda: probe.heats, 3.0 * PATIENCE_S)
                times_s.append(perf_counter() - started)
                process.kill()
                process.wait()
        return times_s[1:]
    finally:
        probe.destroy_node()


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
