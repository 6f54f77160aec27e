# SPDX-License-Identifier: Apache-2.0
"""`preheat monitor` beside the installed planner."""

import os
import re
import subprocess
import sys

from planner_car import PlannerCar
import pytest

from bev_preheat.commands.main import main

# Process start, discovery and a first page, on a busy computer.
LIMIT_S = 240.0


def test_once_shows_temperature_plan_command_and_reserve_also_as_picture(bench, tmp_path):
    picture, car = tmp_path / 'monitor.svg', PlannerCar(bench, '/car')
    car.send_route()
    car.start('-r', '__ns:=/car', '-p', 'battery_state_timeout:=60.0')
    with car.feeding():
        car.wait_for_heat()
        done = subprocess.run(
            [sys.executable, '-m', 'bev_preheat', 'monitor', '--namespace', '/car', '--once',
             '--picture', str(picture)],
            text=True, capture_output=True, timeout=LIMIT_S, env={**os.environ, 'COLUMNS': '100'})
    text = done.stdout
    assert done.returncode == 0, text + done.stderr
    for part in ('-7.0', '25.0', 'TARGET_UNREACHABLE', 'Heating all the way is not enough',
                 '/car/planner', 'State of charge  80.0 %', 'on; ends in', 'signals'):
        assert part in text, text
    # Each topic was heard; its age depends on the computer.
    age = r' \d+\.\d s +'
    assert re.search(age.join(('Heard: battery', 'command', 'plan', 'diagnostics', '')), text), text
    assert picture.read_text().startswith('<svg')


@pytest.mark.parametrize('arguments, problem', [
    (('--seconds', '-1'), '--seconds: -1 is not allowed'), (('--picture', 'x.png'), 'end in .svg'),
    (('--namespace', 'a b'), "--namespace: 'a b'")])
def test_wrong_arguments_are_refused(ros, capsys, arguments, problem):
    assert main(['monitor', *arguments]) == 2
    assert problem in capsys.readouterr().err
