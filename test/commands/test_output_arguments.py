# SPDX-License-Identifier: Apache-2.0
"""Outputs of all commands: refused before anything is computed, and never over an input."""

from importlib import import_module
import os
from pathlib import Path

import pytest

from bev_preheat.files.input_files import configuration_folder

CAR, ROUTE, OTHER_ROUTE, LEGS, LOG, TRIP, DRIVE = (
    'car.yaml', 'route.csv', 'other.csv', 'legs.yaml', 'log.csv', 'trip.yaml', 'drive.yaml')
CONTENTS = {
    CAR: (configuration_folder('vehicles') / 'reference.yaml').read_text(),
    ROUTE: (configuration_folder('routes') / 'winter_commute.csv').read_text(),
    OTHER_ROUTE: (configuration_folder('routes') / 'reference.csv').read_text(),
    LEGS: (configuration_folder('routes/legs') / 'winter_commute.yaml').read_text(),
    LOG: 'time_s,speed_mps,power_w,cabin_heater_w,ambient_c\n' + ''.join(
        f'{second},20,15000,900,-3\n' for second in range(60)),
    TRIP: 'name: trip\nlegs:\n'
          '  - {route: ./route.csv, stop_duration_s: 600, departure_temperature_c: 20, '
          'departure_soc: 0.8}\n'
          '  - {route: ./other.csv}\n',
    DRIVE: 'name: drive\ndescription: A detour.\n'
           'drive: {vehicle: ./car.yaml, route: ./route.csv, initial_battery_temperature_c: 5, '
           'initial_soc: 0.8}\n'
           'traffic: [{event: detour, at_s: 300, route: ./other.csv}]\nexpect: {most_switch_ons: 3}\n',
}
STATE = ['--temperature', '-5', '--soc', '0.8']
SITUATION = ['--vehicle', './car.yaml', '--route', './route.csv', *STATE]
# Long computations, which would hit pytest's time limit if they did not refuse first.
COMMANDS = {
    'plan': ['plan', *SITUATION],
    'itinerary': ['plan', '--vehicle', './car.yaml', '--itinerary', './trip.yaml', *STATE],
    'optimum': ['optimum', *SITUATION],
    'compare': ['compare', *SITUATION],
    'reproduce': ['reproduce', '--fit'],
    'sweep': ['sweep', '--vehicle', './car.yaml', '--feasible', '100000'],
    'robustness': ['robustness', '--vehicle', './car.yaml', '--route', './route.csv', '--soc',
                   '0.8', '--trips', '100000'],
    'scenario': ['scenario', './drive.yaml'],
    'route from legs': ['route', '--legs', './legs.yaml', '--vehicle', './car.yaml'],
    'route from logs': ['route', '--log', LOG, '--vehicle', './car.yaml'],
    'check': ['check', LOG, '--vehicle', './car.yaml'],
    'vehicle check': ['vehicle', 'check', './car.yaml'],
    'log': ['log', LOG],
}
JSON = [name for name in COMMANDS if not name.startswith('route')]
OPTIONS = [(name, '--json', '') for name in JSON] + [
    (name, '--plot', '.png') for name in JSON if name != 'scenario'] + [
    ('route from legs', '--output', ''), ('route from logs', '--output', '')]
INPUTS = {
    'plan': [CAR, ROUTE], 'itinerary': [CAR, TRIP, ROUTE, OTHER_ROUTE], 'optimum': [CAR, ROUTE],
    'compare': [CAR, ROUTE], 'sweep': [CAR], 'robustness': [CAR, ROUTE],
    'scenario': [DRIVE, CAR, ROUTE, OTHER_ROUTE], 'route from legs': [LEGS, CAR],
    'route from logs': [LOG, CAR], 'check': [LOG, CAR], 'vehicle check': [CAR], 'log': [LOG]}


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    """Put the inputs into the working folder; all must be unchanged in the end."""
    monkeypatch.chdir(tmp_path)
    for name, text in CONTENTS.items():
        Path(name).write_text(text)
    yield
    assert {name: Path(name).read_text() for name in CONTENTS} == CONTENTS


@pytest.mark.parametrize('name, option, suffix', OPTIONS)
def test_what_is_no_file_is_refused_before_anything_is_computed(refused, name, option, suffix):
    os.mkfifo(f'other{suffix}')
    assert refused(*COMMANDS[name], option, f'other{suffix}') == (
        f'{option}: other{suffix}: is a named pipe; only a regular file can be written')


@pytest.mark.parametrize('name, path', [(name, path) for name, paths in INPUTS.items() for path in paths])
def test_an_input_is_never_written_over(refused, name, path):
    option = '--output' if name.startswith('route') else '--json'
    line = refused(*COMMANDS[name], option, path)
    assert line.startswith(f'{option}: {path}: is the same file as the input ')
    assert line.endswith(f'{path}, which must not be overwritten')


@pytest.mark.parametrize('name', [name for name, option, _ in OPTIONS if option == '--plot'])
def test_the_kinds_of_picture_are_listed(refused, name):
    assert refused(*COMMANDS[name], '--plot', 'picture.bmp') == (
        '--plot: picture.bmp: must end in .png or .svg or .pdf')


def test_scenarios_of_one_name_do_not_share_their_logs(said):
    status, _, errors = said(*COMMANDS['scenario'], './drive.yaml', '--nodes', '--logs', '.')
    assert status == 2 and errors.splitlines() == [
        f'preheat: error: --logs: drive.{name}.log: is the same file as --logs; each output needs '
        'its own file' for name in ('planner', 'vehicle_simulator')]


@pytest.mark.parametrize('study', ['cost', 'soak'])
def test_the_long_runs_of_studies_check_their_files_first(capsys, study):
    os.mkfifo('figures.json')
    assert import_module('bev_preheat_studies.__main__').main([study, '--json', 'figures.json']) == 2
    assert capsys.readouterr() == (
        '', 'studies: error: --json: figures.json: is a named pipe; only a regular file can be written\n')
