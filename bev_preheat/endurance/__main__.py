# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat.endurance`: the installed planner under load, in real time.

Battery states come at 100 Hz, routes are replaced every few seconds, and garbage is mixed in. The
exit status is 0 only where memory stays flat, no command period is missed, and nothing is commanded
that must not be.
"""

import argparse
import os
from pathlib import Path
import signal
import sys
import time

import psutil
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bev_preheat.commands.output import write_json
from bev_preheat.control.settings import Settings
from bev_preheat.demonstration.processes import NodeProcess, reserved_domain_id
from bev_preheat.endurance.judgement import judge
from bev_preheat.endurance.load import Load
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.listening import spun_node
from bev_preheat.output_files import check_outputs, expanded, Output, PICTURE_SUFFIXES
from bev_preheat.vehicle import load_vehicle, vehicle_file

SAMPLE_PERIOD_S = 1.0
START_LIMIT_S = 30.0
# Of the files beside the picture.
JSON_SUFFIX, LOG_SUFFIX = '.json', '.planner.log'


def main(arguments=None):
    """Run the soak test and return its exit status."""
    parsed = _parse(arguments)
    console = Console(highlight=False)
    try:
        check_outputs([Output('--output', parsed.output, PICTURE_SUFFIXES, make_folder=True)] + [
            Output('--output', _beside(parsed.output, suffix), make_folder=True)
            for suffix in (JSON_SUFFIX, LOG_SUFFIX)], [vehicle_file('reference')])
        return _run(parsed, console)
    except InvalidInput as error:
        for problem in error.problems:
            print(f'soak: error: {problem}', file=sys.stderr)
        return 2


def _run(parsed, console):
    """Load the planner, judge and draw; return the exit status."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    try:
        judgements, load, samples = _soak(parsed, console)
    except TimeoutError as error:
        console.print(f'soak: failed: {error}', style='red', markup=False)
        return 1
    table = Table(title=f'{parsed.minutes:g} min, battery state at {parsed.rate:g} Hz')
    for heading in ('what', 'figure', 'allowed', ''):
        table.add_column(heading)
    for item in judgements:
        table.add_row(item.what, item.value, item.allowed,
                      '' if not item.allowed else 'good' if item.good else 'BAD')
    console.print(table)
    good = all(item.good for item in judgements)
    write_json(_beside(parsed.output, JSON_SUFFIX), {
        'judgements': [vars(item) for item in judgements], 'memory': samples})
    from bev_preheat.drawing.endurance_figure import draw_endurance
    draw_endurance(parsed.output, load.commands, samples)
    console.print(f'Picture: {parsed.output}')
    console.print(f'soak: {"good" if good else "failed"}', style='green' if good else 'red')
    return 0 if good else 1


def _parse(arguments):
    parser = argparse.ArgumentParser(
        prog='python -m bev_preheat.endurance', description='The planner under load, in real time.')
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


def _beside(picture, suffix):
    return f'{os.path.splitext(picture)[0]}{suffix}'


def _soak(parsed, console):
    """Return (Judgements, Load, samples of the memory)."""
    heater_w = load_vehicle('reference').hvch.maximum_power_w
    with reserved_domain_id() as domain_id:
        os.environ.update(ROS_DOMAIN_ID=str(domain_id), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        with spun_node('soak') as node:
            load = Load(node, parsed.rate, parsed.seed, heater_w)
            with NodeProcess('planner', [], _beside(parsed.output, LOG_SUFFIX)) as planner:
                samples = _watch(planner, load, 60.0 * parsed.minutes, console)
                exit_status = planner.end() if planner.exit_status is None else None
    return judge(load, samples, Settings.command_period_s, exit_status), load, samples


def _watch(planner, load, duration_s, console):
    """Load the planner for so long [s]; return samples (instant [s], resident memory [MB])."""
    limit_s = time.monotonic() + START_LIMIT_S
    while not load.is_connected:
        if time.monotonic() > limit_s or planner.exit_status is not None:
            raise TimeoutError(f'no planner within {START_LIMIT_S:g} s: {planner.output()[-500:]}')
        time.sleep(0.05)
    process, samples = psutil.Process(planner.process_id), []
    load.start()
    try:
        with Progress(TextColumn('{task.description}'), BarColumn(), TimeRemainingColumn(),
                      console=console) as progress:
            task = progress.add_task('', total=duration_s)
            start_s = time.monotonic()
            while (elapsed_s := time.monotonic() - start_s) < duration_s:
                if planner.exit_status is not None:
                    break
                samples.append((elapsed_s, process.memory_info().rss / 2**20))
                progress.update(task, completed=elapsed_s, description=(
                    f'{samples[-1][1]:.1f} MB, {len(load.commands)} commands, '
                    f'{load.garbage_sent} garbage'))
                time.sleep(SAMPLE_PERIOD_S)
    finally:
        load.stop()
    return samples


if __name__ == '__main__':
    sys.exit(main())
