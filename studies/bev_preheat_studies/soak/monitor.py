# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat_studies.soak.monitor`: `preheat monitor` in a terminal, during consecutive drives.

Planner, simulated vehicle and monitor are the real processes. The exit status is 0 only if the
monitor keeps showing new data, prints nothing but its page, does not leak memory, ends with
Ctrl-C and restores the terminal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('soak-monitor')

from dataclasses import dataclass, field
import os
from pathlib import Path
import re
import sys
import time

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import result_console
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile
from bev_preheat.optional_packages import require
from bev_preheat.route import route_file
from bev_preheat.simulator.installed_processes import NodeProcess, reserved_domain_id
from bev_preheat.vehicle import vehicle_file
from bev_preheat_studies.soak.assessment import (
    Assessment,
    memory_growth_mb_in_10_min,
    MOST_GROWTH_MB_IN_10_MIN,
)
from bev_preheat_studies.soak.report import tell
from bev_preheat_studies.soak.terminal import CTRL_C, TerminalProcess

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from rich.console import Console

    from bev_preheat.console.finished import InterruptedEnding
    from bev_preheat.files.output_files import AnyPath

COLUMNS, ROWS = 110, 45
START_S = 1_700_000_000
# Drives follow each other in simulated time; after this many the clock jumps back to the first.
DRIVES_IN_A_ROW, BETWEEN_STARTS_S = 5, 7200
# At a hundred times real time, a clock message 40 ms late is 4 s late.
CLOCK_TOLERANCE_S = 5.0
# Real time: until the first battery state is shown, between two views, and without a battery state,
# as between two drives [s].
START_LIMIT_S, MOST_BETWEEN_VIEWS_S, MOST_AGE_S = 60.0, 10.0, 30.0
SAMPLE_PERIOD_S = 1.0
# An interrupted run with fewer views is not assessed.
LEAST_SAMPLES = 3
BATTERY_STATE_AGE = re.compile(r'battery (\d+\.\d) s')
TEMPERATURE = re.compile(r'Battery +(-?\d+\.\d degC)')


@dataclass
class Seen:
    """Observations of the monitor; `memory` holds (instant [s], resident memory [MB])."""

    memory: list[tuple[float, float]] = field(default_factory=list)
    drives: int = 0
    views: int = 0
    longest_between_views_s: float = 0.0
    oldest_shown_s: float = 0.0
    temperatures: set[str] = field(default_factory=set)
    said: str = ''
    exit_status: int | None = None
    restores_terminal: bool = False


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the test and return the exit status."""
    return run_program('soak-monitor', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parsed = _parse(arguments)
    check_outputs(
        [OutputFile('--output', parsed.output, ('.json',), make_folder=True)]
        + [OutputFile('--output', _log_file(parsed.output, name), make_folder=True)
           for name in ('planner', 'vehicle_simulator')],
        [vehicle_file('reference'), route_file(parsed.route)])
    require('psutil')
    return lambda: _run(parsed)


def _run(parsed: Namespace) -> int:
    """Watch the monitor, assess and write the finished part; return the exit status."""
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    console = result_console()
    try:
        seen, ending = _watch(parsed, console)
    except TimeoutError as error:
        console.print(f'soak-monitor: failed: {error}', style='red', markup=False, soft_wrap=True)
        return 1
    if len(seen.memory) < LEAST_SAMPLES:
        ending.tell(0, f'{parsed.minutes:g}', 'min', ())
    minutes = f'{seen.memory[-1][0] / 60.0:.3g}' if seen.memory else '0'
    assessments = judge(seen)
    write_json(parsed.output, {'complete': ending.is_complete,
                               'judgements': [vars(item) for item in assessments],
                               'memory': seen.memory})
    title = (f'preheat monitor, {parsed.minutes if ending.is_complete else float(minutes):g} min '
             f'at {parsed.speed_up:g} times real time')
    good = tell(console, 'soak-monitor', title, assessments)
    ending.tell(minutes, f'{parsed.minutes:g}', 'min', (parsed.output,))
    return 0 if good else 1


def judge(seen: Seen) -> list[Assessment]:
    """Return the Assessments of the observations."""
    growth_mb = memory_growth_mb_in_10_min(*zip(*seen.memory))
    return [
        Assessment('monitor', 'ended cleanly' if seen.exit_status == 0 else
                   f'status {seen.exit_status}', 'ends with Ctrl-C', seen.exit_status == 0),
        Assessment('terminal', 'as before' if seen.restores_terminal else 'not restored',
                   'as before', seen.restores_terminal),
        Assessment('output besides its page', seen.said[-2000:] or 'nothing', 'nothing',
                   not seen.said),
        Assessment('resident memory, growth in 10 min', f'{growth_mb:+.3f} MB',
                   f'at most {MOST_GROWTH_MB_IN_10_MIN:g} MB',
                   growth_mb <= MOST_GROWTH_MB_IN_10_MIN),
        Assessment('resident memory at the end', f'{seen.memory[-1][1]:.1f} MB', '', True),
        Assessment('longest time between two views', f'{seen.longest_between_views_s:.2f} s',
                   f'at most {MOST_BETWEEN_VIEWS_S:g} s',
                   seen.longest_between_views_s <= MOST_BETWEEN_VIEWS_S),
        Assessment('oldest battery state shown', f'{seen.oldest_shown_s:.1f} s',
                   f'at most {MOST_AGE_S:g} s', seen.oldest_shown_s <= MOST_AGE_S),
        Assessment('views', str(seen.views), '', True),
        Assessment('different temperatures shown', str(len(seen.temperatures)), 'at least 10',
                   len(seen.temperatures) >= 10),
        Assessment('drives that arrived', str(seen.drives), 'some', seen.drives > 0),
    ]


def _parse(arguments: Sequence[str] | None) -> Namespace:
    parser = OneLineParser(
        prog='python -m bev_preheat_studies.soak.monitor',
        description='preheat monitor in a terminal, beside one simulated drive after another.')
    parser.add_argument('--minutes', type=float, default=60.0, help='how long (%(default)s)')
    parser.add_argument('--speed-up', type=float, default=100.0, metavar='N',
                        help='simulated seconds in each real second (%(default)s)')
    parser.add_argument('--route', default='reference', help='name or CSV file (%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('out/soak-monitor.json'),
                        metavar='FILE', help='figures; the logs go beside it (%(default)s)')
    parsed = parser.parse_args(arguments)
    if not 0.2 <= parsed.minutes <= 10_000.0 or not 1.0 <= parsed.speed_up <= 1000.0:
        parser.error('--minutes must be 0.2 ... 10000, --speed-up 1 ... 1000')
    parsed.output = Path(expanded(parsed.output))
    return parsed


def _log_file(output: AnyPath, name: str) -> str:
    return f'{os.path.splitext(output)[0]}.{name}.log'


def _watch(parsed: Namespace, console: Console) -> tuple[Seen, InterruptedEnding]:
    """Return the observations and the Ending of the run."""
    seen = Seen()
    with reserved_domain_id() as domain_id:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        with NodeProcess('planner', ['-p', 'use_sim_time:=true',
                                     '-p', f'clock_tolerance:={CLOCK_TOLERANCE_S}'],
                         _log_file(parsed.output, 'planner')), \
                TerminalProcess([sys.executable, '-m', 'bev_preheat', 'monitor'], COLUMNS,
                                ROWS) as monitor, _Drives(parsed) as drives:
            with keeping_what_is_finished() as ending:
                _look(monitor, drives, seen, 60.0 * parsed.minutes, console)
            if monitor.exit_status is None:
                monitor.type(CTRL_C)
            seen.exit_status = monitor.wait()
            seen.restores_terminal = monitor.has_left_terminal_as_it_was
            if seen.exit_status != 0 or b'Traceback' in monitor.tail:
                seen.said = monitor.tail[-4000:].decode('utf-8', 'replace')
            seen.drives, seen.views = drives.arrived, monitor.views
    return seen, ending


class _Drives:
    """Runs one simulated drive after another."""

    def __init__(self, parsed: Namespace) -> None:
        self._parsed, self._started, self.arrived = parsed, 0, 0
        self._simulator: NodeProcess | None = None

    def __enter__(self) -> _Drives:
        self.go_on()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._simulator is not None:
            self._simulator.end()

    def go_on(self) -> None:
        """Start a drive if none is running."""
        if self._simulator is not None:
            if self._simulator.exit_status is None:
                return
            if self._simulator.exit_status != 0:
                raise InvalidInput(f'vehicle_simulator ended: {self._simulator.output()[-500:]}')
            self.arrived += 1
        start_s = START_S + self._started % DRIVES_IN_A_ROW * BETWEEN_STARTS_S
        self._simulator = NodeProcess('vehicle_simulator', [
            '-p', f'route:={self._parsed.route}', '-p', f'speed_up:={self._parsed.speed_up}',
            '-p', f'start_time:={float(start_s)}', '-p', 'wait_for_planner:=true',
            '-p', 'exit_on_arrival:=true'], _log_file(self._parsed.output, 'vehicle_simulator'))
        self._started += 1


def _look(monitor: TerminalProcess, drives: _Drives, seen: Seen, duration_s: float,
          console: Console) -> None:
    """Observe for a duration [s], or until the monitor ends."""
    import psutil
    process, limit_s = psutil.Process(monitor.process_id), time.monotonic() + START_LIMIT_S
    while not BATTERY_STATE_AGE.search(monitor.view):
        monitor.read(0.2)
        if monitor.exit_status is not None or time.monotonic() > limit_s:
            raise TimeoutError(f'no battery state on the page within {START_LIMIT_S:g} s: '
                               + monitor.tail[-2000:].decode('utf-8', 'replace'))
    start_s = view_s = time.monotonic()
    next_told_s, views = 0.0, monitor.views
    while (elapsed_s := time.monotonic() - start_s) < duration_s:
        drives.go_on()
        seen.memory.append((elapsed_s, process.memory_info().rss / 2**20))
        if elapsed_s >= next_told_s:
            console.print(f'{elapsed_s / 60.0:6.1f} min  {seen.memory[-1][1]:.1f} MB  '
                          f'{monitor.views} views  {drives.arrived} drives')
            next_told_s += 60.0
        sample_end_s = time.monotonic() + SAMPLE_PERIOD_S
        while (now_s := time.monotonic()) < sample_end_s:
            monitor.read(0.1)
            if monitor.exit_status is not None:
                return
            if monitor.views > views:
                views, view_s = monitor.views, now_s
            seen.longest_between_views_s = max(seen.longest_between_views_s, now_s - view_s)
        view = monitor.view
        for age in BATTERY_STATE_AGE.findall(view):
            seen.oldest_shown_s = max(seen.oldest_shown_s, float(age))
        seen.temperatures.update(TEMPERATURE.findall(view))


if __name__ == '__main__':
    sys.exit(main())
