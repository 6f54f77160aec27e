# SPDX-License-Identifier: Apache-2.0
"""The car that a route's powers belong to: named in files, warned about, and replaced with legs."""

from dataclasses import fields, replace
import json

import numpy as np
import pytest
from refusals import problems_of
import yaml

from bev_preheat.route import Route, route_for, route_source
from bev_preheat.simulation.scenario import load_scenario
from bev_preheat.vehicle import load_vehicle

REFERENCE, SMALL_CAR = (load_vehicle(name) for name in ('reference', 'small_car'))
WARNING = 'route {name} has the powers of vehicle reference; for small_car: --route legs/{name}'
HEADER = 'duration_s,speed_mps,propulsion_power_w,ambient_temperature_c'
SEGMENT = '600,20,17000,-6'
LEGS = {'name': 'errand', 'ambient_temperature_c': -4,
        'legs': [{'length_m': 4000, 'speed_limit_kmh': 70, 'slope_percent': 2}]}
STATE = ('--temperature', '-10', '--soc', '0.9')


def file_of(folder, text, name='trip.csv'):
    (folder / name).write_text(text, encoding='utf-8')
    return folder / name


def legs_file_of(folder):
    return file_of(folder, yaml.safe_dump(LEGS), 'errand.yaml')


def same(one, other):
    return all(np.array_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(Route))


@pytest.mark.parametrize('comment', [
    '# vehicle: my car', '#vehicle:my  car ', '# vehicle: my car;;;', '"# vehicle: my car",,,',
    '# Route errand\n# vehicle: my car\n# vehicle: my car'])
def test_the_file_says_for_which_vehicle_it_was_made(tmp_path, comment):
    path = file_of(tmp_path, f'{comment}\n{HEADER}\n{SEGMENT}\n')
    assert route_for(path, REFERENCE).made_for == 'my car'


def test_two_vehicles_in_one_file_are_refused(tmp_path):
    path = file_of(tmp_path, f'# vehicle: a\n# vehicle: b\n{HEADER}\n{SEGMENT}\n')
    assert problems_of(route_for, path, REFERENCE) == [
        f"{path}, line 2: vehicle: 'b', but 'a' in line 1; a route has the powers of one vehicle"]


def test_another_vehicle_gets_a_warning_that_says_what_to_do(tmp_path):
    assert route_for('alpine_pass', SMALL_CAR).warning == WARNING.format(name='alpine_pass')
    # A file of the same name elsewhere is another route.
    path = file_of(tmp_path, f'# vehicle: reference\n{HEADER}\n{SEGMENT}\n', 'alpine_pass.csv')
    assert route_for(path, SMALL_CAR).warning == (
        'route alpine_pass has the powers of vehicle reference; for small_car: make it again from '
        'its legs or logs, with preheat route')
    assert route_for('alpine_pass', replace(SMALL_CAR, road_load=None)).warning == (
        'route alpine_pass has the powers of vehicle reference; for small_car: '
        '--route legs/alpine_pass, once its file has a road_load')


def test_legs_are_found_by_name_by_file_and_from_a_folder(tmp_path, monkeypatch):
    path = legs_file_of(tmp_path)
    (tmp_path / 'errand.yml').write_text(path.read_text())
    wanted = route_for(path, SMALL_CAR)
    assert (wanted.made_for, wanted.warning, wanted.file) == ('small_car', None, path)
    for name in ('errand.yaml', './errand.yaml', 'errand.yml'):
        found = route_for(name, SMALL_CAR, tmp_path)
        assert same(found.route, wanted.route) and found.file.samefile(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    for name in ('errand.yaml', 'errand.yml'):
        assert same(route_for(name, SMALL_CAR).route, wanted.route)
        assert route_source(name).samefile(tmp_path / name)
    assert route_source('legs/alpine_pass') == route_for('legs/alpine_pass', SMALL_CAR).file
    assert route_source('alpine_pass') == route_for('alpine_pass', SMALL_CAR).file


@pytest.mark.parametrize('name, problem', [
    ('legs/alpin_pass', "leg 'alpin_pass' is unknown; did you mean 'alpine_pass'?; known: "
     'alpine_pass, city_stop_and_go, motorway_3h, reference, winter_commute; or give a file '
     'ending in .yaml'),
    ('legs/nowhere.yaml', 'legs/nowhere.yaml: no such file'),
    ('nowhere.yml', './nowhere.yml: no such file'),
    ('nowhere.gpx', 'nowhere.gpx: no such file'),
    ('legs/no/where', 'legs/no/where: no such file')])
def test_legs_that_are_not_there(tmp_path, monkeypatch, name, problem):
    monkeypatch.chdir(tmp_path)
    assert problems_of(route_for, name, SMALL_CAR) == problems_of(route_source, name) == [problem]


@pytest.mark.costly
@pytest.mark.parametrize('vehicle, legs', [('reference', 'city_stop_and_go'), ('small_car', 'winter_commute')])
def test_a_plan_of_legs_is_that_of_the_file_made_from_them(said, tmp_path, vehicle, legs):
    assert said('route', '--legs', legs, '--vehicle', vehicle, '--output', 'made.csv')[0] == 0
    plans = []
    for route in ('made.csv', f'legs/{legs}'):
        status, _, errors = said(
            'plan', '--vehicle', vehicle, '--route', route, *STATE, '--step', '120', '--json', 'plan.json')
        assert (status, errors) == (0, '')
        plans.append(json.loads((tmp_path / 'plan.json').read_text()))
        del plans[-1]['planning_time_s']
    assert plans[0] == plans[1] and plans[0]['route_made_for'] == vehicle


def test_legs_of_an_itinerary(said, tmp_path):
    """One leg with another car's powers, one made by this car; the warning comes once."""
    legs_file_of(tmp_path)
    stop = {'stop_duration_s': 900, 'departure_temperature_c': 25, 'departure_soc': 0.8}
    trip = file_of(tmp_path, yaml.safe_dump({'name': 'round trip', 'legs': [
        {'route': 'winter_commute', **stop}, {'route': 'errand.yaml', **stop},
        {'route': 'winter_commute', **stop}, {'route': 'legs/winter_commute'}]}), 'trip.yaml')
    status, _, errors = said(
        'plan', '--vehicle', 'small_car', '--itinerary', trip, *STATE, '--json', 'plans.json')
    assert (status, errors) == (0, f'preheat: warning: {WARNING.format(name="winter_commute")}\n')
    plans = json.loads((tmp_path / 'plans.json').read_text())['plans']
    assert [plan['route_made_for'] for plan in plans] == ['reference', 'small_car', 'reference', 'small_car']
    # 2.5 t compared with 1.55 t.
    heat = [plan['energy_wh']['drivetrain_heat'] for plan in plans]
    assert heat[3] < heat[0] == pytest.approx(heat[2], rel=1e-9)


def scenario_of(folder, **drive):
    return file_of(folder, yaml.safe_dump({
        'name': 'short', 'description': 'A drive.', 'expect': {'never': ['INTERNAL_ERROR']},
        'drive': {'vehicle': 'small_car', 'initial_battery_temperature_c': -5,
                  'initial_soc': 0.8, **drive},
        'traffic': [{'event': 'detour', 'at_s': 300, 'route': 'errand.yaml'}]}), 'short.yaml')


def test_scenarios_read_legs_and_warn(said, tmp_path):
    errand = legs_file_of(tmp_path)
    by_legs = load_scenario(scenario_of(tmp_path, route='legs/winter_commute'))
    assert by_legs.warnings == ()
    assert same(by_legs.first.route, route_for('legs/winter_commute', SMALL_CAR).route)
    assert same(by_legs.first.events[0].route, route_for(errand, SMALL_CAR).route)
    assert errand in by_legs.files
    path = scenario_of(tmp_path, route='winter_commute')
    assert load_scenario(path).warnings == (WARNING.format(name='winter_commute'),)
    assert said('scenario', path, '--list')[2] == (
        f'preheat: warning: scenario short: {WARNING.format(name="winter_commute")}\n')
