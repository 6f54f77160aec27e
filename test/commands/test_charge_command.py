# SPDX-License-Identifier: Apache-2.0
"""`preheat charge`: tables, JSON and picture of sessions, and refusals."""

import json

from matplotlib.image import imread
import pytest
import yaml

from bev_preheat.charging.heating_choice import ChargerHeating
from bev_preheat.charging.stop import ChargingStop
from bev_preheat.charging.target_worth import Prices
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route, route_file
from bev_preheat.vehicle import load_vehicle

DRIVE = ['charge', '--vehicle', 'reference', '--route', 'reference', '--temperature', '-7', '--soc',
         '0.7', '--charger-power', '150000', '--departure-soc', '0.8']
ARRIVAL = ['charge', '--vehicle', 'small_car', '--arrival-soc', '0.3', '--ambient', '-4',
           '--charger-power', '90000', '--departure-soc', '0.6', '--arrival-temperature']
# At such temperatures this car takes no charge, and does not warm its battery.
FROZEN = [*(word.replace('-4', '-30') for word in ARRIVAL), '-25']


def test_the_sessions_after_a_drive_are_those_of_its_plans(said, tmp_path):
    status, output, errors = said(*DRIVE, '--json', 'charge.json')
    assert (status, errors) == (0, '')
    written = json.loads((tmp_path / 'charge.json').read_text())
    vehicle = load_vehicle('reference')
    route = load_route('reference', vehicle.defaults)
    inputs = vehicle, route, BatteryState(-7.0, 0.7), Goal(25.0)
    stop = ChargingStop(150e3, 0.8, -7.0, 1978.0, 500.0)
    assert {key: written[key] for key in vars(stop)} == vars(stop)
    heating = ChargerHeating(vehicle, stop, Prices(0.6, 10.0))
    for session, plan, name in zip(written['sessions'], (plan_preheating(*inputs), plan_unheated(*inputs)),
                                   ('preheated', 'without preheating')):
        expected = heating.compare(BatteryState(plan.arrival_temperature_c, plan.arrival_soc))
        assert session == {'name': name, **expected.session.as_dictionary(),
                           'charger_heating': expected.as_dictionary()}
        assert expected.cost <= min(expected.cost_always, expected.cost_never)
    assert 'At the charger ' in output or ': at the charger ' in output
    assert written['plan']['status'] == 'WAITING' and written['vehicle_assumed'] == []
    preheated, unheated = written['sessions']
    saved_s = unheated['charging_time_s'] - preheated['charging_time_s']
    assert saved_s > 120.0
    assert f'{int(saved_s + 0.5) // 60}:{int(saved_s + 0.5) % 60:02d} min less than' in output


def test_a_session_without_an_end_is_null_in_json_and_says_why(said):
    status, output, errors = said(*FROZEN, '20', '--json', '-')
    cold, warm = json.loads(output)['sessions']
    assert status == 0 and cold['charging_time_s'] is None and warm['charging_time_s'] > 0.0
    assert 'From -25 degC: not charged to the end: at 30.0 % and -25.0 degC the battery takes' in errors


@pytest.mark.costly
@pytest.mark.parametrize('arguments', [
    DRIVE, [*FROZEN, '20'], pytest.param(FROZEN, marks=pytest.mark.deep)],
    ids=['drive', 'one never ends', 'none begins'])
def test_sessions_are_drawn(said, tmp_path, arguments):
    assert said(*arguments, '--plot', 'charge.png')[0] == 0
    picture = imread(tmp_path / 'charge.png')
    assert picture.shape[0] > 700 and picture.std() > 0.05


@pytest.mark.parametrize('arguments, problem', [
    ([*DRIVE, '--soc', '0.2'], 'state of charge: 20 % is not enough for this trip, even without heating: the '
     'battery will be empty in 38:46 min (6.60 kWh short)'),
    ([*DRIVE, '--ambient', '3'],
     f'{route_file("reference")}: has its own ambient temperature; leave out --ambient'),
    ([*ARRIVAL, '3', '--soc', '0.3'], '--soc: not allowed with --arrival-temperature, only with --route'),
    ([*ARRIVAL, '3', '--free-speed', '90'], '--free-speed: not allowed with --arrival-temp'),
    ([*ARRIVAL, '3', '--min-soc', '0.3'], '--min-soc: not allowed with --arrival-temperature, only with --route'),
    ([*ARRIVAL, '3', '4', '5'], '--arrival-temperature: 3 values are given; at most 2 are allowed'),
    ([word for word in DRIVE if word not in ('--temperature', '-7')], '--temperature: needed with --route')])
def test_refused_in_one_line(refused, arguments, problem):
    assert refused(*arguments).startswith(problem)


def test_a_vehicle_that_does_not_say_whether_it_heats_is_refused(refused, tmp_path):
    contents = yaml.safe_load((configuration_folder('vehicles') / 'small_car.yaml').read_text())
    del contents['charging']
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(contents))
    assert 'vehicle small_car: charging.battery_heating is missing; say in the vehicle file' in refused(
        *ARRIVAL, '5', '--vehicle', 'mine.yaml')
