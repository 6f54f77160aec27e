# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat_studies.soak`: the installed planner under load, in real time.

Battery states arrive at 100 Hz, routes are replaced every few seconds, and garbage is mixed in. The
exit status is 0 only if memory stays flat, no command period is missed, and there is no forbidden
command.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('soak')

import os
from pathlib import Path
import sys
import time

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import progress_bar, result_console
from bev_preheat.control.settings import Settings
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile, PICTURE_SUFFIXES
from bev_preheat.nodes.listening import listening
from bev_preheat.optional_packages import require
from bev_preheat.simulator.installed_processes import NodeProcess, reserved_domain_id
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat_studies.soak.assessment import judge
from bev_preheat_studies.soak.load import SoakLoad
from bev_preheat_studies.soak.report import tell

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from bev_preheat.console.finished import InterruptedEnding
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.nodes.listening import Listener
    from bev_preheat_studies.soak.assessment import Assessment

SAMPLE_PERIOD_S = 1.0
START_LIMIT_S = 180.0
# An interrupted run with fewer commands is not assessed.
LEAST_COMMANDS = 3
# Suffixes of the files next to the picture.
JSON_SUFFIX, LOG_SUFFIX = '.json', '.planner.log'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the soak test and return its exit status."""
    return run_program('soak', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parsed = _parse(arguments)
    check_outputs([OutputFile('--output', parsed.output, PICTURE_SUFFIXES, make_folder=True)] + [
        OutputFile('--output', _beside(parsed.output, suffix), make_folder=True)
        for suffix in (JSON_SUFFIX, LOG_SUFFIX)], [vehicle_file('reference')])
    require('psutil')
    return lambda: _run(parsed)


def _run(parsed: Namespace) -> int:
    """Load the planner, assess and draw the finished part; return the exit status."""
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    console = result_console()
    try:
        assessments, load, samples, ending = _soak(parsed)
    except TimeoutError as error:
        console.print(f'soak: failed: {error}', style='red', markup=False, soft_wrap=True)
        return 1
    if not assessments:
        ending.tell(0, f'{parsed.minutes:g}', 'min', ())
    minutes = samples[-1][0] / 60.0
    write_json(_beside(parsed.output, JSON_SUFFIX), {
        'complete': ending.is_complete,
        'judgements': [vars(item) for item in assessments], 'memory': samples})
    from bev_preheat_studies.drawing.endurance_figure import draw_endurance
    draw_endurance(parsed.output, load.commands, samples)
    good = tell(console, 'soak', f'{minutes if not ending.is_complete else parsed.minutes:.3g} min, '
                f'battery state at {parsed.rate:g} Hz', assessments)
    console.print(f'Picture: {parsed.output}', markup=False, soft_wrap=True)
    ending.tell(f'{minutes:.3g}', f'{parsed.minutes:g}', 'min', (parsed.output,))
    return 0 if good else 1


def _parse(arguments: Sequence[str] | None) -> Namespace:
    parser = OneLineParser(
        prog='python -m bev_preheat_studies.soak', description='The planner under load, in real time.')
    parser.add_argument('--minutes', type=float, default=10.0, help='how long (%(default)s)')
    parser.add_argument('--rate', type=float, default=100.0,
                        help='battery states a second (%(default)s)')
    parser.add_argument('--seed', type=int, default=1, help='(%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('out/soak.png'), metavar='FILE',
                        help='the picture; JSON and log go beside it (%(default)s)')
    parsed = parser.parse_args(arguments)
    if not 0.05 <= parsed.minutes <= 10_000.0 or not 1.0 <= parsed.rate <= 1000.0:
        parser.error('--minutes must be 0.05 ... 10000, --rate 1 ... 1000')
    parsed.output = Path(expanded(parsed.output))
    return parsed


def _beside(picture: AnyPath, suffix: str) -> str:
    return f'{os.path.splitext(picture)[0]}{suffix}'


def _soak(parsed: Namespace) -> tuple[list[Assessment], SoakLoad, list[tuple[float, float]], InterruptedEnding]:
    """Return (Assessments, Load, samples of the memory, Ending); no Assessments after an early end."""
    heater_w = load_vehicle('reference').hvch.maximum_power_w
    with reserved_domain_id() as domain_id:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        with listening('soak') as listener:
            load = SoakLoad(listener.node, parsed.rate, parsed.seed, heater_w)
            with NodeProcess('planner', [], _beside(parsed.output, LOG_SUFFIX)) as planner:
                samples: list[tuple[float, float]] = []
                with keeping_what_is_finished() as ending:
                    _watch(listener, planner, load, 60.0 * parsed.minutes, samples)
                # Ctrl-C in a terminal also reaches the planner.
                ended_by_itself = ending.is_complete and planner.exit_status is not None
                exit_status = None if ended_by_itself else planner.end()
    assessments = []
    if ending.is_complete or len(load.commands) >= LEAST_COMMANDS:
        assessments = judge(load, samples, Settings.command_period_s, exit_status)
    return assessments, load, samples, ending


def _watch(listener: Listener, planner: NodeProcess, load: SoakLoad, duration_s: float,
           samples: list[tuple[float, float]]) -> None:
    """Load the planner for a duration [s]; append samples (instant [s], resident memory [MB])."""
    import psutil
    limit_s = time.monotonic() + START_LIMIT_S
    while not load.is_connected:
        if time.monotonic() > limit_s or planner.exit_status is not None:
            raise TimeoutError(f'no planner within {START_LIMIT_S:g} s: {planner.output()[-500:]}')
        listener.listen(0.05)
    process = psutil.Process(planner.process_id)
    load.start()
    try:
        with progress_bar(TextColumn('{task.description}'), BarColumn(),
                          TimeRemainingColumn()) as progress:
            task = progress.add_task('', total=duration_s)
            start_s = time.monotonic()
            while (elapsed_s := time.monotonic() - start_s) < duration_s:
                if planner.exit_status is not None:
                    break
                samples.append((elapsed_s, process.memory_info().rss / 2**20))
                progress.update(task, completed=elapsed_s, description=(
                    f'{samples[-1][1]:.1f} MB, {len(load.commands)} commands, '
                    f'{load.garbage_sent} garbage'))
                listener.listen(SAMPLE_PERIOD_S)
    finally:
        load.stop()


if __name__ == '__main__':
    sys.exit(main())
