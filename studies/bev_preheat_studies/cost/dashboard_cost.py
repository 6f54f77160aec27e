# SPDX-License-Identifier: Apache-2.0
"""
Cost of a dashboard for the planner: processor time of its process per update, and latency of the command.

In each round the same planner answers battery states without a dashboard, and then with one that a browser tab
follows. Processor time includes the middleware's threads, which send each message to one more reader.
"""

from __future__ import annotations

import asyncio
from contextlib import contextmanager
import json
import os
from pathlib import Path
import re
from statistics import median
import subprocess
from tempfile import TemporaryDirectory
from threading import Event, Thread
import time
from typing import NamedTuple, TYPE_CHECKING

from ament_index_python.packages import get_package_prefix
import rclpy

from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.cost.process_cost import PATIENCE_S, planner_command, Probe, running

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

DOMAIN = '87'
ROUNDS, STATES, FILLING = 7, 300, 50
# Of the planner with a dashboard over the same planner without; sending to one more reader is all that is added.
MOST_TIME_RATIO, MOST_LATENCY_RATIO = 1.2, 1.2


class Spent(NamedTuple):
    """Processor time per update and median latency [s]."""

    update_s: float
    latency_s: float


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    try:
        rounds: list[tuple[Spent, Spent]] = []
        for number in range(ROUNDS):
            rounds.append(_round())
            alone, watched = rounds[-1]
            log(f'round {number + 1}: {1e3 * alone.update_s:.2f} ms per update alone, '
                f'{1e3 * watched.update_s:.2f} ms with a dashboard; latency '
                f'{1e3 * alone.latency_s:.2f}, {1e3 * watched.latency_s:.2f} ms')
    finally:
        rclpy.try_shutdown()
    return [
        *_compared('update of the planner as a process, processor time',
                   [(alone.update_s, watched.update_s) for alone, watched in rounds], MOST_TIME_RATIO),
        *_compared('state in, command out, median',
                   [(alone.latency_s, watched.latency_s) for alone, watched in rounds], MOST_LATENCY_RATIO)]


def _compared(what: str, pairs: Sequence[tuple[float, float]], most_ratio: float) -> list[Figure]:
    """Return the Figures of a time: without a dashboard, with one, and the median ratio of the rounds."""
    return [Figure(f'{what}: without a dashboard', 1e3 * median(alone for alone, _ in pairs), 'ms'),
            Figure(f'{what}: with a dashboard', 1e3 * median(watched for _, watched in pairs), 'ms'),
            Figure(f'{what}: with / without a dashboard', median(watched / alone for alone, watched in pairs), '',
                   most_ratio)]


def _round() -> tuple[Spent, Spent]:
    probe = Probe()
    try:
        probe.send_route()
        with running(planner_command()) as planner:
            probe.wait_for_peer()
            alone = _spent(probe, planner.pid)
            with _watched(probe):
                return alone, _spent(probe, planner.pid)
    finally:
        probe.destroy_node()


def _spent(probe: Probe, process_id: int) -> Spent:
    for _ in range(FILLING):
        probe.round_trip_s()
    before_s = _processor_time_s(process_id)
    latencies_s = [probe.round_trip_s() for _ in range(STATES)]
    return Spent((_processor_time_s(process_id) - before_s) / STATES, median(latencies_s))


def _processor_time_s(process_id: int) -> float:
    """Return the processor time of all threads of a process [s]."""
    import psutil
    times = psutil.Process(process_id).cpu_times()
    return float(times.user + times.system)


@contextmanager
def _watched(probe: Probe) -> Iterator[None]:
    """Run a dashboard, followed by one tab, inside the block."""
    with TemporaryDirectory() as folder:
        log_file = Path(folder, 'dashboard.log')
        command = [str(Path(get_package_prefix('bev_preheat'), 'lib', 'bev_preheat', 'dashboard')),
                   '--ros-args', '-p', 'port:=0']
        with open(log_file, 'wb') as output:
            process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        try:
            def address() -> str | None:
                found = re.search(r'http://(\S+:\d+)/', log_file.read_text(encoding='utf-8'))
                return found and found.group(1)
            probe.wait(lambda: address() is not None and probe.count_subscribers('preheat_plan') > 1)
            host = address()
            assert host is not None
            with _tab(host):
                yield
        finally:
            process.terminate()
            process.wait(PATIENCE_S)


@contextmanager
def _tab(host: str) -> Iterator[None]:
    """Follow the planner over a WebSocket, as a browser tab does, inside the block."""
    from tornado.httpclient import HTTPRequest
    from tornado.websocket import websocket_connect
    ends, has_view = Event(), Event()

    async def follow() -> None:
        connection = await websocket_connect(HTTPRequest(f'ws://{host}/tab', headers={'Origin': f'http://{host}'}))
        await connection.write_message(json.dumps({'planner': '/planner'}))
        while not ends.is_set():
            text = await connection.read_message()
            if text is None:
                return
            if '"view"' in str(text):
                has_view.set()
        connection.close()
    thread = Thread(target=lambda: asyncio.run(follow()), daemon=True)
    thread.start()
    try:
        if not has_view.wait(PATIENCE_S):
            raise TimeoutError('no message from the dashboard')
        # The planner's first burst to a new reader is over.
        time.sleep(1.0)
        yield
    finally:
        ends.set()
        thread.join(PATIENCE_S)
