# SPDX-License-Identifier: Apache-2.0
"""Scenario files: the shipped ones, and the messages about wrong ones."""

from pathlib import Path

from mistakes import changed, GONE
import pytest
import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import Goal
from bev_preheat.simulation import scenario
from bev_preheat.simulation.phases import Charge, Park
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.simulation.sensors import OtherBattery, PositionReports, Spike
from bev_preheat.simulation.traffic import Kind
from bev_preheat.vehicle.description import HeatPath

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
                'invalid': [[30, 40]], 'spikes': [{'from_s': 5, 'until_s': 9, 'by_k': 2}],
                'invalid_every': 7, 'reordered_every': 8, 'temperature_stuck_at_c': -40, 'soc_stuck_at': 0,
                'soc_scale': 100, 'voltage_stuck_at_v': 12.6, 'voltage_scale': 0.1, 'reverses_current': True,
                'supply_status': 'sign', 'location': 'floor', 'other': {
                    'temperature_c': 20, 'soc': 0.9, 'voltage_v': 24.6, 'location': 'trunk', 'is_first': True}},
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
               'heater': 'stuck on', 'never_heater_verdict': True, 'not_heated_above_c': 40,
               'regime_during': [{'regime': 'standing', 'from_s': 460, 'until_s': 500}],
               'never_regimes': ['charging'], 'signals': ['current'], 'named_within_s': 120},
}


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
    # It has expectations.
    assert any(value not in (None, (), False) for value in vars(scenario.expectations).values())


@pytest.mark.costly
def test_the_disturbances_that_are_foreseen_are_all_tried():
    scenarios = [load_scenario(name) for name in NAMES]
    kinds = {event.kind for scenario in scenarios for event in scenario.first.events}
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
    assert scenario.first.route.total_duration_s == pytest.approx(1200.0)
    assert (scenario.state.temperature_c, scenario.state.soc) == (-5.0, 0.8)
    assert (scenario.first.goal.target_temperature_c, scenario.first.goal.minimum_arrival_soc) == (20.0, 0.1)
    assert scenario.car().mission(NS_PER_S).standing_time_s == 7200.0
    assert scenario.planner == {'minimum_off_time': 60.0, 'estimation': False}
    assert imperfections.mismatch.heat_capacity == 1.1
    assert imperfections.sensors.drop_outs == ((10, 20),)
    assert [fault.share for fault in imperfections.heater_faults] == [0.4, 1.0]
    assert [event.kind.value for event in scenario.first.events] == [
        'stop', 'other_pace', 'detour', 'cancel_charging']
    assert scenario.first.events[0].route_plan_after_s is None
    assert imperfections.clock_jumps[0].by_s == -20
    assert scenario.first.position == PositionReports(2.0, 5.0, ((100, 200),))
    assert expected.arrival_error_k == (-0.5, 1.0)
    assert (expected.off_during, expected.heats_during) == (((30, 40),), ((500, 600),))
    sensors = imperfections.sensors
    assert (sensors.spikes, sensors.other) == (
        (Spike(5, 9, 2),), OtherBattery(20, 0.9, 24.6, 0.0, 'trunk', True))
    assert (sensors.invalid_every, sensors.reordered_every, sensors.temperature_stuck_at_c, sensors.soc_stuck_at,
            sensors.soc_scale, sensors.voltage_stuck_at_v, sensors.voltage_scale, sensors.reverses_current,
            sensors.supply_status, sensors.location) == (7, 8, -40, 0, 100, 12.6, 0.1, True, 'sign', 'floor')
    assert (expected.regime_during, expected.never_regimes) == ((('standing', 460, 500),), ('charging',))
    assert (expected.signals, expected.named_within_s) == (('current',), 120)
    assert (expected.never_heater_verdict, expected.not_heated_above_c) == (True, 40)


CHAIN = [
    {'drive': {'route': 'reference', 'ends_after_s': 600, 'standing_time_s': 60, 'charging_planned': False,
               'traffic': [{'event': 'arrive_early', 'at_s': 500, 'route_plan_after_s': None}]},
     'expect': {'most_switch_ons': 1}},
    {'charge': {'power_w': 90000, 'duration_s': 900, 'ambient_temperature_c': -8, 'until_soc': 0.9,
                'cabin_heating_power_w': 1000, 'heats_itself': True}},
    {'park': {'duration_s': 3600, 'ambient_temperature_c': -9, 'awake_s': 300},
     'expect': {'off_during': [[10, 3600]]}},
    {'drive': {'route': 'reference', 'ends_after_s': 700, 'announced_s': 1800, 'target_battery_temperature_c': 15,
               'minimum_arrival_soc': 0.1, 'starts_over': True, 'route_progress': {'noise_m': 3.0}}}]


def chained(chain, **sections):
    contents = {key: value for key, value in GOOD.items() if key not in ('traffic', 'route_progress')}
    return {**contents, 'drive': {'vehicle': 'reference', 'initial_battery_temperature_c': -5, 'initial_soc': 0.8},
            'chain': chain, **sections}


def test_every_key_of_a_chain_takes_effect(tmp_path):
    scenario = load(tmp_path, chained(CHAIN))
    _, charge, park, drive = scenario.phases
    assert charge == Charge(90000, 900, -8, 0.9, 1000, heats_itself=True)
    assert park == Park(3600, -9, 300)
    assert (drive.route.total_duration_s, drive.announced_s, drive.starts_over) == (700.0, 1800.0, True)
    assert (drive.goal, drive.position) == (Goal(15.0, 0.1, True), PositionReports(noise_m=3.0))
    assert (scenario.first.route.total_duration_s, scenario.first.standing_time_s) == (600.0, 60.0)
    assert [event.kind for event in scenario.first.events] == [Kind.ARRIVE_EARLY]
    assert not scenario.first.goal.charging_planned
    first, charged, parked, last = scenario.phase_expectations
    assert (first.most_switch_ons, charged, parked.off_during, last) == (1, None, ((10, 3600),), None)
    assert scenario.car().longest_s == 500.0 + 900.0 + 3600.0 + 700.0
    assert [each.goal.charging_planned for each in scenario.drives] == [False, True]


@pytest.mark.parametrize('contents, problem', [
    (chained(CHAIN[1:]), r'chain\[0\]: has charge; it must have a drive'),
    (chained([CHAIN[0], {**CHAIN[1], **CHAIN[2]}]),
     r'chain\[1\]: has charge, park; it must have a drive, a charge or a park'),
    (chained([CHAIN[0], {'expect': {'no_signals': True}}]),
     r'chain\[1\]: has nothing; it must have a drive, a charge or a park'),
    (chained([CHAIN[0], CHAIN[3]]), r'chain\[1\].drive.announced_s: only for a drive after a park'),
    (chained(CHAIN, traffic=[]), 'traffic: in a chain this belongs to a drive'),
    (chained(CHAIN, drive=GOOD['drive']), 'charging_planned, ends_after_s, .*: in a chain this belongs'),
    (chained([CHAIN[0], {'charge': {'power_w': 0, 'duration_s': 9, 'ambient_temperature_c': 0}}]),
     r'chain\[1\].charge.power_w: 0'),
    (chained([CHAIN[0], {'drive': {'route': 'reference', 'ends_after_s': 9000}}]),
     r'chain\[1\].drive.ends_after_s: 9000 s is beyond'),
    (chained([CHAIN[0], {'drive': {'route': 'reference', 'traffic': [{'event': 'stop', 'at_s': 5}]}}]),
     r'chain\[1\].drive.traffic\[0\]: stop has nothing'),
    (chained([CHAIN[0], {**CHAIN[2], 'expect': {'off_during': [[9, 5]]}}]),
     r'chain\[1\].expect.off_during\[0\]: \[9, 5\] must rise')])
def test_a_wrong_chain_is_refused_with_file_key_and_value(tmp_path, contents, problem):
    with pytest.raises(InvalidInput, match=f'tried.yaml: .*{problem}'):
        load(tmp_path, contents)


def test_a_heat_path_is_that_of_the_vehicle_file_unless_the_scenario_has_its_own(tmp_path):
    assert load(tmp_path, GOOD).imperfections.heat_path is None
    for node, path in (({}, HeatPath()), ({'heater_lag_s': 30}, HeatPath(30.0))):
        contents = {**GOOD, 'heat_path': node}
        assert load(tmp_path, contents).imperfections.heat_path == path


def test_a_scenario_may_set_what_the_node_may_be_given():
    from bev_preheat.control.settings import FIELD_OF_PARAMETER
    from bev_preheat.nodes.planner_parameters import PARAMETERS
    rules = yaml.safe_load(Path(scenario.__file__).with_name('scenario_schema.yaml').read_text())[
        'properties']['planner']['properties']
    assert list(rules) == list(FIELD_OF_PARAMETER)
    for parameter in PARAMETERS:
        if isinstance(parameter.default, float) and parameter.name in rules:
            rule = rules[parameter.name]
            assert (rule['minimum'], rule['maximum']) == parameter.limits, parameter.name


@pytest.mark.parametrize('place, value, problem', [
    ('expect', GONE, 'missing expect'),
    ('name', '../up', "name: '../up' is not allowed; it must be one line of text without a slash"),
    ('name', 'two\nlines', 'name: .* is not allowed; it must be one line'),
    ('name', '', "name: '' is not allowed; it must be one line"),
    ('drive.initial_soc', 1.2, 'drive.initial_soc: 1.2'),
    ('drive.standing_time_s', -1, 'drive.standing_time_s: -1'),
    ('drive.standing_time_s', float('nan'), 'drive.standing_time_s: nan'),
    ('drive.initial_soc', GONE, 'drive: missing initial_soc'),
    ('drive.route', GONE, 'drive: missing route'),
    ('drive.vehicle', 'no_such', "vehicle 'no_such' is unknown"),
    ('drive.route', 'no_such', "route 'no_such' is unknown"),
    ('drive.ends_after_s', 5000, 'drive.ends_after_s: 5000 s is beyond'),
    ('drive.initial_battery_temperature_c', -55, 'temperature'),
    ('planner.no_such', 1.0, "planner: unknown key 'no_such'; known keys: method, target_battery_temperature, "),
    ('planner.battery_state_timeout', -1.0, 'planner.battery_state_timeout: -1.0'),
    ('planner.method', 'magic', "planner: method: 'magic' is not"),
    ('planner.estimation', 1.0, 'planner.estimation: 1.0'),
    ('planner.command_lease', 0.8, 'planner: command_lease: 0.8 s must be longer than command_period, 1 s'),
    ('mismatch.heat_capacity', 5.0, 'mismatch.heat_capacity: 5.0'),
    ('sensors.no_such', 1.0, 'no_such'),
    ('sensors.drop_outs', [[20, 10]], r'sensors.drop_outs\[0\]: \[20, 10\] must rise'),
    ('sensors.spikes', [{'from_s': 9, 'until_s': 5, 'by_k': 3}], r'sensors.spikes\[0\]: \[9, 5\] must rise'),
    ('heater_faults', [{'from_s': 9, 'until_s': 5}], r'heater_faults\[0\]: \[9, 5\] must rise'),
    ('expect.arrival_error_k', [1, -1], r'expect.arrival_error_k: \[1, -1\] must rise'),
    ('route_progress.period_s', 0, 'route_progress.period_s: 0'),
    ('route_progress.drop_outs', [[20, 10]], r'route_progress.drop_outs\[0\]: \[20, 10\] must rise'),
    ('heat_path', {'coolant_heat_capacity_j_per_k': 1e4}, 'heat_path: .* beside coolant_cond'),
    ('heater_faults.0.share', 1.5, r'heater_faults\[0\].share: 1.5'),
    ('traffic.0.event', 'earthquake', r'traffic\[0\].event'),
    ('traffic.0.factor', 2.0, r'traffic\[0\]: stop has duration_s, factor'),
    ('traffic.2.route', GONE, r'traffic\[2\]: detour has nothing'),
    ('traffic.2.route', 'no_such', "route 'no_such' is unknown"),
    ('expect.statuses', ['SLEEPING'], r"expect.statuses\[0\]: 'SLEEPING' is not one of"),
    ('expect.heater', 'tired', 'expect.heater'),
    ('expect.off_during', [[5, 5]], r'expect.off_during\[0\]'),
])
def test_a_wrong_file_is_refused_with_file_key_and_value(tmp_path, place, value, problem):
    with pytest.raises(InvalidInput, match=f'(?s)tried.yaml: .*{problem}'):
        load(tmp_path, changed(GOOD, place, value))


def test_a_highest_temperature_on_arrival_is_what_the_error_counts_from(tmp_path):
    summer = yaml.safe_load((FOLDER / 'summer_at_most.yaml').read_text())
    summer['drive']['route'] = 'reference'
    drive = load(tmp_path, summer).first
    assert drive.wanted_c == drive.goal.maximum_arrival_temperature_c == 36.0
    assert load_scenario('nominal').first.wanted_c == 25.0
    for most_c, problem in ((20.0, 'maximum arrival temperature: 20 is not allowed; it must be 25 ... 55 degC'),
                            (61.0, 'drive.maximum_arrival_temperature_c: 61.0 is not allowed'),
                            (float('nan'), 'drive.maximum_arrival_temperature_c: nan')):
        summer['drive']['maximum_arrival_temperature_c'] = most_c
        with pytest.raises(InvalidInput, match=problem):
            load(tmp_path, summer)


def test_files_that_it_names_are_seen_from_its_folder(tmp_path):
    (tmp_path / 'own.csv').write_text(
        'duration_s,speed_kmh,propulsion_power_kw,ambient_temperature_c\n700,50,8,-4\n800,90,16,-4\n')
    contents = changed(GOOD, 'drive.route', './own.csv')
    del contents['drive']['ends_after_s']
    route = load(tmp_path, contents).first.route
    assert route.duration_s.tolist() == [700.0, 800.0]
    # km/h / 3.6, and a thousand watts a kilowatt.
    assert route.distance_m == pytest.approx((700.0 * 50.0 + 800.0 * 90.0) / 3.6)
    assert route.propulsion_power_w.tolist() == [8e3, 16e3]
    (tmp_path / 'own.csv').write_text('duration_s,speed_kmh\n700,50\n800,90\n')
    with pytest.raises(InvalidInput, match='such as: ambient_temperature_c: -5 beside route'):
        load(tmp_path, contents)
