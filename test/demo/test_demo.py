# SPDX-License-Identifier: Apache-2.0
"""`python -m bev_preheat.demo`, as a user runs it."""

from dataclasses import fields
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

from package_groups import environment_of
import psutil
import pytest

from bev_preheat.commands.main import main as preheat
from bev_preheat.demo import main, verdict
from bev_preheat.nodes.simulated_drive import ARRIVED, SimulatedDriveReport
from bev_preheat.planning.dynamics import Energies

ROUTE = """# four minutes
duration_s,speed_mps,propulsion_power_w,ambient_temperature_c
150,15,18000,-5
90,21,26000,-6
"""
TIME_LIMIT_S = 240.0


@pytest.fixture
def start_demo(dds, tmp_path):
    """Start a demonstration of four minutes; returns the process, with its output as text at stdout."""
    route = tmp_path / 'four_minutes.csv'
    route.write_text(ROUTE)
    # Its processes see only the packages that make demo installs.
    (site := tmp_path / 'site').mkdir()
    environment = {**{name: value for name, value in os.environ.items() if name != 'ROS_DOMAIN_ID'},
                   **environment_of(site, 'demo')}
    demos = []

    def start_demo(*arguments):
        demos.append(subprocess.Popen(
            [sys.executable, '-u', '-m', 'bev_preheat.demo', '--route', str(route), '--output',
             str(tmp_path / 'pictures' / 'demo.png'), *arguments],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment))
        return demos[-1]

    yield start_demo
    for demo in demos:
        if demo.poll() is None:
            demo.send_signal(signal.SIGINT)
            demo.wait(TIME_LIMIT_S)


def wait_for_line(demo, text):
    said = []
    for line in demo.stdout:
        said.append(line)
        if text in line and not line.startswith('demo: '):
            return
    pytest.fail(f'the demonstration ended before it said {text!r}: {"".join(said)}')


def test_good_drive_ends_with_table_and_picture(start_demo, tmp_path, capsys):
    demo = start_demo('--temperature', '2', '--target', '4')
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 0, output
    assert 'demo: good: the battery arrived at' in output
    # On such a short drive waiting gains nothing: it heats at once, until the target is certain.
    for word in ('HEATING', 'NOT_NEEDED', 'Heating starts', 'Arrival temperature [degC]',
                 'Joule heat [Wh]', 'planned at the start', 'actual'):
        assert word in output
    picture = (tmp_path / 'pictures' / 'demo.png').read_bytes()
    assert picture.startswith(b'\x89PNG') and len(picture) > 20_000
    recording = tmp_path / 'pictures' / 'demo.mcap'
    assert f'preheat replay {recording} --report' in output
    assert preheat(['replay', str(recording)]) == 0
    assert 'reproduced: ' in capsys.readouterr().out
    # The folder that the planner recorded into is gone.
    assert sorted(path.name for path in (tmp_path / 'pictures').iterdir()) == [
        'demo.mcap', 'demo.planner.log', 'demo.png', 'demo.vehicle_simulator.log']


@pytest.mark.deep
def test_missed_target_is_a_failure(start_demo):
    demo = start_demo()
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 1, output
    assert 'demo: failed: the battery arrived at' in output
    assert 'below its target of 25.0 degC; at most 1 K is good' in output
    assert 'Heating all the way is not enough' in output


@pytest.mark.deep
def test_a_drive_to_a_known_charger_tells_the_session(start_demo):
    demo = start_demo('--temperature', '2', '--soc', '0.4', '--charger-power', '1000')
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode in (0, 1), output
    assert "The target is the vehicle's default: This charger cannot charge" in output
    demo = start_demo('--temperature', '2', '--soc', '0.4', '--charger-power', '50000')
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 0, output
    assert 'NOT_WORTH_IT: ' in output and 'At the charger, as predicted on the way: ' in output


@pytest.mark.deep
def test_death_of_a_process_is_told_and_ends_the_others(start_demo):
    demo = start_demo()
    wait_for_line(demo, 'battery')
    processes = psutil.Process(demo.pid).children()
    planner = next(process for process in processes
                   if any(part.endswith('/planner') for part in process.cmdline()))
    planner.kill()
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 1, output
    assert 'demo: failed: planner ended with exit status -9' in output
    assert psutil.wait_procs(processes, timeout=TIME_LIMIT_S)[1] == []


# test/commands and test/nodes/test_process.py interrupt programs daily.
@pytest.mark.deep
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interruption_ends_everything(start_demo, number):
    demo = start_demo()
    wait_for_line(demo, 'battery')
    processes = psutil.Process(demo.pid).children()
    assert len(processes) == 2
    demo.send_signal(number)
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 130, output
    assert 'demo: interrupted' in output
    assert 'Traceback' not in output
    assert psutil.wait_procs(processes, timeout=TIME_LIMIT_S)[1] == []


@pytest.mark.parametrize('without_s, cause', [
    (0.0, ''), (2.5, 'no command was valid for 2.5 s of the drive: the planner sent none')])
def test_a_drive_with_lost_commands_is_not_good_and_tells_the_cause(without_s, cause):
    report = SimulatedDriveReport(ARRIVED, Energies(*[0.0] * len(fields(Energies))), without_s)
    drive = SimpleNamespace(states=[(240.0, 25.01, 0.6)], target_c=25.0, report=report)
    good, sentence = verdict(drive)
    assert good == (without_s == 0.0)
    assert 'the battery arrived at 25.01 degC, 0.01 K above' in sentence and cause in sentence


def test_refused_parameter_is_told(tmp_path, capsys):
    assert main(['--vehicle', 'bicycle', '--output', str(tmp_path / 'demo.png')]) == 2
    assert capsys.readouterr().err.startswith(
        "demo: error: vehicle 'bicycle' is unknown; known:")


@pytest.mark.parametrize('arguments, problem', [
    (['--charger-power', '150'], '--charger-power: 150 is not allowed; it must be 1000 ... 2000000 W'),
    (['--charger-power', 'nan'], '--charger-power: nan is not allowed; it must be 1000 ... 2000000 W'),
    (['--departure-soc', '0.8'], '--departure-soc: needs --charger-power'),
    (['--charger-power', '5e4', '--departure-soc', '80'],
     '--departure-soc: 80 is not allowed; it must be 0 ... 1')])
def test_a_bad_charger_is_refused_before_the_drive(tmp_path, capsys, arguments, problem):
    assert main([*arguments, '--output', str(tmp_path / 'demo.png')]) == 2
    assert capsys.readouterr().err == f'demo: error: {problem}\n'


def test_picture_that_cannot_be_drawn_is_refused_before_the_drive(capsys):
    assert main(['--output', 'demo.bmp']) == 2
    assert capsys.readouterr().err == \
        'demo: error: --output: demo.bmp: must end in .png or .svg or .pdf\n'
