# SPDX-License-Identifier: Apache-2.0
"""Cost of the flight recorder in an update of the planner node: for the node, and for the writing thread."""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from time import clock_gettime, pthread_getcpuclockid, sleep, thread_time
from typing import TYPE_CHECKING

import numpy as np
import rclpy
from rclpy.parameter import Parameter
from sensor_msgs.msg import BatteryState

from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.messages.fields import time_message
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.nodes.planner_node import PlannerNode
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_studies.cost.figures import Figure

if TYPE_CHECKING:
    from collections.abc import Callable

# Not that of the other measurements, nor the user's.
DOMAIN = 88
# The first updates do not count, because caches fill.
UPDATES, FILLING = 1500, 100
# As between two states in the latency measurement (`process_cost`).
PAUSE_S = 0.005
NOISE_K, NOISE_A = 0.1, 8.0
MOST_SHARE_PERCENT = 3.0


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    rclpy.init(domain_id=DOMAIN)
    try:
        node = PlannerNode()
        try:
            with TemporaryDirectory() as folder:
                return _figures(node, folder, log)
        finally:
            node.last_words()
            node.destroy_node()
    finally:
        rclpy.shutdown()


def _figures(node: PlannerNode, folder: str, log: Callable[[str], object]) -> list[Figure]:
    vehicle = load_vehicle('reference')
    start_ns = node.get_clock().now().nanoseconds
    node.set_parameters([Parameter('flight_recorder', value=folder)])
    node._on_input('route_plan', route_plan_message(Mission('benchmark', (Leg(
        load_route('reference', vehicle.defaults), start_ns, target_temperature_c=25.0),))))
    recorder, spent_s, measuring_s = node._recorder, [0.0], [0.0]
    for name in ('note', 'note_plan'):
        setattr(recorder, name, _timed(getattr(recorder, name), spent_s, measuring_s))
    drawn = np.random.default_rng(1)
    _update(node, drawn, FILLING)
    spent_s[0], measuring_s[0], before_s = 0.0, 0.0, _writer_s(node)
    updates_s = _update(node, drawn, UPDATES)
    recorder.catch_up()
    sleep(0.1)
    own_s, writer_s = (spent_s[0] - measuring_s[0]) / UPDATES, (_writer_s(node) - before_s) / UPDATES
    # Means, because the writer works in batches; without the recorder's own share.
    update_s = float(np.mean(updates_s)) - own_s
    log(f'update of the planner node: {UPDATES} times, '
        f'{sum(path.stat().st_size for path in Path(folder).iterdir()) / 1e6:.1f} MB recorded')
    return [
        Figure('update of the planner node, processor time', 1e3 * update_s, 'ms'),
        Figure("the flight recorder's share of its thread, by which a plan is later",
               100.0 * own_s / update_s, '%', MOST_SHARE_PERCENT),
        Figure("the flight recorder's share with its own thread", 100.0 * (own_s + writer_s) / update_s, '%',
               MOST_SHARE_PERCENT)]


def _timed(method: Callable[..., None], spent_s: list[float], measuring_s: list[float]) -> Callable[..., None]:
    """Return a method that adds its processor time [s] to `spent_s`, and that of a clock to `measuring_s`."""
    def timed(*arguments: object) -> None:
        first_s = thread_time()
        started_s = thread_time()
        method(*arguments)
        spent_s[0] += thread_time() - started_s
        measuring_s[0] += started_s - first_s
    return timed


def _writer_s(node: PlannerNode) -> float:
    """Return the processor time of the writer's thread so far [s]."""
    writer = node._recorder._writer
    assert writer is not None and writer._thread.ident is not None
    return clock_gettime(pthread_getcpuclockid(writer._thread.ident))


def _update(node: PlannerNode, drawn: np.random.Generator, updates: int) -> list[float]:
    """Return the processor time of each update [s]."""
    times_s = []
    for _ in range(updates):
        state = BatteryState(
            temperature=-7.0 + drawn.normal(0.0, NOISE_K), percentage=0.9, voltage=400.0,
            current=-40.0 + drawn.normal(0.0, NOISE_A), charge=math.nan, capacity=math.nan)
        state.header.stamp = time_message(node.get_clock().now().nanoseconds)
        started_s = thread_time()
        node._on_input('battery_state', state)
        times_s.append(thread_time() - started_s)
        sleep(PAUSE_S)
    return times_s
