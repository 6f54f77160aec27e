# SPDX-License-Identifier: Apache-2.0
"""`preheat scenario`: drives in which something is wrong, and whether they go as expected."""

import os

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
from rich.table import Table

from bev_preheat.commands.output import write_json
from bev_preheat.configuration import configuration_folder
from bev_preheat.errors import InvalidInput
from bev_preheat.output_files import check_outputs, expanded, Output

DEFAULT_SPEED_UP = 60.0


def add_parser(subparsers):
    """Add the subcommand."""
    parser = subparsers.add_parser(
        'scenario', help='drives in which something is wrong, and whether they go as expected',
        description='Drives scenarios (config/scenarios) with the planner, and holds what happened '
        'against what each expects. Exit status 1 where one does not go as expected.')
    parser.add_argument('scenarios', nargs='*', metavar='NAME|FILE',
                        help='which ones (default: all of config/scenarios)')
    parser.add_argument('--list', action='store_true', help='list what there is, and end')
    parser.add_argument('--nodes', action='store_true',
                        help='with the installed planner and vehicle_simulator over ROS, not '
                        'without ROS in this process')
    parser.add_argument('--speed-up', type=float, default=DEFAULT_SPEED_UP, metavar='N',
                        help='with --nodes: simulated seconds in each real second, 1 ... 1000 '
                        '(default: %(default)s)')
    parser.add_argument('--logs', metavar='FOLDER', help='with --nodes: keep their logs here')
    parser.add_argument('--json', metavar='FILE', help='write the findings as JSON')
    parser.set_defaults(run=run)


def run(arguments):
    """Drive, print, write; returns 0 where all went as expected."""
    from bev_preheat.simulation.evaluation import evaluate
    from bev_preheat.simulation.scenario import load_scenario
    if not 1.0 <= arguments.speed_up <= 1000.0:
        raise InvalidInput(f'--speed-up: {arguments.speed_up:g} is not allowed; it must be '
                           '1 ... 1000')
    if arguments.logs is not None:
        arguments.logs = expanded(arguments.logs)
        if not os.path.isdir(arguments.logs):
            raise InvalidInput(f'--logs: {arguments.logs}: no such folder')
    names = arguments.scenarios or sorted(
        path.stem for path in configuration_folder('scenarios').glob('*.yaml'))
    scenarios = [(name, load_scenario(name)) for name in names]
    console = Console(highlight=False)
    if arguments.list:
        for _, scenario in scenarios:
            console.print(f'[bold]{scenario.name}[/bold]: {scenario.description}')
        return 0
    _check_outputs(arguments, [scenario for _, scenario in scenarios])
    findings = {}
    with Progress(TextColumn('{task.description}'), BarColumn(), TaskProgressColumn(),
                  console=console, transient=True) as progress:
        task = progress.add_task('')
        for number, (name, scenario) in enumerate(scenarios):
            progress.update(task, description=scenario.name, total=len(scenarios),
                            completed=number)
            record = _drive(arguments, name, scenario,
                            lambda share, number=number: progress.update(
                                task, completed=number + share))
            findings[scenario.name] = evaluate(scenario.expectations, record)
    console.print(_table(findings))
    if arguments.json:
        write_json(arguments.json, {name: [vars(finding) for finding in found]
                                    for name, found in findings.items()})
    bad = [name for name, found in findings.items() if not all(item.good for item in found)]
    console.print(f'{len(findings) - len(bad)} of {len(findings)} scenarios went as expected'
                  + (f'; not: {", ".join(bad)}' if bad else '') + '.')
    return 1 if bad else 0


def _check_outputs(arguments, scenarios):
    outputs = [Output('--json', arguments.json)]
    if arguments.nodes and arguments.logs is not None:
        from bev_preheat.demonstration.scenario_drive import log_files
        outputs += [Output('--logs', path) for scenario in scenarios
                    for path in log_files(scenario, arguments.logs)]
    check_outputs(outputs, [path for scenario in scenarios for path in scenario.files])


def _drive(arguments, name, scenario, report):
    if arguments.nodes:
        from bev_preheat.demonstration.scenario_drive import drive_with_nodes, ScenarioFailed
        try:
            return drive_with_nodes(scenario, name, arguments.speed_up, arguments.logs)
        except ScenarioFailed as error:
            raise InvalidInput(str(error)) from error
    from bev_preheat.simulation.closed_loop import drive_scenario
    return drive_scenario(scenario, lambda time_s, total_s: report(time_s / total_s))


def _table(findings):
    table = Table(title='Scenarios')
    for heading in ('scenario', 'what', 'expected', 'seen', ''):
        table.add_column(heading)
    for name, found in findings.items():
        for number, item in enumerate(found):
            table.add_row('' if number else name, item.what, item.expected, item.seen,
                          '[green]good[/green]' if item.good else '[red]BAD[/red]',
                          end_section=number == len(found) - 1)
    return table
