# SPDX-License-Identifier: Apache-2.0
"""
The scenarios that come along: what fails in them is noticed, and the drive goes as expected.

Those in which inputs, clock or heater fail are driven by the installed executables over real DDS;
those that try the estimation, with the planner's own Supervisor.
"""

from concurrent.futures import ThreadPoolExecutor
import json
import multiprocessing
import subprocess
import sys

import pytest

from bev_preheat.configuration import configuration_folder
from bev_preheat.simulation.closed_loop import drive_scenario
from bev_preheat.simulation.evaluation import evaluate
from bev_preheat.simulation.scenario import load_scenario

ALL = {path.stem for path in configuration_folder('scenarios').glob('*.yaml')}
WITHOUT_ROS = {'ahead_of_plan', 'detour', 'early_arrival', 'fast_battery_state', 'heavy_cold_car',
               'late_without_a_word', 'light_warm_car', 'nominal', 'slow_battery_state',
               'slow_traffic', 'stop_in_traffic', 'temperature_stuck', 'whole_degrees'}
OVER_DDS = ALL - WITHOUT_ROS
# One for the nodes together, and one each for car, traffic and sensors; make test-deep drives all.
QUICK = {'heater_stuck_on',
         'heavy_cold_car', 'late_without_a_word', 'temperature_stuck'}
# A drive of 25 min in 25 s; a command period is 17 ms.
SPEED_UP = 60
# So many drives at the same time, each in a ROS domain of its own.
AT_ONCE = 2
TIME_LIMIT_S = 300.0


def names(scenarios):
    """Return the names as parameters, those that are not QUICK as deep ones."""
    return [pytest.param(name, marks=() if name in QUICK else pytest.mark.deep)
            for name in sorted(scenarios)]


def selected(request, scenarios):
    """Return which of the scenarios are tried in this session."""
    tried = {item.callspec.params['name'] for item in request.session.items
             if item.path == request.path and hasattr(item, 'callspec')}
    return sorted(scenarios & tried)


@pytest.fixture(scope='module')
def drives(request, tmp_path_factory):
    """Return the finished processes of `preheat scenario --nodes` by scenario, and their findings."""
    folder = tmp_path_factory.mktemp('scenarios')

    def drive(name):
        findings = folder / f'{name}.json'
        done = subprocess.run(
            [sys.executable, '-m', 'bev_preheat', 'scenario', name, '--nodes', '--speed-up',
             str(SPEED_UP), '--logs', str(folder), '--json', str(findings)],
            capture_output=True, text=True, timeout=TIME_LIMIT_S)
        logs = ''.join(path.read_text() for path in folder.glob(f'{name}.*.log'))
        return done, json.loads(findings.read_text())[name] if findings.exists() else None, logs

    chosen = selected(request, OVER_DDS)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(chosen, pool.map(drive, chosen)))


@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', names(OVER_DDS))
def test_a_fault_is_met_as_its_scenario_expects(drives, name):
    done, findings, logs = drives[name]
    assert findings, done.stdout + done.stderr + logs
    bad = [item for item in findings if not item['good']]
    assert (bad, done.returncode) == ([], 0), done.stdout + logs
    assert 'Traceback' not in logs


def findings_without_ros(name):
    """Run a scenario in this process; return (expectation, whether it is met) of each."""
    scenario = load_scenario(name)
    findings = evaluate(scenario.expectations, drive_scenario(scenario))
    return [(f'{item.what}: {item.expected}: {item.seen}', item.good) for item in findings]


@pytest.fixture(scope='module')
def drives_without_ros(request):
    """Return the findings of those that are tried by scenario, made on all cores."""
    chosen = selected(request, WITHOUT_ROS)
    with multiprocessing.get_context('spawn').Pool() as pool:
        return dict(zip(chosen, pool.map(findings_without_ros, chosen, chunksize=1)))


@pytest.mark.timeout(300)
@pytest.mark.parametrize('name', names(WITHOUT_ROS))
def test_a_drive_goes_as_its_scenario_expects(drives_without_ros, name):
    findings = drives_without_ros[name]
    assert findings and [text for text, good in findings if not good] == []
