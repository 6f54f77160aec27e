# SPDX-License-Identifier: Apache-2.0
"""`python -m bev_preheat_studies.cost`: measure, print a table, write JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a second, during which Ctrl-C may arrive.
    loading('benchmark')

import platform
import sys

from bev_preheat.console.finished import keeping_what_is_finished
from bev_preheat.console.output import json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_records, progress_console, result_console
from bev_preheat.files.output_files import check_outputs
from bev_preheat.optional_packages import require
from bev_preheat.route import route_file
from bev_preheat.vehicle import vehicle_file
from bev_preheat_studies.cost import (
    checker_cost,
    choice_cost,
    dashboard_cost,
    fleet_cost,
    interface_cost,
    optimum_cost,
    planning_cost,
    process_cost,
    recorder_cost,
    restart_cost,
    study_cost,
    update_cost,
)

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

MEASUREMENTS = {'planning': planning_cost.measure, 'interface': interface_cost.measure,
                'update': update_cost.measure,
                'choice': choice_cost.measure, 'optimum': optimum_cost.measure,
                'checker': checker_cost.measure, 'process': process_cost.measure,
                'recorder': recorder_cost.measure, 'dashboard': dashboard_cost.measure,
                'restart': restart_cost.measure,
                'fleet': fleet_cost.measure, 'studies': study_cost.measure}
# Packages needed in addition to the planner's own.
PACKAGES = {'planning': (), 'interface': (), 'update': (), 'choice': (), 'optimum': ('casadi', 'do_mpc'),
            'checker': ('casadi', 'psutil'), 'process': ('psutil',), 'recorder': ('mcap',),
            'dashboard': ('psutil', 'tornado'), 'restart': (), 'fleet': (), 'studies': ()}
# The names of all groups of measurements.
ROUTES = ('reference', 'alpine_pass', 'motorway_3h')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the measurements and report the figures; returns the exit status."""
    return run_program('benchmark', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python -m bev_preheat_studies.cost', description=__doc__)
    parser.add_argument('--only', choices=sorted(MEASUREMENTS), help='one group of measurements')
    parser.add_argument('--json', default='out/benchmark.json', metavar='FILE',
                        help='- is standard output (default: %(default)s)')
    parsed = parser.parse_args(arguments)
    check_outputs([json_output(parsed.json, make_folder=True)],
                  [vehicle_file('reference'), *map(route_file, ROUTES)])
    require(*PACKAGES.get(parsed.only, sorted(set().union(*PACKAGES.values()))))
    return lambda: _measure(parsed)


def _measure(arguments: Namespace) -> int:
    wanted = [name for name in MEASUREMENTS if arguments.only in (None, name)]
    progress, figures, finished = progress_console(), [], []
    with keeping_what_is_finished() as ending:
        for name in wanted:
            with progress.status(f'measuring {name} …'):
                figures += MEASUREMENTS[name](progress.log)
            finished.append(name)
    if figures:
        write_json(arguments.json, {
            'machine': {'processor': platform.machine(), 'python': platform.python_version()},
            'complete': ending.is_complete,
            'figures': [figure.as_dictionary() for figure in figures]}, make_folder=True)
        console = result_console(arguments.json)
        print_records(console, 'Benchmark', ('what', 'figure', 'unit', 'bound', 'within'), [
            (figure.what, f'{figure.value:.4g}', figure.unit,
             '' if figure.bound is None else f'{figure.sense} {figure.bound:g}',
             {None: '', True: 'yes', False: 'NO'}[figure.within]) for figure in figures],
            ('left', *['right'] * 4))
        console.print(f'written to {arguments.json}', markup=False, soft_wrap=True)
    ending.tell(len(finished), len(wanted), 'groups of measurements', (arguments.json,))
    return 0


if __name__ == '__main__':
    sys.exit(main())
