# SPDX-License-Identifier: Apache-2.0
"""
Scenarios: failures are detected, and the drive meets its expectations.

Scenarios with failures of inputs, clock or heater run with the installed executables over real DDS; scenarios
for the estimation run with the planner's own Supervisor. `make test-deep` drives all shipped scenarios; `make
test` drives short ones without ROS: traffic, a sensor, and a chain; test_estimating.py has other cars and heaters.
Daily, test_installed_drive.py drives the nodes as a scenario does, through a drop-out.
"""

from concurrent.futures import ThreadPoolExecutor
import json
import multiprocessing
import subprocess
import sys

import pytest
import yaml

from bev_preheat.commands.main import main
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.scenario_drive import drive_scenario, evaluate_chain

pytestmark = pytest.mark.costly

ALL = {path.stem for path in configuration_folder('scenarios').glob('*.yaml')}
WITHOUT_ROS = {'ahead_of_plan', 'charge_in_percent', 'charge_never_set', 'charges_early_and_heats', 'detour',
               'early_arrival', 'early_with_progress', 'fast_battery_state', 'four_trips_heated_at_charger',
               'heavy_cold_car', 'late_with_progress', 'late_without_a_word', 'light_warm_car', 'long_descent',
               'looping_recording', 'nominal', 'parked_and_driven_on', 'sensor_on_shell', 'slow_battery_state',
               'slow_heater', 'slow_sensor', 'slow_traffic', 'spikes', 'starts_tomorrow', 'stop_and_go',
               'stop_in_traffic', 'stood_after_charging', 'temperature_minus_40', 'temperature_stuck',
               'two_batteries_second', 'two_battery_managers', 'voltage_at_full_scale', 'voltage_of_12_v',
               'whole_degrees'}
OVER_DDS = ALL - WITHOUT_ROS
# Each is a shortened shipped scenario, which starts nearer to its target and to its end.
SHORT = {
    'late_with_progress': {
        # The target is missed: it heats until it is there, and no longer than by place.
        'drive': {'ends_after_s': 240, 'initial_battery_temperature_c': 18},
        'traffic': [{'event': 'stop', 'at_s': 80, 'duration_s': 100, 'route_plan_after_s': None}],
        'expect': {'statuses': ['TARGET_UNREACHABLE', 'ARRIVED'], 'arrival_error_k': [-6, 0],
                   'heats_during': [[80, 180], [241, 335]], 'off_during': [[342, 460]]}},
    'temperature_stuck': {
        'drive': {'ends_after_s': 600, 'initial_battery_temperature_c': 20},
        'sensors': {'stuck': [[200, 600]]}},
    'charges_early': {
        'drive': {'initial_battery_temperature_c': 20},
        'chain': [{'drive': {'route': 'reference', 'ends_after_s': 480, 'traffic': [
            {'event': 'arrive_early', 'at_s': 240, 'route_plan_after_s': None}]},
                   'expect': {'heats_during': [[60, 240]]}},
                  {'charge': {'power_w': 90000, 'duration_s': 120, 'ambient_temperature_c': -7},
                   'expect': {'off_during': [[10, 120]], 'regime_during': [
                       {'regime': 'charging', 'from_s': 10, 'until_s': 120}]}}]},
}
# Number of concurrent drives, each in its own ROS domain.
AT_ONCE = 2
TIME_LIMIT_S = 300.0


def write_short(folder, base, changes):
    """Write the scenario `base` with changes in some of its sections, and return the file."""
    contents = yaml.safe_load((configuration_folder('scenarios') / f'{base}.yaml').read_text())
    contents['name'] = f'short_{base}'
    for section, values in changes.items():
        before = contents.get(section)
        contents[section] = {**before, **values} if isinstance(before, dict) else values
    path = folder / f'{contents["name"]}.yaml'
    path.write_text(yaml.safe_dump(contents))
    return path


def selected(request, scenarios):
    tried = {item.callspec.params.get('name') for item in request.session.items
             if item.path == request.path and hasattr(item, 'callspec')}
    return sorted(scenarios & tried)


def drive_over_dds(name, folder):
    """Return the finished process of `preheat scenario --nodes --record`, its findings and the nodes' logs."""
    findings = folder / f'{name}.json'
    done = subprocess.run(
        [sys.executable, '-m', 'bev_preheat', 'scenario', name, '--nodes', '--logs', str(folder),
         '--record', str(folder), '--json', str(findings)],
        capture_output=True, text=True, timeout=TIME_LIMIT_S)
    logs = ''.join(path.read_text() for path in folder.glob(f'{name}.*.log'))
    return done, json.loads(findings.read_text())[name] if findings.exists() else None, logs


@pytest.fixture(scope='module')
def drives(dds, request, tmp_path_factory):
    """Return (folder, what drive_over_dds() returns) by scenario."""
    folder = tmp_path_factory.mktemp('scenarios')
    chosen = selected(request, OVER_DDS)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return folder, dict(zip(chosen, pool.map(lambda name: drive_over_dds(name, folder), chosen)))


@pytest.mark.deep
@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', sorted(OVER_DDS))
def test_a_fault_is_met_as_its_scenario_expects_and_reproduced(drives, name, capsys):
    folder, driven = drives
    done, findings, logs = driven[name]
    assert findings, done.stdout + done.stderr + logs
    assert [item for item in findings if not item['good']] == [], done.stdout + logs
    assert done.returncode == 0 and 'Traceback' not in logs, done.stdout + logs
    assert main(['replay', str(folder / f'{name}.mcap')]) == 0
    assert 'reproduced: ' in capsys.readouterr().out


def findings_without_ros(name_or_file):
    """Run a scenario in this process; return (expectation, whether it is met) of each."""
    scenario = load_scenario(name_or_file)
    findings = evaluate_chain(scenario.expectations, scenario.phase_expectations, drive_scenario(scenario))
    return [(f'{item.what}: {item.expected}: {item.seen}', item.good) for item in findings]


@pytest.mark.parametrize('base, changes', SHORT.items(), ids=SHORT)
def test_a_short_drive_goes_as_expected(tmp_path, base, changes):
    findings = findings_without_ros(str(write_short(tmp_path, base, changes)))
    assert findings and [text for text, good in findings if not good] == []


@pytest.fixture(scope='module')
def drives_without_ros(request):
    """Return the findings of those that are tried by scenario, made on all cores."""
    chosen = selected(request, WITHOUT_ROS)
    with multiprocessing.get_context('spawn').Pool() as pool:
        return dict(zip(chosen, pool.map(findings_without_ros, chosen, chunksize=1)))


@pytest.mark.deep
@pytest.mark.timeout(900)
@pytest.mark.parametrize('name', sorted(WITHOUT_ROS))
def test_a_drive_goes_as_its_scenario_expects(drives_without_ros, name):
    findings = drives_without_ros[name]
    assert findings and [text for text, good in findings if not good] == []
