# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat.demo`: a scenario of a drive to the fast charger, with the real planner, and its picture.

The installed executables `vehicle_simulator` and `planner` drive it as processes. The exit status is 0 only if the
battery arrived within GOOD_ARRIVAL_K of its target.
"""

from __future__ import annotations

from bev_preheat.commands.program import Interrupted, loading, run_program, say

if __name__ == '__main__':
    # The imports below take a second, in which Ctrl-C may come.
    loading('demo')

from argparse import Namespace
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
import math
import os
from pathlib import Path
import sys
import tempfile

from ament_index_python.packages import PackageNotFoundError
import numpy as np
from rich.progress import BarColumn, TextColumn
import yaml

from bev_preheat.charging.stop import CHARGER_RANGE_W, USUAL_DEPARTURE_SOC
from bev_preheat.commands.output import ENERGY_ROWS
from bev_preheat.commands.parser import OneLineParser
from bev_preheat.commands.terminal import print_figures, progress_bar, result_console, ResultConsole
from bev_preheat.drawing.drive_figure import AMBIENT, BATTERY, make_drive_figure, PREDICTED, UNHEATED
from bev_preheat.drawing.figure import save_figure
from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile, PICTURE_SUFFIXES
from bev_preheat.messages.fields import Figure, nanoseconds
from bev_preheat.messages.preheat_plan import charging_text, ENERGY_FIELDS
from bev_preheat.nodes.installed_drive import (
    drive_with_nodes,
    log_files,
    ObservedDrive,
    reserved_domain_id,
    ScenarioFailed,
)
from bev_preheat.nodes.simulated_drive import ARRIVED, SimulatedDriveReport
from bev_preheat.planning.explanation import duration_text
from bev_preheat.planning.planner import plan_unheated
from bev_preheat.planning.status import Status
from bev_preheat.recording.ring import recording_beside
from bev_preheat.route import route_file
from bev_preheat.simulation.scenario import load_scenario, Scenario
from bev_preheat.simulation.supervised_drive import START_NS
from bev_preheat.vehicle import vehicle_file

GOOD_ARRIVAL_K = 1.0
# Simulated time between two lines on the drive [s].
PLAIN_LINE_PERIOD_S = 300.0


def parse_arguments(arguments: Sequence[str] | None) -> Namespace:
    """Return the parsed command line."""
    parser = OneLineParser(
        prog='python -m bev_preheat.demo',
        description='A simulated drive to the fast charger, with the real planner over ROS 2.')
    parser.add_argument('--vehicle', default='reference', help='name or YAML file (%(default)s)')
    parser.add_argument('--route', default='reference', help='name, legs/NAME, CSV or YAML file (%(default)s)')
    parser.add_argument('--temperature', type=float, default=-7.0, metavar='DEGC',
                        help='battery temperature at the start [degC] (%(default)s)')
    parser.add_argument('--soc', type=float, default=0.9, metavar='0..1',
                        help='state of charge at the start (%(default)s)')
    parser.add_argument('--target', type=float, metavar='DEGC',
                        help="target battery temperature on arrival [degC] (the vehicle's own)")
    parser.add_argument('--charger-power', type=float, metavar='W',
                        help='power of the charger [W]: without --target the planner then chooses the target '
                        'itself (unknown)')
    parser.add_argument('--departure-soc', type=float, metavar='0..1',
                        help=f'state of charge at which the car leaves the charger ({USUAL_DEPARTURE_SOC:g})')
    parser.add_argument('--output', type=Path, default=Path('out/demo.png'), metavar='FILE',
                        help='the picture; the recording and the logs of the processes are written next to it '
                        '(%(default)s)')
    parsed = parser.parse_args(arguments)
    parsed.output = Path(expanded(parsed.output))
    return parsed


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration and return its exit status."""
    return run_program('demo', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parsed = parse_arguments(arguments)
    _check_charger(parsed)
    output = parsed.output
    others = [OutputFile('--output', path, make_folder=True)
              for path in (recording_beside(output), *log_files(output.stem, output.parent))]
    check_outputs([OutputFile('--output', output, PICTURE_SUFFIXES, make_folder=True), *others],
                  [vehicle_file(parsed.vehicle), route_file(parsed.route)])
    folder = tempfile.TemporaryDirectory()
    path = Path(folder.name, 'demo.yaml')
    scenario = _scenario(parsed, path)
    for warning in scenario.warnings:
        say(f'demo: warning: {warning}')

    def run() -> int:
        with folder:
            return _run(parsed, scenario, path)
    return run


def _check_charger(parsed: Namespace) -> None:
    if parsed.departure_soc is not None and parsed.charger_power is None:
        raise InvalidInput('--departure-soc: needs --charger-power')
    for option, value, allowed in (('--charger-power', parsed.charger_power, Figure(*CHARGER_RANGE_W, 'W')),
                                   ('--departure-soc', parsed.departure_soc, Figure(0.0, 1.0))):
        if value is not None and (problem := allowed.problem(option, value)):
            raise InvalidInput(problem)


def _scenario(parsed: Namespace, path: Path) -> Scenario:
    """Write the scenario file of the arguments and return it; raises InvalidInput if a value is not allowed."""
    values = {'charger_power_w': parsed.charger_power, 'charging_departure_soc': parsed.departure_soc}
    given = {key: value for key, value in values.items() if value is not None}
    if parsed.target is not None or parsed.charger_power is not None:
        # Null: the planner chooses it for the charger.
        given['target_battery_temperature_c'] = parsed.target
    path.write_text(yaml.safe_dump({
        'name': parsed.output.stem, 'description': 'A drive to the fast charger.',
        'drive': {'vehicle': _from_anywhere(parsed.vehicle), 'route': _from_anywhere(parsed.route),
                  'initial_battery_temperature_c': parsed.temperature, 'initial_soc': parsed.soc, **given},
        'expect': {'arrival_error_k': [-GOOD_ARRIVAL_K, GOOD_ARRIVAL_K]}}), encoding='utf-8')
    try:
        return load_scenario(path)
    except InvalidInput as error:
        raise InvalidInput([problem.removeprefix(f'{path}: ') for problem in error.problems]) from error


def _from_anywhere(name_or_file: str) -> str:
    """Return a name as it is, a file with its whole path."""
    path = expanded(name_or_file)
    return os.path.abspath(path) if os.path.isfile(path) and ('/' in path or Path(path).suffix) else name_or_file


def _run(parsed: Namespace, scenario: Scenario, path: Path) -> int:
    console = result_console()
    try:
        good, sentence = _drive(parsed, scenario, path, console)
    except (ScenarioFailed, InvalidInput) as error:
        good, sentence = False, str(error)
    except OSError as error:
        good, sentence = False, f'{error.filename}: {error.strerror}'
    except PackageNotFoundError:
        good, sentence = False, 'the package is not built; run: make build'
    except Interrupted as interruption:
        interruption.kept = ('; vehicle_simulator and planner have ended; their logs are in '
                             f'{parsed.output.parent}')
        raise
    console.say(f'demo: {"good" if good else "failed"}: {sentence}', style='green' if good
                else 'red')
    return 0 if good else 1


def _drive(parsed: Namespace, scenario: Scenario, path: Path, console: ResultConsole) -> tuple[bool, str]:
    """Drive the Scenario of a file, draw and sum up; return (whether it succeeded, a sentence)."""
    output = parsed.output
    output.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        domain_id = int(os.environ.get('ROS_DOMAIN_ID') or stack.enter_context(reserved_domain_id()))
        console.say(f'Vehicle {parsed.vehicle} on route {parsed.route}, in lockstep, ROS domain {domain_id}.')
        bar = stack.enter_context(progress_bar(TextColumn('{task.description}'), BarColumn()))
        task, lines = bar.add_task('starting', total=scenario.first.route.total_duration_s), _Lines(console)

        def observe(drive: ObservedDrive) -> None:
            lines.show(drive)
            bar.update(task, description=_now(drive), completed=drive.states[-1][0] if drive.states else 0.0)

        drive = drive_with_nodes(scenario, str(path), output.parent, recording_beside(output),
                                 domain_id, observe, heater_status=True)
    if drive.first_plan is None:
        raise ScenarioFailed('the vehicle stopped before the planner had a plan')
    print_figures(console, 'The drive', ('', 'planned at the start', 'actual'), summary_rows(drive))
    if drive.charging_plan is not None:
        console.say(f'At the charger, as predicted on the way: {charging_text(drive.charging_plan)}. '
                    f'{drive.charging_plan.target_reason}')
    _draw(parsed, scenario, drive)
    console.say(f'Picture: {output}')
    if drive.recording is not None:
        console.say(f'Recording: {drive.recording}; the drive as a page, to ask why and what if: '
                    f'preheat replay {drive.recording} --report drive.html')
    return verdict(drive)


class _Lines:
    """A line for each change of status, and one every few simulated minutes."""

    def __init__(self, console: ResultConsole) -> None:
        self._console, self._next_s = console, 0.0
        self._status: Status | None = None

    def show(self, drive: ObservedDrive) -> None:
        if not (drive.states and drive.record.commands and drive.plan is not None):
            return
        status, time_s = Status(drive.plan.status), drive.states[-1][0]
        if status is not self._status:
            self._console.say(f'{duration_text(time_s):>11}  {status.name}: {drive.plan.explanation}')
        elif time_s < self._next_s:
            return
        self._status = status
        self._next_s = (time_s // PLAIN_LINE_PERIOD_S + 1.0) * PLAIN_LINE_PERIOD_S
        self._console.say(f'{duration_text(time_s):>11}  {_now(drive)}')


def _now(drive: ObservedDrive) -> str:
    if not (drive.states and drive.record.commands and drive.predictions):
        return 'waiting for the simulated vehicle and the planner'
    _, temperature_c, soc = drive.states[-1]
    return (f'battery {temperature_c:5.1f} degC  state of charge {100.0 * soc:.1f} %  heater '
            f'{drive.record.commands[-1][1]:4.0f} W  arrival at {drive.predictions[-1][1]:.1f} degC')


def summary_rows(drive: ObservedDrive) -> list[tuple[str, str, str]]:
    """Return rows of a table: the first plan and the actual drive."""
    plan, report = drive.first_plan, _report(drive)
    switched_on_s = drive.record.switched_on_s
    planned_s = (nanoseconds(plan.heating_start) - START_NS) * 1e-9 if plan.heating_planned else None
    _, temperature_c, soc = drive.states[-1]
    rows = [
        ('Heating starts', _instant_text(planned_s), _instant_text(next(iter(switched_on_s), None))),
        ('Heater switched on [times]', str(int(plan.heating_planned)), str(len(switched_on_s))),
        ('No valid command [s]', '0.0', f'{report.without_command_s:.1f}'),
        ('Arrival temperature [degC]', f'{plan.predicted_arrival_temperature:.2f}', f'{temperature_c:.2f}'),
        ('Target [degC]', f'{plan.target_battery_temperature:.2f}', f'{drive.target_c:.2f}'),
        ('Arrival state of charge [%]', f'{100 * plan.predicted_arrival_soc:.2f}', f'{100 * soc:.2f}')]
    return rows + [(heading, f'{getattr(plan, ENERGY_FIELDS[field]):.1f}',
                    f'{getattr(report.energy_wh, field):.1f}') for heading, field in ENERGY_ROWS]


def _instant_text(instant_s: float | None) -> str:
    return 'never' if instant_s is None else f'after {duration_text(max(0.0, instant_s))}'


def _report(drive: ObservedDrive) -> SimulatedDriveReport:
    if drive.report is None:
        raise ScenarioFailed('the simulated vehicle did not report its drive')
    return drive.report


def verdict(drive: ObservedDrive) -> tuple[bool, str]:
    """
    Return (whether the drive is good, a sentence).

    It is if the battery arrived within GOOD_ARRIVAL_K of its target under valid commands all the way.
    """
    report, target_c = _report(drive), drive.target_c
    time_s, temperature_c, _ = drive.states[-1]
    if report.state != ARRIVED:
        return False, f'{report.state} after {duration_text(time_s)}: no arrival.'
    if math.isnan(target_c):
        return False, 'the planner never had a target.'
    error_k = temperature_c - target_c
    sentence = (f'the battery arrived at {temperature_c:.2f} degC, {abs(error_k):.2f} K '
                f'{"above" if error_k > 0.0 else "below"} its target of {target_c:.1f} degC')
    if report.without_command_s > 0.0:
        return False, (f'{sentence}, but no command was valid for {report.without_command_s:.1f} s of the drive: '
                       'the planner sent none.')
    if abs(error_k) <= GOOD_ARRIVAL_K:
        return True, f'{sentence}.'
    return False, (f'{sentence}; at most {GOOD_ARRIVAL_K:g} K is good. Planned at the start: '
                   f'{drive.first_plan.explanation}')


def _draw(parsed: Namespace, scenario: Scenario, drive: ObservedDrive) -> None:
    target_c, route = drive.target_c, scenario.first.route
    goal = replace(scenario.first.goal, target_temperature_c=target_c)
    unheated = plan_unheated(scenario.vehicle, route, scenario.state, goal)
    times_s, temperatures_c, socs = np.array(drive.states).T
    save_figure(make_drive_figure(
        f'vehicle {parsed.vehicle}, route {parsed.route}: arrival at {temperatures_c[-1]:.1f} °C, '
        f'target {target_c:.1f} °C',
        {BATTERY: (times_s, temperatures_c), UNHEATED: (unheated.time_s, unheated.battery_temperature_c),
         PREDICTED: tuple(np.array(drive.predictions).T),
         AMBIENT: (route.time_s, np.append(route.ambient_temperature_c, route.ambient_temperature_c[-1]))},
        tuple(np.array([(instant_s, power_w) for instant_s, power_w, _ in drive.record.commands]).T), target_c,
        {BATTERY: (times_s, socs), UNHEATED: (unheated.time_s, unheated.soc)}), parsed.output)


if __name__ == '__main__':
    sys.exit(main())
