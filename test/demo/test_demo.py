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
def test_a_drive_to_a_known_charger_tells_the_session(start_demo):
    demo = start_demo('--temperature', '2', '--soc', '0.4', '--charger-power', '1000')
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode in (0, 1), output
    assert "The target is the vehicle's default: This charger cannot charge" in output
    demo = start_demo('--temperature', '2', '--soc', '0.4', '--charger-power', '50000')
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == 0, output
    assert 'NOT_WORTH_IT: ' in output and 'At the charger, as predicted on the way: ' in output


# test/commands and test/nodes/test_process.py interrupt programs daily.
@pytest.mark.deep
@pytest.mark.parametrize('number, status, told', [
    (signal.SIGINT, 130, 'demo: interrupted'), (signal.SIGTERM, 130, 'demo: interrupted'),
    (None, 1, 'demo: failed: planner ended with exit status -9')], ids=['SIGINT', 'SIGTERM', 'planner killed'])
def test_interruption_and_the_death_of_a_process_end_everything(start_demo, number, status, told):
    demo = start_demo()
    wait_for_line(demo, 'battery')
    processes = psutil.Process(demo.pid).children()
    assert len(processes) == 2
    if number is None:
        planner, = (process for process in processes
                    if any(part.endswith('/planner') for part in process.cmdline()))
        planner.kill()
    else:
        demo.send_signal(number)
    output, _ = demo.communicate(timeout=TIME_LIMIT_S)
    assert demo.returncode == status, output
    assert told in output and 'Traceback' not in output
    assert psutil.wait_procs(processes, timeout=TIME_LIMIT_S)[1] == []


@pytest.mark.parametrize('arrival_c, without_s, is_good, sentence', [
    (25.9, 0.0, True, '25.90 degC, 0.90 K above its target of 25.0 degC.'),
    (24.1, 0.0, True, '24.10 degC, 0.90 K below its target of 25.0 degC.'),
    (23.9, 0.0, False, '23.90 degC, 1.10 K below its target of 25.0 degC; at most 1 K is good. Planned at the '
     'start: Heating all the way is not enough.'),
    (25.0, 2.5, False, '25.00 degC, 0.00 K below its target of 25.0 degC, but no command was valid for 2.5 s of '
     'the drive: the planner sent none.')],
    ids=['a little too warm', 'a little too cold', 'far too cold', 'commands lost'])
def test_a_good_drive_arrives_within_1_k_under_valid_commands(arrival_c, without_s, is_good, sentence):
    report = SimulatedDriveReport(ARRIVED, Energies(*[0.0] * len(fields(Energies))), without_s)
    drive = SimpleNamespace(states=[(240.0, arrival_c, 0.6)], target_c=25.0, report=report,
                            first_plan=SimpleNamespace(explanation='Heating all the way is not enough.'))
    assert verdict(drive) == (is_good, f'the battery arrived at {sentence}')


@pytest.mark.parametrize('arguments, problem', [
    (['--vehicle', 'bicycle'], "vehicle 'bicycle' is unknown; known:"),
    (['--charger-power', '150'], '--charger-power: 150 is not allowed; it must be 1000 ... 2000000 W\n'),
    (['--charger-power', 'nan'], '--charger-power: nan is not allowed; it must be 1000 ... 2000000 W\n'),
    (['--departure-soc', '0.8'], '--departure-soc: needs --charger-power\n'),
    (['--charger-power', '5e4', '--departure-soc', '80'],
     '--departure-soc: 80 is not allowed; it must be 0 ... 1\n'),
    (['--output', 'demo.bmp'], '--output: demo.bmp: must end in .png or .svg or .pdf\n')])
def test_what_cannot_be_driven_or_drawn_is_refused_before_the_drive(tmp_path, capsys, arguments, problem):
    assert main(['--output', str(tmp_path / 'demo.png'), *arguments]) == 2
    assert capsys.readouterr().err.startswith(f'demo: error: {problem}')
