# SPDX-License-Identifier: Apache-2.0
"""
The installed planner under load, in real time.

Battery states arrive at 100 Hz, routes are replaced every few seconds, and garbage is mixed in. The exit status is
0 only if memory stays flat, no command period is missed, and there is no forbidden command.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import time
from typing import TYPE_CHECKING

import numpy as np
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

from bev_preheat.commands.output import json_output, write_json
from bev_preheat.commands.program import keeping_what_is_finished
from bev_preheat.commands.terminal import print_records, progress_bar, result_console
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, OutputFile
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.study import check_ranges

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Sequence

    from numpy.typing import ArrayLike

    from bev_preheat.commands.parser import Subparsers
    from bev_preheat.commands.program import InterruptedEnding
    from bev_preheat.nodes.installed_drive import NodeProcess
    from bev_preheat.nodes.listening import Listener
    from bev_preheat_studies.soak.load import SoakLoad

SAMPLE_PERIOD_S = 1.0
START_LIMIT_S = 180.0
# An interrupted run with fewer commands is not assessed.
LEAST_COMMANDS = 3
LIMITS = {'minutes': (0.05, 10_000.0), 'rate': (1.0, 1000.0)}
# Largest growth of the memory in ten minutes [MB], after the first part, in which caches fill.
MOST_GROWTH_MB_IN_10_MIN = 1.0
WARM_UP_SHARE = 0.2
# A command this much later than its period counts as missed [s]: the computer may be busy.
LATE_BY_S = 0.5


def add_parser(subparsers: Subparsers) -> None:
    """Add the test."""
    parser = subparsers.add_parser('soak', help='the installed planner under load', description=__doc__)
    parser.add_argument('--minutes', type=float, default=10.0, help='how long (%(default)s)')
    parser.add_argument('--rate', type=float, default=100.0, help='battery states a second (%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='(%(default)s)')
    parser.add_argument('--json', default='out/soak.json', metavar='FILE',
                        help="figures; the planner's log goes beside it (default: %(default)s)")
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Load the planner, and assess the finished part; returns 0 if all is good."""
    check_ranges(arguments, LIMITS)
    log_file = str(Path(arguments.json).with_suffix('.planner.log'))
    check_outputs([json_output(arguments.json, make_folder=True),
                   OutputFile('--json', log_file, make_folder=True)], [vehicle_file('reference')])
    require('psutil')
    Path(log_file).parent.mkdir(parents=True, exist_ok=True)
    load, samples, exit_status, ending = _soak(arguments, log_file)
    console, minutes = result_console(arguments.json), samples[-1][0] / 60.0 if samples else 0.0
    if not ending.is_complete and len(load.commands) < LEAST_COMMANDS:
        ending.tell(0, f'{arguments.minutes:g}', 'min', ())
    assessments = judge(load, samples, Settings.command_period_s, exit_status)
    write_json(arguments.json, {'complete': ending.is_complete, 'judgements': [vars(item) for item in assessments],
                                'memory': samples}, make_folder=True)
    print_records(console, f'{minutes:.3g} min, battery state at {arguments.rate:g} Hz', (
        'what', 'figure', 'allowed', ''), [
        (item.what, item.value, item.allowed, '' if not item.allowed else 'good' if item.good else 'BAD')
        for item in assessments])
    good = all(item.good for item in assessments)
    console.print(f'soak: {"good" if good else "failed"}', style='green' if good else 'red')
    ending.tell(f'{minutes:.3g}', f'{arguments.minutes:g}', 'min', (arguments.json,))
    return 0 if good else 1


def _soak(arguments: Namespace, log_file: str) -> tuple[
        SoakLoad, list[tuple[float, float]], int | None, InterruptedEnding]:
    """Return load, samples of the memory, the exit status (None: it had ended before), and the ending."""
    # These need ROS 2.
    from bev_preheat.nodes.installed_drive import NodeProcess, reserved_domain_id
    from bev_preheat.nodes.listening import listening
    from bev_preheat_studies.soak.load import SoakLoad
    samples: list[tuple[float, float]] = []
    with reserved_domain_id() as domain_id:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        with listening('soak') as listener:
            load = SoakLoad(listener.node, arguments.rate, arguments.seed,
                            load_vehicle('reference').hvch.maximum_power_w)
            with NodeProcess('planner', [], log_file) as planner:
                with keeping_what_is_finished() as ending:
                    _watch(listener, planner, load, 60.0 * arguments.minutes, samples)
                # Ctrl-C in a terminal also reaches the planner.
                ended_by_itself = ending.is_complete and planner.exit_status is not None
                return load, samples, None if ended_by_itself else planner.end(), ending


def _watch(listener: Listener, planner: NodeProcess, load: SoakLoad, duration_s: float,
           samples: list[tuple[float, float]]) -> None:
    """Load the planner for a duration [s]; append samples (instant [s], resident memory [MB])."""
    import psutil
    limit_s = time.monotonic() + START_LIMIT_S
    while not load.is_connected:
        if time.monotonic() > limit_s or planner.exit_status is not None:
            raise InvalidInput(f'no planner within {START_LIMIT_S:g} s: {planner.output()[-500:]}')
        listener.listen(0.05)
    process = psutil.Process(planner.pid)
    load.start()
    try:
        with progress_bar(TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn()) as progress:
            task = progress.add_task('', total=duration_s)
            start_s = time.monotonic()
            while (elapsed_s := time.monotonic() - start_s) < duration_s and planner.exit_status is None:
                samples.append((elapsed_s, process.memory_info().rss / 2**20))
                progress.update(task, completed=elapsed_s, description=(
                    f'{samples[-1][1]:.1f} MB, {len(load.commands)} commands, {load.garbage_sent} garbage'))
                listener.listen(SAMPLE_PERIOD_S)
    finally:
        load.stop()


@dataclass(frozen=True)
class Assessment:
    """A figure: its name, its value and bound as texts, and whether the bound is met."""

    what: str
    value: str
    allowed: str
    good: bool


def memory_growth_mb_in_10_min(instants_s: ArrayLike, memory_mb: ArrayLike) -> float:
    """
    Return the growth of the memory after the warm-up, from samples [s], [MB].

    The median of the slopes between all pairs of samples (Theil-Sen): a single step, when a cache fills,
    is not a leak.
    """
    instants_s, memory_mb = np.asarray(instants_s, float), np.asarray(memory_mb, float)
    kept = instants_s >= instants_s[0] + WARM_UP_SHARE * (instants_s[-1] - instants_s[0])
    x, y = instants_s[kept], memory_mb[kept]
    if len(x) < 3:
        return 0.0
    first, second = np.triu_indices(len(x), k=1)
    apart_s = x[second] - x[first]
    slopes = (y[second] - y[first])[apart_s > 0.0] / apart_s[apart_s > 0.0]
    return float(np.median(slopes)) * 600.0


def judge(load: SoakLoad, memory_samples: Sequence[tuple[float, float]], command_period_s: float,
          exit_status: int | None) -> list[Assessment]:
    """Return the Assessments of a load and of samples ([s], [MB]); `exit_status` None: the planner had died."""
    intervals_s = np.diff(load.commands)
    missed = int((intervals_s > command_period_s + LATE_BY_S).sum())
    growth_mb = memory_growth_mb_in_10_min(*zip(*memory_samples))
    longest_s = float(intervals_s.max()) if len(intervals_s) else float('inf')
    return [
        Assessment('process', 'ended cleanly' if exit_status == 0 else f'status {exit_status}',
                   'ends cleanly on SIGTERM', exit_status == 0),
        Assessment('resident memory, growth in 10 min', f'{growth_mb:+.3f} MB',
                   f'at most {MOST_GROWTH_MB_IN_10_MIN:g} MB',
                   growth_mb <= MOST_GROWTH_MB_IN_10_MIN),
        Assessment('resident memory at the end', f'{memory_samples[-1][1]:.1f} MB', '', True),
        Assessment('command periods missed', str(missed), '0', missed == 0),
        Assessment('longest time without a command', f'{longest_s:.3f} s',
                   f'at most {command_period_s + LATE_BY_S:g} s',
                   longest_s <= command_period_s + LATE_BY_S),
        Assessment('forbidden commands', '; '.join(load.wrong[:3]) or '0', '0',
                   not load.wrong),
        Assessment('internal errors', str(load.internal_errors), '0', load.internal_errors == 0),
        Assessment('battery states sent', str(load.states_sent), '', True),
        Assessment('garbage messages', str(load.garbage_sent), 'some', load.garbage_sent > 0),
        Assessment('routes sent', str(load.routes_sent), '', True),
        Assessment('service calls', str(load.calls), '', True),
        Assessment('commands heard', str(len(load.commands)), '', True),
        Assessment('of these, heating', str(load.heating_commands), 'some',
                   load.heating_commands > 0),
    ]
