# SPDX-License-Identifier: Apache-2.0
"""
`python -m bev_preheat.demo`: a simulated drive to the fast charger, with the real planner.

Starts the installed executables `vehicle_simulator` and `planner` as processes, follows their
topics, and ends with a table and a picture. The exit status is 0 only if the battery arrived
within GOOD_ARRIVAL_K of its target.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.console.program import Interrupted, loading, run_program, say

if __name__ == '__main__':
    # The imports below take a second, in which Ctrl-C may come.
    loading('demo')

from contextlib import ExitStack
import os
from pathlib import Path
import sys
import time

from ament_index_python.packages import PackageNotFoundError

from bev_preheat.charging.stop import CHARGER_RANGE_W, USUAL_DEPARTURE_SOC
from bev_preheat.console.parser import OneLineParser
from bev_preheat.console.terminal import print_figures, result_console
from bev_preheat.demo.display import charging_sentence, shown, summary_rows, verdict
from bev_preheat.demo.observer import Observer
from bev_preheat.drawing.demo_figure import draw_drive
from bev_preheat.errors import figure, figure_beyond, InvalidInput
from bev_preheat.files.output_files import check_outputs, expanded, OutputFile, PICTURE_SUFFIXES
from bev_preheat.nodes.listening import listening
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.route import route_for
from bev_preheat.simulation.supervised_drive import START_NS
from bev_preheat.simulator.installed_processes import NodeProcess, reserved_domain_id
from bev_preheat.simulator.kept_recording import KeptRecording, recording_beside
from bev_preheat.vehicle import load_vehicle, vehicle_file

if TYPE_CHECKING:
    from argparse import Namespace
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from rich.console import Console

    from bev_preheat.demo.observer import ObservedDrive
    from bev_preheat.files.output_files import AnyPath
    from bev_preheat.nodes.listening import Listener

GOOD_ARRIVAL_K = 1.0
# Limits of real time for the processes to find each other, and between two battery states [s]. The end of a
# process is noticed at once; these waits may take a minute on a busy computer.
DEMO_START_LIMIT_S = 180.0
DEMO_SILENCE_LIMIT_S = 90.0
DISPLAY_PERIOD_S = 0.2
# Stands for a target of 0 degC, because 0 means the default.
LEAST_TARGET_C = 1e-3
LOG_LINES_SHOWN = 8


class DemoFailed(Exception):
    """The drive could not be completed; the message gives the reason."""


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
    parser.add_argument('--speed-up', type=float, metavar='N',
                        help='simulated seconds per real second, 1 ... 1000; commands then arrive with the delays '
                        'of this computer (in lockstep, the same drive on every computer)')
    parser.add_argument('--output', type=Path, default=Path('out/demo.png'), metavar='FILE',
                        help='the picture; the recording and the logs of the processes are written next to it '
                        '(%(default)s)')
    parsed = parser.parse_args(arguments)
    parsed.output = Path(expanded(parsed.output))
    return parsed


def check_files(parsed: Namespace) -> str | None:
    """
    Return a warning about the route, or None.

    Raises InvalidInput if an input is missing or wrong or an output cannot be written.
    """
    route = route_for(parsed.route, load_vehicle(parsed.vehicle))
    logs = [OutputFile('--output', log_file(parsed.output, name), make_folder=True)
            for name in ('planner', 'vehicle_simulator')]
    check_outputs([OutputFile('--output', parsed.output, PICTURE_SUFFIXES, make_folder=True),
                   OutputFile('--output', recording_beside(parsed.output), make_folder=True), *logs],
                  [vehicle_file(parsed.vehicle), route.file])
    return route.warning


def log_file(output: AnyPath, name: str) -> str:
    """Return the path of a process's log, next to the picture."""
    return f'{os.path.splitext(output)[0]}.{name}.log'


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the demonstration and return its exit status."""
    return run_program('demo', lambda: _load(arguments), ends_process=arguments is None)


def _load(arguments: Sequence[str] | None) -> Callable[[], int]:
    parsed = parse_arguments(arguments)
    if parsed.speed_up is not None and not 1.0 <= parsed.speed_up <= 1000.0:
        raise InvalidInput(f'--speed-up: {parsed.speed_up:g} is not allowed; it must be 1 ... 1000')
    _check_charger(parsed)
    warning = check_files(parsed)
    if warning:
        say(f'demo: warning: {warning}')
    return lambda: _drive(parsed)


def _check_charger(parsed: Namespace) -> None:
    low_w, high_w = CHARGER_RANGE_W
    if parsed.charger_power is not None and not low_w <= parsed.charger_power <= high_w:
        raise InvalidInput(f'--charger-power: {figure_beyond(parsed.charger_power, low_w, high_w)} is not '
                           f'allowed; it must be {figure(low_w)} ... {figure(high_w)} W')
    if parsed.departure_soc is None:
        return
    if parsed.charger_power is None:
        raise InvalidInput('--departure-soc: needs --charger-power')
    if not 0.0 < parsed.departure_soc <= 1.0:
        raise InvalidInput(f'--departure-soc: {parsed.departure_soc:g} is not allowed; it must be above 0 '
                           'and at most 1')


def _drive(parsed: Namespace) -> int:
    console = result_console()
    try:
        good, sentence = run(parsed, console)
    except (DemoFailed, InvalidInput) as error:
        good, sentence = False, str(error)
    except OSError as error:
        good, sentence = False, f'{error.filename}: {error.strerror}'
    except PackageNotFoundError:
        good, sentence = False, 'the package is not built; run: make build'
    except Interrupted as interruption:
        interruption.kept = ('; vehicle_simulator and planner have ended; their logs are in '
                             f'{parsed.output.parent}')
        raise
    console.print(f'demo: {"good" if good else "failed"}: {sentence}', style='green' if good
                  else 'red', markup=False, soft_wrap=True)
    return 0 if good else 1


def run(parsed: Namespace, console: Console) -> tuple[bool, str]:
    """Drive, draw and sum up; return (whether it succeeded, a sentence)."""
    parsed.output.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        if 'ROS_DOMAIN_ID' not in os.environ:
            os.environ['ROS_DOMAIN_ID'] = str(stack.enter_context(reserved_domain_id()))
        pace = 'in lockstep' if parsed.speed_up is None else f'{parsed.speed_up:g} times real time'
        console.print(f'Vehicle {parsed.vehicle} on route {parsed.route}, {pace}, '
                      f'ROS domain {os.environ["ROS_DOMAIN_ID"]}.', markup=False, soft_wrap=True)
        listener = stack.enter_context(listening('demo'))
        observer = Observer(listener.node)
        drive = observer.drive
        # The vehicle comes last, when all observers of its start are ready.
        recording = KeptRecording(recording_beside(parsed.output))
        planner = _start(stack, parsed, 'planner', {**_planner_parameters(parsed), **recording.parameters(stack)})
        _wait_for_planner(listener, observer, planner)
        simulator = _start(stack, parsed, 'vehicle_simulator', _simulator_parameters(parsed))
        with shown(drive, console) as show:
            _follow(listener, drive, simulator, planner, show)
        for process in (simulator, planner):
            if process.end() != 0:
                raise DemoFailed(_ended(process))
        recorded = recording.keep()
    if drive.first_plan is None:
        raise DemoFailed('the vehicle stopped before the planner had a plan')
    print_figures(console, 'The drive', *summary_rows(drive))
    charging = charging_sentence(drive)
    if charging:
        console.print(charging, markup=False, soft_wrap=True)
    good, sentence = verdict(drive, GOOD_ARRIVAL_K, parsed.speed_up)
    draw_drive(parsed.output, drive, load_vehicle(parsed.vehicle),
               f'vehicle {parsed.vehicle}, route {parsed.route}: arrival at '
               f'{drive.states[-1][1]:.1f} °C, target {drive.target_c:.1f} °C')
    console.print(f'Picture: {parsed.output}', markup=False, soft_wrap=True)
    if recorded is not None:
        console.print(f'Recording: {recorded}; the drive as a page, to ask why and what if: '
                      f'preheat replay {recorded} --report drive.html', markup=False, soft_wrap=True)
    return good, sentence


def _simulator_parameters(parsed: Namespace) -> dict[str, Any]:
    parameters = {
        'vehicle': parsed.vehicle,
        'route': parsed.route,
        'initial_battery_temperature': parsed.temperature,
        'initial_soc': parsed.soc,
        # So that two drives can be compared.
        'start_time': START_NS / NS_PER_S,
        **({'lockstep': 'true'} if parsed.speed_up is None else {
            'speed_up': parsed.speed_up, 'wait_for_planner': 'true'}),
        # Wait for the planner and this observer.
        'wait_for_listeners': 2,
        'exit_on_arrival': 'true',
        # So that the recording has the delivered power too.
        'heater_status': 'true',
    }
    if parsed.charger_power is not None:
        parameters['charger_power'] = parsed.charger_power
        parameters['charging_departure_soc'] = (
            USUAL_DEPARTURE_SOC if parsed.departure_soc is None else parsed.departure_soc)
    if parsed.target is not None:
        # In the parameter 0 means no target.
        parameters['target_battery_temperature'] = parsed.target or LEAST_TARGET_C
    return parameters


def _planner_parameters(parsed: Namespace) -> dict[str, Any]:
    return {'vehicle': parsed.vehicle, 'use_sim_time': 'true'}


def _start(stack: ExitStack, parsed: Namespace, name: str,
           parameters: Mapping[str, Any]) -> NodeProcess:
    ros_arguments = []
    for key, value in parameters.items():
        ros_arguments += ['-p', f'{key}:={value}']
    return stack.enter_context(
        NodeProcess(name, ros_arguments, log_file(parsed.output, name)))


def _wait_for_planner(listener: Listener, observer: Observer, planner: NodeProcess) -> None:
    limit_s = time.monotonic() + DEMO_START_LIMIT_S
    while not observer.hears_planner:
        if planner.exit_status is not None:
            raise DemoFailed(_ended(planner))
        if time.monotonic() > limit_s:
            raise DemoFailed(f'no planner within {DEMO_START_LIMIT_S:g} s. {_last_lines(planner)}')
        listener.listen(DISPLAY_PERIOD_S)


def _follow(listener: Listener, drive: ObservedDrive, simulator: NodeProcess, planner: NodeProcess,
            show: Callable[[], object]) -> None:
    """Return when the simulator has ended its drive; raise DemoFailed if that cannot happen any more."""
    limit_s = time.monotonic() + DEMO_START_LIMIT_S
    while simulator.exit_status is None:
        if planner.exit_status is not None:
            raise DemoFailed(_ended(planner))
        now_s = time.monotonic()
        if drive.plan is None and now_s > limit_s:
            raise DemoFailed(f'no plan within {DEMO_START_LIMIT_S:g} s. '
                             + '\n'.join(map(_last_lines, (simulator, planner))))
        if drive.heard_at_s is not None and now_s > drive.heard_at_s + DEMO_SILENCE_LIMIT_S:
            raise DemoFailed(f'no battery state for {DEMO_SILENCE_LIMIT_S:g} s. '
                             f'{_last_lines(simulator)}')
        show()
        listener.listen(DISPLAY_PERIOD_S)
    # Messages that were in transit at the end.
    listener.listen(DISPLAY_PERIOD_S)
    show()
    if not drive.is_over:
        raise DemoFailed(_ended(simulator))


def _ended(process: NodeProcess) -> str:
    return (f'{process.name} ended with exit status {process.exit_status}. '
            f'{_last_lines(process)}')


def _last_lines(process: NodeProcess) -> str:
    lines = process.output().splitlines()[-LOG_LINES_SHOWN:]
    return '\n  '.join([f'{process.log_file} ends with:', *lines])


if __name__ == '__main__':
    sys.exit(main())
