# SPDX-License-Identifier: Apache-2.0
"""`preheat scenario`: runs drives with disturbances and compares them with their expectations."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
import os
from pathlib import Path
from typing import TYPE_CHECKING

from rich.progress import BarColumn, TaskProgressColumn, TextColumn
from rich.text import Text

from bev_preheat.commands.output import add_json_argument, json_output, write_json
from bev_preheat.commands.parser import completed_by, given_options, Subparsers
from bev_preheat.commands.program import keeping_what_is_finished
from bev_preheat.commands.situation import warn
from bev_preheat.commands.terminal import print_records, progress_bar, result_console, ResultConsole
from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile
from bev_preheat.optional_packages import require, require_ros

if TYPE_CHECKING:
    from bev_preheat.simulation.scenario import Scenario
    from bev_preheat.simulation.scenario_drive import DriveRecord, Finding


def add_parser(subparsers: Subparsers) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'scenario', help='drives with disturbances, compared with their expectations',
        description='Run scenarios with the planner, and compare each drive with its expectations. Exit status 1 '
        'if one is not met.')
    completed_by('scenarios', parser.add_argument(
        'scenarios', nargs='*', metavar='NAME|FILE',
        help='names or files (default: all of config/scenarios)'))
    parser.add_argument('--list', action='store_true', help='list the scenarios and exit')
    parser.add_argument('--nodes', action='store_true',
                        help='use the installed nodes over ROS, instead of this process without ROS')
    parser.add_argument('--logs', metavar='FOLDER', help='with --nodes: folder for their logs')
    parser.add_argument('--record', metavar='FOLDER',
                        help="folder for the planner's flight recordings, NAME.mcap, for preheat replay")
    add_json_argument(parser)
    parser.set_defaults(run=run)


def run(arguments: Namespace) -> int:
    """Run, print and write; returns 0 if all expectations are met."""
    from bev_preheat.simulation.scenario import load_scenario
    from bev_preheat.simulation.scenario_drive import evaluate_chain
    if not arguments.nodes and arguments.logs is not None:
        raise InvalidInput('--logs: only with --nodes')
    for option in given_options(arguments, ('nodes', 'json', 'record')) if arguments.list else ():
        raise InvalidInput(f'{option}: not allowed with --list')
    arguments.logs = _folder('--logs', arguments.logs)
    arguments.record = _folder('--record', arguments.record)
    if arguments.record is not None:
        require_ros()
        require('mcap')
    names = arguments.scenarios or sorted(
        path.stem for path in configuration_folder('scenarios').glob('*.yaml'))
    scenarios = [(name, load_scenario(name)) for name in names]
    warn(*(f'scenario {scenario.name}: {warning}' for _, scenario in scenarios
           for warning in scenario.warnings))
    if arguments.list:
        console = result_console()
        for _, scenario in scenarios:
            console.print(Text.assemble((scenario.name, 'bold'), f': {scenario.description}'))
        return 0
    _check_outputs(arguments, [scenario for _, scenario in scenarios])
    findings = {}
    with (keeping_what_is_finished() as ending,
          progress_bar(TextColumn('{task.description}', markup=False), BarColumn(),
                       TaskProgressColumn()) as progress):
        task = progress.add_task('', total=len(scenarios))
        for number, (name, scenario) in enumerate(scenarios):
            progress.update(task, description=scenario.name, completed=number)

            def report(time_s: float, total_s: float, number: int = number) -> None:
                progress.update(task, completed=number + time_s / total_s)

            record = _drive(arguments, name, scenario, report)
            findings[scenario.name] = evaluate_chain(
                scenario.expectations, scenario.phase_expectations, record)
    bad = [name for name, found in findings.items() if not all(item.good for item in found)]
    if findings:
        if arguments.json:
            # null: not finished.
            write_json(arguments.json, {
                **{scenario.name: None for _, scenario in scenarios},
                **{name: [vars(item) for item in found] for name, found in findings.items()}})
        console = result_console(arguments.json)
        print_findings(console, findings)
        console.say(f'{len(findings) - len(bad)} of {len(findings)} scenarios went as expected'
                    + (f'; not: {", ".join(bad)}' if bad else '') + '.')
    ending.tell(len(findings), len(scenarios), 'scenarios', (arguments.json,))
    return 1 if bad else 0


def _folder(option: str, folder: str | None) -> str | None:
    if folder is None:
        return None
    if not os.path.isdir(expanded(folder)):
        raise InvalidInput(f'{option}: {folder}: no such folder')
    return expanded(folder)


def _recording(arguments: Namespace, scenario: Scenario) -> Path | None:
    return None if arguments.record is None else Path(arguments.record, f'{scenario.name}.mcap')


def _check_outputs(arguments: Namespace, scenarios: Sequence[Scenario]) -> None:
    outputs = [json_output(arguments.json)]
    if arguments.nodes and arguments.logs is not None:
        from bev_preheat.nodes.installed_drive import log_files
        outputs += [OutputFile('--logs', path) for scenario in scenarios
                    for path in log_files(scenario.name, arguments.logs)]
    outputs += [OutputFile('--record', _recording(arguments, scenario)) for scenario in scenarios]
    check_outputs(outputs, [path for scenario in scenarios for path in scenario.files])


def _drive(arguments: Namespace, name: str, scenario: Scenario,
           report: Callable[[float, float], None]) -> DriveRecord:
    if arguments.nodes:
        from bev_preheat.nodes.installed_drive import drive_with_nodes, ScenarioFailed
        try:
            return drive_with_nodes(
                scenario, name, arguments.logs, _recording(arguments, scenario)).record
        except ScenarioFailed as error:
            raise InvalidInput(str(error)) from error

    recording = _recording(arguments, scenario)
    if recording is not None:
        from bev_preheat.nodes.recorded_scenario import drive_recorded
        return drive_recorded(scenario, recording, warn, report)
    from bev_preheat.simulation.scenario_drive import drive_scenario
    return drive_scenario(scenario, report)


def print_findings(console: ResultConsole, findings: Mapping[str, Sequence[Finding]]) -> None:
    """Print the Findings of scenarios, a dictionary by name."""
    print_records(console, 'Scenarios', ('scenario', 'what', 'expected', 'seen', ''), [
        ('' if number else name, item.what, item.expected, item.seen,
         Text('good', 'green') if item.good else Text('BAD', 'red'))
        for name, found in findings.items() for number, item in enumerate(found)])
