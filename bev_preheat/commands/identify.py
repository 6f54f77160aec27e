# SPDX-License-Identifier: Apache-2.0
"""`preheat identify`: a vehicle file from recorded drives, with intervals and a report."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
import shlex
import sys
import time
from typing import TYPE_CHECKING

from bev_preheat.commands.output import add_json_argument, json_output, write_json
from bev_preheat.commands.parser import given_options, Subparsers
from bev_preheat.commands.situation import add_log_arguments, add_vehicle_argument, read_trips
from bev_preheat.commands.terminal import print_records, progress_bar, result_console, ResultConsole
from bev_preheat.drawing.identification_figures import report_pictures
from bev_preheat.errors import figure, InvalidInput
from bev_preheat.files.checked_yaml import load_checked_yaml
from bev_preheat.files.input_files import check_input
from bev_preheat.files.output_files import check_outputs, existing_file, OutputFile, write_whole
from bev_preheat.identification.trips import LEAST_TRIPS, MOST_TRIPS
from bev_preheat.optional_packages import require
from bev_preheat.vehicle import load_vehicle, Vehicle, vehicle_file, vehicle_fingerprint
from bev_preheat.vehicle.loading import SCHEMA

if TYPE_CHECKING:
    from bev_preheat.identification.result import Identification

# Stages that `identify` announces beside those of structures and trips, for the bar.
STAGES = 4
# Without a terminal a stage is announced after so much silence [s].
ANNOUNCED_AFTER_S = 10.0


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'identify', help='make a vehicle file from recorded drives',
        description='Fit open-circuit voltage, capacity, resistance, heat capacity, leakage, drivetrain heat and '
        'heater to recorded drives, charging sessions and nights at stand. Values that the logs do not tell stay '
        'as in START, and are named. Needs casadi and scipy; the report needs matplotlib and jinja2.')
    add_log_arguments(parser, needs_logs=False)
    parser.add_argument('--state-file', metavar='FILE',
                        help='instead of logs: the state file of a planner that ran with START')
    add_vehicle_argument(parser, 'the vehicle to start from:', 'START')
    parser.add_argument('--output', required=True, metavar='MY.yaml', help='vehicle file to write')
    parser.add_argument('--report', metavar='REPORT.html', help='report to write, one self-contained file')
    parser.add_argument('--name', help="name of the car (default: the output file's)")
    parser.add_argument('--force', action='store_true', help='replace an existing vehicle file')
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Identify, print, and write the requested files; returns the exit status."""
    start_file = vehicle_file(arguments.vehicle)
    inputs = [start_file, *arguments.logs, *([arguments.state_file] if arguments.state_file else [])]
    check_outputs([json_output(arguments.json), OutputFile('--output', arguments.output, ('.yaml',)),
                   OutputFile('--report', arguments.report, ('.html',))], inputs)
    if existing_file(arguments.output) is not None and not arguments.force:
        raise InvalidInput(f'--output: {arguments.output}: exists; --force replaces it')
    _refuse_other_arguments(arguments)
    if arguments.name is None:
        arguments.name = Path(arguments.output).stem
    if arguments.state_file is not None:
        return _export_learned(arguments, start_file)
    require('casadi', 'scipy', *(['jinja2', 'matplotlib'] if arguments.report else []))
    start = load_vehicle(arguments.vehicle)
    trips = read_trips(arguments, start, is_fit=True)
    from bev_preheat.identification.identify import identify
    from bev_preheat.identification.parameters import STRUCTURES
    from bev_preheat.identification.result import POOR_RMSE_K
    with progress_bar() as bar:
        alone = len(trips) if len(trips) >= LEAST_TRIPS else 0
        task = bar.add_task('', total=STAGES + len(STRUCTURES) * (1 + alone) + alone)
        began_s = said_s = time.monotonic()

        def tell(stage: str) -> None:
            nonlocal said_s
            bar.update(task, description=stage)
            bar.advance(task)
            now_s = time.monotonic()
            if bar.disable and now_s - said_s >= ANNOUNCED_AFTER_S:
                said_s = now_s
                print(f'preheat: {stage}, {bar.tasks[task].percentage:.0f} %, {now_s - began_s:.0f} s',
                      file=sys.stderr, flush=True)

        result = identify(start, trips, arguments.name, tell)
    if arguments.report:
        from bev_preheat.identification.result import report_text
        write_whole(arguments.report, report_text(result, report_pictures(result)))
    if arguments.json:
        write_json(arguments.json, result.as_dictionary())
    if not result.is_useful:
        worst = max(result.left_out, key=lambda trip: abs(trip.error_k), default=None)
        how = (f'the fit leaves an RMSE of {figure(result.fit_rmse_k, 3)} K on its own logs' if worst is None else
               f'trips that the fit has not seen are predicted with an RMSE of {figure(result.rmse_k, 3)} K, '
               f'{worst.name} with {figure(worst.error_k, 3)} K')
        heater = '' if any(trip.heats for trip in trips) else (
            '; none has the power of a battery heater (battery_heater_w): record it if the car heats')
        raise InvalidInput([
            f'{arguments.output}: not written: {how}; at most {POOR_RMSE_K:g} K are allowed; check that '
            f'battery_temperature_c and the powers of all logs are those of one car{heater}',
            *(remark for remark in result.remarks if ': heater_w: ' in remark)])
    _write_identified(arguments, result, start_file)
    _print_result(result_console(arguments.json), result, arguments)
    return 0


def _refuse_other_arguments(arguments: Namespace) -> None:
    if arguments.state_file is None and not arguments.logs:
        raise InvalidInput('LOG: missing; name recorded drives, or a state file with --state-file')
    if len(arguments.logs) > MOST_TRIPS:
        # Before hours of reading.
        raise InvalidInput(
            f'LOG: {len(arguments.logs)} logs; at most {MOST_TRIPS} are fitted; leave out the shortest')
    if arguments.state_file is not None:
        for option in ['logs'] * bool(arguments.logs) + given_options(
                arguments, ('report', 'json', 'signals', 'repair')):
            raise InvalidInput(f'--state-file: not allowed with {option}: it needs no fit')
        check_input(arguments.state_file)


def _export_learned(arguments: Namespace, start_file: Path) -> int:
    """Write the vehicle file with the values of a state file, print them, and return the exit status."""
    from bev_preheat.identification.vehicle_file import learned_vehicle
    name = arguments.name
    learned = learned_vehicle(load_vehicle(arguments.vehicle), vehicle_fingerprint(start_file.read_bytes()),
                              arguments.state_file, name)
    words = ['preheat', 'identify', '--state-file', arguments.state_file, '--vehicle', arguments.vehicle,
             '--output', arguments.output]
    _write_vehicle(arguments, start_file, learned.vehicle, learned.notes, frozenset(),
                   f'Vehicle {name}, with the values that a planner learned on line, by\n    {shlex.join(words)}')
    console = result_console()
    print_records(console, f'Vehicle {name}: learned on line', ('factor', 'estimate', '90 % interval'),
                  [(label, figure(value, 4), f'{figure(low, 4)} … {figure(high, 4)}')
                   for label, value, low, high in learned.rows], ('left', 'right', 'right'))
    console.say(f'written: {arguments.output}')
    return 0


def _write_vehicle(arguments: Namespace, start_file: Path, vehicle: Vehicle, notes: Mapping[str, str],
                   keys: frozenset[str], head: str) -> None:
    """Write the vehicle file, and load it as a check."""
    from bev_preheat.identification.vehicle_file import identified_text
    printable = ''.join(letter if letter.isprintable() or letter == '\n' else ' ' for letter in head)
    write_whole(arguments.output, identified_text(
        load_checked_yaml(start_file, SCHEMA), vehicle, notes, keys, printable))
    load_vehicle(Path(arguments.output).resolve())


def _write_identified(arguments: Namespace, result: Identification, start_file: Path) -> None:
    from bev_preheat.identification.vehicle_file import identified_keys, notes_of
    words = ['preheat', 'identify', *arguments.logs, '--vehicle', arguments.vehicle, '--output', arguments.output]
    tested = (f'Arrival temperature of trips that the fit has not seen: RMSE {result.rmse_k:.2f} K, worst '
              f'{result.worst_k:.2f} K.' if result.left_out else 'No trip that the fit has not seen tests it.')
    _write_vehicle(arguments, start_file, result.vehicle, notes_of(result), identified_keys(result),
                   f'Vehicle {result.vehicle.name}, identified from {_logs(result)} by\n'
                   f'    {shlex.join(words)}\n{tested}')


def _logs(result: Identification) -> str:
    return '1 log' if result.coverage.trips == 1 else f'{result.coverage.trips} logs'


def _print_result(console: ResultConsole, result: Identification, arguments: Namespace) -> None:
    print_records(
        console, f'Vehicle {result.vehicle.name}, identified from {_logs(result)}',
        ('parameter', 'START', 'estimate', '90 % interval', 'worth K'),
        [(f'{item.label} [{item.unit}]' if item.unit else item.label, figure(item.start, 4),
          figure(item.estimate, 4) if item.is_identified else 'not told',
          f'{figure(item.low, 4)} … {figure(item.high, 4)}',
          f'{item.arrival_k:.2f}' if item.arrival_k else '')
         for item in result.estimates], ('left', *['right'] * 4))
    rows = [(row.structure + (' (chosen)' if row.structure == result.structure else ''),
             *(('diverges', '') if row.diverges else (f'{row.rmse_k:.2f}', f'{row.worst_k:.2f}')))
            for row in (*result.structures, *result.baselines.values())]
    if result.left_out:
        print_records(console, 'Each trip left out', ('structure', 'RMSE K', 'worst K'), [
            ('identified file, as plans predict', f'{result.rmse_k:.2f}', f'{result.worst_k:.2f}'), *rows],
            ('left', 'right', 'right'))
    console.say(*result.verdict, *(f'Record next: {item}' for item in result.record_next), *result.remarks)
    console.say(f'written: {arguments.output}' + (f', {arguments.report}' if arguments.report else ''))
