# SPDX-License-Identifier: Apache-2.0
"""`preheat monitor` beside the installed planner."""

import os
import subprocess
import sys
import time

from planner_car import PlannerCar
import pytest
from terminal_process import CTRL_C, TerminalProcess

from bev_preheat.commands.main import main

# Process start, discovery and a first page, on a busy computer.
LIMIT_S = 240.0


@pytest.fixture
def monitor(domain_id):
    """`monitor(*arguments)` starts one in the domain of the test."""
    started = []

    def start(*arguments):
        started.append(subprocess.Popen(
            [sys.executable, '-m', 'bev_preheat', 'monitor', *arguments], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id), 'COLUMNS': '100',
                 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def heating(bench):
    """Let the installed planner heat, in the namespace /car, with a state every 0.2 s."""
    car = PlannerCar(bench, '/car')
    car.send_route()
    car.start('-r', '__ns:=/car', '-p', 'battery_state_timeout:=60.0')
    with car.feeding():
        car.wait_for_heat()
        yield


def test_once_shows_temperature_plan_command_and_reserve_also_as_picture(
        heating, monitor, tmp_path):
    picture = tmp_path / 'monitor.svg'
    done = monitor('--namespace', '/car', '--once', '--picture', str(picture))
    text, errors = done.communicate(timeout=LIMIT_S)
    assert done.returncode == 0, text + errors
    for part in ('-7.0', '25.0', 'TARGET_UNREACHABLE', 'Heating all the way is not enough',
                 '/car/planner', 'State of charge  80.0 %', 'on; ends in', 'signals', 'diagnostics 0'):
        assert part in text, text
    assert picture.read_text().startswith('<svg')


# test/monitoring/test_monitor_terminal.py has a live view and Ctrl-C daily.
@pytest.mark.deep
def test_the_live_view_follows_the_planner_until_ctrl_c(heating):
    command = [sys.executable, '-m', 'bev_preheat', 'monitor', '--namespace', '/car']
    with TerminalProcess(command, 100, 40) as process:
        end_s = time.monotonic() + LIMIT_S
        while not ('TARGET_UNREACHABLE' in process.view and 'on; ends in' in process.view):
            process.read(0.1)
            assert process.exit_status is None and time.monotonic() < end_s, process.view
        process.type(CTRL_C)
        assert process.wait(LIMIT_S) == 0, process.tail
        assert process.has_left_terminal_as_it_was and b'Traceback' not in process.tail


@pytest.mark.deep
def test_without_a_planner_it_says_what_is_missing(monitor):
    done = monitor('--once', '--seconds', '3')
    text, errors = done.communicate(timeout=LIMIT_S)
    assert done.returncode == 1, text + errors
    assert 'Waiting for /planner in ROS domain' in text and 'there is no planner' in text


@pytest.mark.parametrize('arguments, problem', [
    (('--seconds', '-1'), '--seconds: -1 is not allowed'), (('--picture', 'x.png'), 'end in .svg'),
    (('--namespace', 'a b'), "--namespace: 'a b'")])
def test_wrong_arguments_are_refused(ros, capsys, arguments, problem):
    assert main(['monitor', *arguments]) == 2
    assert problem in capsys.readouterr().err
