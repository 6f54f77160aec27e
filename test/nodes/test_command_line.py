# SPDX-License-Identifier: Apache-2.0
"""The command lines of the installed nodes: help, and one line for each error."""

import errno
import math
import os
from pathlib import Path
import subprocess

from ament_index_python.packages import get_package_prefix
import pytest
from rehearsal import CLASSES, program_of


# Other tests start the other executables.
def test_an_installed_executable_ends_with_2_and_one_line(domain_id):
    executable = Path(get_package_prefix('bev_preheat')) / 'lib' / 'bev_preheat' / 'charger_adviser'
    done = subprocess.run([executable, '--ros-args', '-p', 'vehicle:=bicycle'], text=True, capture_output=True,
                          timeout=60)
    line, = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (2, '')
    assert line.startswith("charger_adviser: error: vehicle 'bicycle' is unknown")


@pytest.mark.parametrize('name', CLASSES)
def test_help_is_printed_and_the_process_ends(call_main, name):
    done = call_main(name, '--help')
    assert (done.returncode, done.stderr) == (0, '')
    for parameter in program_of(name).parameters:
        assert f'\n  {parameter.name} (default: ' in done.stdout
    assert f'{name} --ros-args -p ' in done.stdout
    topic = 'hvch_command' if name in ('heater_controller', 'bus_gateway') else 'route_plan'
    assert topic in done.stdout and '/diagnostics' in done.stdout


PROBLEMS = {
    'unknown argument': (['--verbose'], 'unrecognized arguments: --verbose'),
    'word': (['vehicle:=small_car'], 'unrecognized arguments: vehicle:=small_car'),
    'unknown ROS argument': (['--ros-args', '--parameter', 'a'], 'unknown ROS arguments: '),
    'no value': (['--ros-args', '-p', 'vehicle'],
                 '-p vehicle: cannot be read; it must be NAME:=VALUE'),
    'name': (['--ros-args', '-r', '__node:=a-b'],
             '-r __node:=a-b: cannot be read; it must be FROM:=TO'),
    'no file': (['--ros-args', '--params-file', '/no/such.yaml'],
                f'parameter file /no/such.yaml: cannot be read: {os.strerror(errno.ENOENT)}'),
    'folder': (['--ros-args', '--params-file', '/tmp'],
               f'parameter file /tmp: cannot be read: {os.strerror(errno.EISDIR)}'),
    'level': (['--ros-args', '--log-level', 'loud'], "'--log-level loud'"),
}


# Each problem with one node, and one problem with each: all nodes read their arguments in one place.
@pytest.mark.parametrize('name, problem', [
    *(('planner', problem) for problem in PROBLEMS),
    *((name, 'unknown argument') for name in CLASSES if name != 'planner')])
def test_what_is_wrong_is_one_line_and_2(refusal, name, problem):
    arguments, text = PROBLEMS[problem]
    assert text in refusal(name, *arguments)


FILES = {
    'no yaml': ('planner:\n  ros__parameters:\n    vehicle: [unclosed\n', 'line 3'),
    'no ros__parameters': ('planner:\n  vehicle: reference\n', 'ros__parameters at line 2'),
    'mixed list': ('planner:\n  ros__parameters:\n    vehicle: [1, two]\n', 'same type'),
}


@pytest.mark.parametrize('content, text', FILES.values(), ids=FILES)
def test_a_malformed_parameter_file_is_named(refusal, tmp_path, content, text):
    path = tmp_path / 'parameters.yaml'
    path.write_text(content)
    line = refusal('planner', '--ros-args', '--params-file', str(path))
    assert f'parameter file {path}: ' in line and text in line


# For each node a string, a boolean and an integer in place of another type.
MISTYPED = {
    'planner': {'value_of_time': ('much', 'a number, such as 10.0'), 'estimation': ('1', 'true or false'),
                'vehicle': ('2024', 'a text, such as reference'), 'state_file': ('true', 'a text'),
                'energy_price': ('-1', None)},
    'nlp_checker': {'check_period': ('often', 'a number, such as 60.0'),
                    'vehicle': ('1.5', 'a text, such as reference')},
    'charger_adviser': {'value_of_time': ('[1.0]', 'a number, such as 10.0'),
                        'vehicle': ('7', 'a text, such as reference')},
    'route_publisher': {'standing_time': ('long', 'a number, such as 0.0'),
                        'charging_planned': ('1', 'true or false'), 'vehicle': ('7', 'a text, such as reference')},
    'vehicle_simulator': {'speed_up': ('fast', 'a number, such as 1.0'), 'publish_clock': ('0', 'true or false')}}


@pytest.mark.parametrize('name', MISTYPED)
def test_all_values_of_a_wrong_type_are_one_line_and_2(refusal, name):
    given = MISTYPED[name]
    line = refusal(name, '--ros-args', *(
        word for parameter, (value, _) in given.items() for word in ('-p', f'{parameter}:={value}')))
    for parameter, (_, allowed) in given.items():
        assert f'{parameter}: ' in line
        assert allowed is None or f'is not allowed; it must be {allowed}' in line


@pytest.mark.parametrize('name', MISTYPED)
def test_a_whole_number_is_taken_where_a_double_is_meant(refusal, name):
    """Only the vehicle is refused."""
    doubles = [item for item in program_of(name).parameters
               if isinstance(item.default, float) and not item.read_only]
    assert doubles
    words = [word for item in doubles
             for word in ('-p', f'{item.name}:={math.ceil(max(item.default, (item.limits or (0.0,))[0]))}')]
    line = refusal(name, '--ros-args', '-p', 'vehicle:=bicycle', '-p', 'command_lease:=9', *words)
    assert "vehicle 'bicycle' is unknown" in line
    assert not any(f'{item.name}: ' in line for item in doubles)
