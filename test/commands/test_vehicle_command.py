# SPDX-License-Identifier: Apache-2.0
"""`preheat vehicle`: a file from a data sheet, its key figures, and the warnings of plans with it."""

import json
from pathlib import Path

from matplotlib.image import imread
import pytest

from bev_preheat.files.input_files import configuration_folder
from bev_preheat.vehicle import load_vehicle

ID4 = ['vehicle', 'new', '--chemistry', 'nmc', '--usable-energy-kwh', '77', '--gross-energy-kwh',
       '82', '--battery-mass-kg', '493', '--nominal-voltage-v', '352', '--charging-power-kw', '135']
STATE = ['--temperature', '-7', '--soc', '0.9', '--step', '120']


def test_one_command_makes_a_car_that_is_usual_and_plans(said):
    status, output, errors = said(*ID4, '--output', 'id4.yaml')
    assert (status, errors) == (0, '')
    assert 'written: id4.yaml' in output and 'battery resistance' in output
    assert 'warning' not in output
    status, output, _ = said('vehicle', 'check', 'id4.yaml')
    assert status == 0 and '77.0 kWh' in output and 'warning' not in output
    assert all(key in output for key in load_vehicle('./id4.yaml').assumed)
    status, output, errors = said('plan', '--vehicle', 'id4.yaml', '--route', 'reference', *STATE,
                                  '--json', 'plan.json')
    assert status == 0
    (line,) = [line for line in errors.splitlines() if 'assumed' in line]
    assert line == ('preheat: warning: vehicle id4: 19 values are assumed, not measured; preheat vehicle check '
                    'id4.yaml lists them')
    assert json.loads(Path('plan.json').read_text())['vehicle_assumed'] == list(
        load_vehicle('./id4.yaml').assumed)


@pytest.mark.parametrize('name', ['#: {[', "'", 'ID.4 "Pro"', 'Ä ß 漢', '$name ${x}', 'null', '1'])
def test_any_name_survives(said, name):
    assert said(*ID4, '--output', 'car.yaml', '--name', name)[0] == 0
    assert load_vehicle('./car.yaml').name == name


@pytest.mark.parametrize('text', ['a\nbattery: {}', '# x', '${name}', '100 % "yes"'])
def test_any_source_stays_a_comment(said, text):
    assert said(*ID4, '--output', 'car.yaml', '--source', f'battery-mass-kg={text}')[0] == 0
    assert load_vehicle('./car.yaml').battery.heat_capacity_j_per_k > 0.0


@pytest.mark.costly
def test_an_existing_file_is_only_replaced_when_asked(said):
    Path('id4.yaml').write_text('mine')
    assert said(*ID4, '--output', 'id4.yaml') == (
        2, '', 'preheat: error: --output: id4.yaml: exists; --force replaces it\n')
    assert Path('id4.yaml').read_text() == 'mine'
    assert said(*ID4, '--output', 'id4.yaml', '--force')[0] == 0
    assert load_vehicle('./id4.yaml').name == 'id4'


@pytest.mark.parametrize('arguments, problem', [
    (['--output', 'car.txt'], '--output: car.txt: must end in .yaml'),
    (['--output', 'no/car.yaml'], '--output: no/car.yaml: cannot be written: '),
    (['--source', 'mass'], "--source: 'mass' is not OPTION=TEXT, such as battery-mass-kg=\"press kit 2021\""),
    (['--name', ' '], "--name: ' ' is not allowed"),
    (['--charging-curve', 'none.csv', '--charging-curve-temperature-c', '25'],
     '--charging-curve: none.csv: no such file'),
    (['--charging-curve-temperature-c', '25'],
     '--charging-curve-temperature-c: 1 temperatures for 0 --charging-curve files'),
    (['--source', 'charging-curve=magazine'], '--source: --charging-curve is not given')])
def test_what_cannot_be_made_is_refused_before_anything_is_written(refused, arguments, problem):
    assert refused(*ID4, '--output', 'car.yaml', *arguments).startswith(problem)


@pytest.mark.parametrize('file', sorted(
    path.stem for path in configuration_folder('vehicles').glob('*.yaml')))
def test_check_of_each_shipped_car(said, file):
    status, output, errors = said('vehicle', 'check', file, '--json', 'figures.json')
    assert (status, errors) == (0, '') and 'warning' not in output
    figures = json.loads(Path('figures.json').read_text())
    assert f'{figures["energy_kwh"]:.1f} kWh' in output
    assert figures['assumed'] == list(load_vehicle(file).assumed)


@pytest.mark.costly
def test_check_draws_the_curves(said):
    assert said('vehicle', 'check', 'mid_size_lfp', '--plot', 'car.png')[0] == 0
    picture = imread('car.png')
    assert picture.shape[0] > 800 and picture.std() > 0.05


def test_check_refuses_what_no_vehicle_file_is(refused):
    Path('car.yaml').write_text('name: x\n')
    assert 'missing battery' in refused('vehicle', 'check', 'car.yaml')


def test_list_names_each_shipped_car(said):
    output = said('vehicle', 'list')[1]
    for file in configuration_folder('vehicles').glob('*.yaml'):
        assert file.stem in output


def test_a_published_curve_and_time_become_the_map(said):
    Path('curve.csv').write_text('state_of_charge_percent,power_kw\n0,135\n30,135\n70,70\n100,20\n')
    status, output, _ = said(*ID4, '--output', 'id4.yaml', '--charging-time-10-80-min', '36', '--charging-curve',
                             'curve.csv', '--charging-curve-temperature-c', '30', '--source',
                             'charging-curve=magazine')
    assert status == 0 and '10 ... 80 % at a fast charger: 36:00 min from 25 degC' in output
    text = Path('id4.yaml').read_text()
    words = ' '.join(text.split()).replace(' # ', ' ')
    assert '--charging-curve curve.csv --charging-curve-temperature-c' in words
    assert 'source: magazine' in text
    status, output, _ = said('vehicle', 'check', 'id4.yaml', '--json', 'id4.json')
    assert '36:00 min' in output
    figures = json.loads(Path('id4.json').read_text())
    assert figures['charging_time_10_80_s']['25'] == pytest.approx(2160.0, abs=0.5)
    assert figures['charging_time_10_80_s']['-10'] > figures['charging_time_10_80_s']['25']


@pytest.mark.parametrize('arguments', [
    ['--chemistry', 'lfp', '--usable-energy-kwh', '600', '--gross-energy-kwh', '621', '--nominal-voltage-v', '800',
     '--battery-mass-kg', '4500', '--vehicle-mass-kg', '40000', '--frontal-area-m2', '10', '--charging-power-kw',
     '400', '--heater-power-kw', '16'],
    ['--chemistry', 'nmc', '--usable-energy-kwh', '21.6', '--nominal-voltage-v', '355', '--charging-power-kw',
     '50', '--heater-power-kw', '0.3']], ids=['truck', 'heating pads'])
def test_trucks_and_heating_pads_are_admitted(said, arguments):
    assert said('vehicle', 'new', '--output', 'car.yaml', *arguments)[0] == 0
    assert said('charge', '--vehicle', './car.yaml', '--arrival-temperature', '25', '0', '--arrival-soc', '0.2',
                '--ambient', '0', '--charger-power', '350000', '--departure-soc', '0.8',
                '--cabin-heating-power', '0')[0] == 0
