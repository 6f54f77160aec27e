# SPDX-License-Identifier: Apache-2.0
"""`python -m bev_preheat.benchmark`: measures, prints a table, writes JSON."""

import argparse
import json
import platform
import sys

from rich.console import Console
from rich.table import Table

from bev_preheat.benchmark import (
    checker_cost, optimum_cost, planning_cost, process_cost, restart_cost)
from bev_preheat.errors import InvalidInput
from bev_preheat.output_files import check_outputs, Output, write_whole
from bev_preheat.route import route_file
from bev_preheat.vehicle import vehicle_file

MEASUREMENTS = {'planning': planning_cost.measure, 'optimum': optimum_cost.measure,
                'checker': checker_cost.measure, 'process': process_cost.measure,
                'restart': restart_cost.measure}
# All that are planned for.
ROUTES = ('reference', 'alpine_pass')


def main(arguments=None):
    """Run the measurements and report them; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--only', choices=sorted(MEASUREMENTS), help='one group of measurements')
    parser.add_argument('--json', default='out/benchmark.json', metavar='FILE')
    arguments = parser.parse_args(arguments)
    try:
        check_outputs([Output('--json', arguments.json, make_folder=True)],
                      [vehicle_file('reference'), *map(route_file, ROUTES)])
        _measure(arguments)
    except InvalidInput as error:
        print(f'benchmark: error: {error}', file=sys.stderr)
        return 2
    return 0


def _measure(arguments):
    console = Console()
    figures = []
    for name, measure in MEASUREMENTS.items():
        if arguments.only in (None, name):
            with console.status(f'measuring {name} …'):
                figures += measure(console.log)
    table = Table(title='Benchmark')
    for heading in ('what', 'figure', 'unit', 'bound', 'within'):
        table.add_column(heading, justify='left' if heading == 'what' else 'right')
    for figure in figures:
        table.add_row(figure.what, f'{figure.value:.4g}', figure.unit,
                      '' if figure.bound is None else f'{figure.sense} {figure.bound:g}',
                      {None: '', True: 'yes', False: 'NO'}[figure.within])
    console.print(table)
    write_whole(arguments.json, json.dumps({
        'machine': {'processor': platform.machine(), 'python': platform.python_version()},
        'figures': [figure.as_dictionary() for figure in figures]}, indent=2) + '\n',
        make_folder=True)
    console.print(f'written to {arguments.json}')


if __name__ == '__main__':
    sys.exit(main())
