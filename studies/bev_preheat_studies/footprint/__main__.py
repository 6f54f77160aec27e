# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat_studies.footprint`: bytes, stack and instructions of an export, as tables and JSON.

Each plan is compared with the plan in Python; the exit status is 1 if any differs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import loading, run_program

if __name__ == '__main__':
    # Loading takes a while, during which Ctrl-C may arrive.
    loading('footprint')

from dataclasses import replace
from pathlib import Path
import shutil
import sys
from tempfile import TemporaryDirectory

from bev_preheat.console.output import json_output, write_json
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_records, progress_console, result_console
from bev_preheat.ecu.export import Export
from bev_preheat.ecu.vectors import LARGEST_TRIP, METHODS
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, vehicle_file
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.footprint.builds import Build, COMPUTER, CORTEX_M7, LEVELS
from bev_preheat_studies.footprint.measured import measure, Measured
from bev_preheat_studies.footprint.situations import situations
from bev_preheat_studies.footprint.tables import byte_rows, instruction_rows, MEMORY_STEPS, path_name

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Sequence

    from bev_preheat.vehicle import Vehicle

# Lags of the heat: of the heater, and through coolant.
LATE = HeatPath(heater_lag_s=45.0, coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
PATHS = (HeatPath(), LATE)
DRAWN, LONG, SEED = 24, 2, 0
# As in the export's Makefile.
USUAL_BLOCK = 32
M7_ADVICE = ('not measured: Cortex-M7, as arm-none-eabi-gcc is not installed (Debian, Ubuntu: sudo apt install '
             'gcc-arm-none-eabi libnewlib-arm-none-eabi)')


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and report; returns the exit status."""
    return run_program('footprint', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parser = OneLineParser(prog='python -m bev_preheat_studies.footprint', description=__doc__)
    parser.add_argument('--vehicle', default='reference', metavar='NAME|FILE',
                        help='a name in config/vehicles or a YAML file (default: %(default)s)')
    parser.add_argument('--block', type=int, default=USUAL_BLOCK, metavar='N',
                        help="the Makefile's BLOCK: states side by side (default: %(default)s)")
    parser.add_argument('--json', default='out/footprint.json', metavar='FILE',
                        help='- is standard output (default: %(default)s)')
    parsed = parser.parse_args(arguments)
    if not 1 <= parsed.block <= USUAL_BLOCK:
        raise InvalidInput(f'--block: {parsed.block} is not allowed; it must be 1 ... {USUAL_BLOCK}')
    vehicle = load_vehicle(parsed.vehicle)
    check_outputs([json_output(parsed.json, make_folder=True)], [vehicle_file(parsed.vehicle)])
    for tool in ('make', COMPUTER.compiler):
        if shutil.which(tool) is None:
            raise InvalidInput(f'{tool} is not installed (Debian, Ubuntu: sudo apt install build-essential)')
    require('elftools', *(('unicorn',) if CORTEX_M7.is_there else ()))
    return lambda: _measure(parsed, vehicle)


def _measure(arguments: Namespace, vehicle: Vehicle) -> int:
    targets, console = [COMPUTER, *([CORTEX_M7] if CORTEX_M7.is_there else [])], progress_console()
    results: list[Measured] = []
    with TemporaryDirectory() as folder, console.status('measuring …'):
        for path in PATHS:
            car, export = replace(vehicle, heat_path=path), Path(folder, path_name(path))
            exported = Export(car, export, []).write(DRAWN, SEED, lambda: None)
            planned = situations(car, exported, LONG, SEED)
            for target in targets:
                for level in LEVELS:
                    results.append(measured := measure(
                        Build(target, level, export, LARGEST_TRIP, arguments.block), path, planned, MEMORY_STEPS))
                    console.print(f'{measured.build}, {path_name(path)}: {len(planned)} situations, '
                                  f'{measured.differ} plans differ', markup=False)
    write_json(arguments.json, {
        'compilers': {target.name: target.version for target in targets},
        'builds': [measured.as_dictionary() for measured in results]}, make_folder=True)
    result = result_console(arguments.json)
    for method in METHODS:
        print_records(result, f'{method} [bytes]', *byte_rows(results, method))
    rows = instruction_rows(results)
    if rows:
        print_records(result, 'Instructions of a plan, million: least, median, most (number of plans)', *rows)
    for target in targets:
        result.print(f'{target.name}: {target.version}', markup=False)
    if CORTEX_M7 not in targets:
        result.print(M7_ADVICE, markup=False)
    result.print(f'written to {arguments.json}', markup=False, soft_wrap=True)
    return 1 if any(measured.differ for measured in results) else 0


if __name__ == '__main__':
    sys.exit(main())
