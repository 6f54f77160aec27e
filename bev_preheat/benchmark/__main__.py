# SPDX-License-Identifier: Apache-2.0
"""`python -m bev_preheat.benchmark`: measures, prints a table, writes JSON."""

import argparse
import json
from pathlib import Path
import platform

from rich.console import Console
from rich.table import Table

from bev_preheat.benchmark import optimum_cost, planning_cost, process_cost

MEASUREMENTS = {'planning': planning_cost.measure, 'optimum': optimum_cost.measure,
                'process': process_cost.measure}


def main():
    """Run the measurements and report them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--only', choices=sorted(MEASUREMENTS), help='one group of measurements')
    parser.add_argument('--json', default='out/benchmark.json', metavar='FILE')
    arguments = parser.parse_args()
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
    path = Path(arguments.json)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({
        'machine': {'processor': platform.machine(), 'python': platform.python_version()},
        'figures': [figure.as_dictionary() for figure in figures]}, indent=2) + '\n')
    console.print(f'written to {path}')


if __name__ == '__main__':
    main()
