# SPDX-License-Identifier: Apache-2.0
"""Scenario files: those that come along, and what is said of one that is wrong."""

import re

import pytest
import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat.files.configuration import configuration_folder
from bev_preheat.simulation.evaluation import evaluate
from bev_preheat.simulation.position import PositionReports
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.traffic import Kind
from bev_preheat.supervision.inputs import NS_PER_S
from bev_preheat.vehicle.heat_path import HeatPath

FOLDER = configuration_folder('scenarios')
NAMES = sorted(path.stem for path in FOLDER.glob('*.yaml'))

GOOD = {
    'name': 'tried', 'description': 'All that a file can say.', 'seed': 3,
    'drive': {'vehicle': 'reference', 'route': 'reference', 'ends_after_s': 1200,
              'initial_battery_temperature_c': -5, 'initial_soc': 0.8, 'standing_time_s': 7200,
              'target_battery_temperature_c': 20, 'minimum_arrival_soc': 0.1,
              'charging_planned': True},
    'planner': {'minimum_off_time': 60.0, 'estimation': False},
    'mismatch': {'heat_capacity': 1.1, 'propulsion_power_variability': 0.2},
    'sensors': {'temperature_noise_k': 0.2, 'period_s': 0.5, 'drop_outs': [[10, 20]],
                'invalid': [[30, 40]]},
    'heater_faults': [{'from_s': 100, 'until_s': 200, 'share': 0.4}, {'from_s': 300,
                                                                      'stuck_on': True}],
    'traffic': [{'event': 'stop', 'at_s': 400, 'duration_s': 60, 'route_plan_after_s': None},
                {'event': 'other_pace', 'at_s': 600, 'duration_s': 60, 'factor': 1.5},
                {'event': 'detour', 'at_s': 800, 'route': 'winter_commute'},
                {'event': 'cancel_charging', 'at_s': 900}],
    'clock_jumps': [{'at_s': 50, 'by_s': -20}],
    'route_progress': {'period_s': 2.0, 'noise_m': 5.0, 'drop_outs': [[100, 200]]},
    'expect': {'arrival_error_k': [-0.5, 1.0], 'most_switch_ons': 3, 'statuses': ['WAITING'],
               'never': ['INTERNAL_ERROR'], 'off_during': [[30, 40]], 'heats_during': [[500, 600]],
               'heater': 'stuck on'},
}


def changed(path, value):
    """GOOD with a value at a path of keys; a value of None takes the key away."""
    contents = yaml.safe_load(yaml.safe_dump(GOOD))
    *folders, key = path
    node = contents
    for name in folders:
        node = node[name]
    if value is None:
        del node[key]
    else:
        node[key] = value
    return contents


def load(tmp_path, contents):
    path = tmp_path / 'tried.yaml'
    path.write_text(yaml.safe_dump(contents))
    return load_scenario(path)


@pytest.mark.parametrize('name', NAMES)
def test_a_scenario_that_comes_along_says_what_it_is(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description.endswith('.')
    assert scenario.car().plant.duration_s > 0.0
    # It expects something.
    assert any(value not in (None, ()) for value in vars(scenario.expectations).values())


@pytest.mark.costly
def test_the_disturbances_that_are_foreseen_are_all_tried():
    scenarios = [load_scenario(name) for name in NAMES]
    kinds = {event.kind for scenario in scenarios for event in scenario.imperfections.events}
    assert kinds == set(Kind)
    faults = [fault for scenario in scenarios for fault in scenario.imperfections.heater_faults]
    assert any(fault.stuck_on for fault in faults)
    assert any(fault.share == 0.0 for fault in faults)
    assert any(0.0 < fault.share < 1.0 for fault in faults)
    jumps_s = [jump.by_s for scenario in scenarios for jump in scenario.imperfections.clock_jumps]
    assert min(jumps_s) < 0.0 < max(jumps_s)
    periods_s = {scenario.imperfections.sensors.period_s for scenario in scenarios}
    assert {0.01, 10.0} <= periods_s
    assert {scenario.expectations.heater for scenario in scenarios} >= {
        'answers', 'dead', 'derated', 'stuck on'}


def test_every_key_takes_effect(tmp_path):
    scenario = load(tmp_path, GOOD)
    imperfections, expected = scenario.imperfections, scenario.expectations
    assert scenario.route.total_duration_s == pytest.approx(1200.0)
    assert (scenario.state.temperature_c, scenario.state.soc) == (-5.0, 0.8)
    assert (scenario.goal.target_temperature_c, scenario.goal.minimum_arrival_soc) == (20.0, 0.1)
    assert scenario.car().mission(NS_PER_S).standing_time_s == 7200.0
    assert scenario.planner == {'minimum_off_time': 60.0, 'estimation': False}
    assert imperfections.mismatch.heat_capacity == 1.1
    assert imperfections.sensors.drop_outs == ((10, 20),)
    assert [fault.share for fault in imperfections.heater_faults] == [0.4, 1.0]
    assert [event.kind.value for event in imperfections.events] == [
        'stop', 'other_pace', 'detour', 'cancel_charging']
    assert imperfections.events[0].route_plan_after_s is None
    assert imperfections.clock_jumps[0].by_s == -20
    assert imperfections.position == PositionReports(2.0, 5.0, ((100, 200),))
    assert expected.arrival_error_k == (-0.5, 1.0)
    assert (expected.off_during, expected.heats_during) == (((30, 40),), ((500, 600),))


def test_a_heat_path_is_that_of_the_vehicle_file_unless_the_scenario_has_its_own(tmp_path):
    assert load(tmp_path, GOOD).imperfections.heat_path is None
    for node, path in (({}, HeatPath()), ({'heater_lag_s': 30}, HeatPath(30.0))):
        contents = {**GOOD, 'heat_path': node}
        assert load(tmp_path, contents).imperfections.heat_path == path


@pytest.mark.parametrize('path, value, problem', [
    (('expect',), None, 'missing expect'),
    (('name',), '../up', r"name: '../up' is not allowed; it must be one line of text without a "
                         'slash'),
    (('name',), 'two\nlines', 'name: .* is not allowed; it must be one line'),
    (('name',), '', "name: '' is not allowed; it must be one line"),
    (('drive', 'initial_soc'), 1.2, 'drive.initial_soc: 1.2'),
    (('drive', 'standing_time_s'), -1, 'drive.standing_time_s: -1'),
    (('drive', 'standing_time_s'), float('nan'), 'drive.standing_time_s: nan'),
    (('drive', 'initial_soc'), None, 'drive: missing initial_soc'),
    (('drive', 'vehicle'), 'no_such', "vehicle 'no_such' is unknown"),
    (('drive', 'route'), 'no_such', "route 'no_such' is unknown"),
    (('drive', 'ends_after_s'), 5000, 'drive.ends_after_s: 5000 s is beyond'),
    (('drive', 'initial_battery_temperature_c'), -55, 'temperature'),
    (('planner', 'no_such'), 1.0, "planner: 'no_such' is none of"),
    (('mismatch', 'heat_capacity'), 5.0, 'mismatch.heat_capacity: 5.0'),
    (('sensors', 'no_such'), 1.0, 'no_such'),
    (('sensors', 'drop_outs'), [[20, 10]], r'sensors.drop_outs\[0\]: \[20, 10\] must rise'),
    (('route_progress', 'period_s'), 0, 'route_progress.period_s: 0'),
    (('route_progress', 'drop_outs'), [[20, 10]],
     r'route_progress.drop_outs\[0\]: \[20, 10\] must rise'),
    (('heat_path',), {'coolant_heat_capacity_j_per_k': 1e4}, 'heat_path: .* needs coolant_cond'),
    (('heater_faults', 0, 'share'), 1.5, r'heater_faults\[0\].share: 1.5'),
    (('traffic', 0, 'event'), 'earthquake', r'traffic\[0\].event'),
    (('traffic', 0, 'factor'), 2.0, r'traffic\[0\]: stop has duration_s, factor'),
    (('traffic', 2, 'route'), None, r'traffic\[2\]: detour has nothing'),
    (('traffic', 2, 'route'), 'no_such', "route 'no_such' is unknown"),
    (('expect', 'statuses'), ['SLEEPING'], r"expect.statuses\[0\]: 'SLEEPING' is not one of"),
    (('expect', 'heater'), 'tired', 'expect.heater'),
    (('expect', 'off_during'), [[5, 5]], r'expect.off_during\[0\]'),
])
def test_a_wrong_file_is_refused_with_file_key_and_value(tmp_path, path, value, problem):
    with pytest.raises(InvalidInput) as refusal:
        load(tmp_path, changed(path, value))
    assert re.search(problem, str(refusal.value)), refusal.value
    assert 'tried.yaml' in str(refusal.value)


def test_files_that_it_names_are_seen_from_its_folder(tmp_path):
    (tmp_path / 'own.csv').write_text(
        (configuration_folder('routes') / 'winter_commute.csv').read_text())
    contents = changed(('drive', 'route'), './own.csv')
    del contents['drive']['ends_after_s']
    assert load(tmp_path, contents).route.total_duration_s == pytest.approx(
        load_scenario('detour').imperfections.events[0].route.total_duration_s, rel=1.0)


@pytest.mark.costly
def test_a_scenario_that_expects_what_does_not_happen_finds_it(tmp_path):
    from bev_preheat.experiments.scenario_drive import drive_scenario
    contents = yaml.safe_load((FOLDER / 'nominal.yaml').read_text())
    contents['drive']['ends_after_s'] = 300
    contents['expect'] = {'arrival_error_k': [50, 60], 'most_switch_ons': 0, 'statuses': ['ARRIVED'],
                          'never': ['ARRIVED'], 'off_during': [[0, 300]], 'heats_during': [[0, 300]],
                          'heater': 'dead'}
    scenario = load(tmp_path, contents)
    findings = evaluate(scenario.expectations, drive_scenario(scenario))
    # In five minutes it neither arrives 50 K too warm, nor is the heater dead; it heats.
    assert [(finding.what.split()[0], finding.good) for finding in findings] == [
        ('arrival', False), ('heater', False), ('statuses', True), ('statuses', False),
        ('command', False), ('command', True), ('heater', False)]
