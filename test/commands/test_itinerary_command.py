# SPDX-License-Identifier: Apache-2.0
"""`preheat plan --itinerary`: a trip with stops; output, files and refusals."""

import json

import pytest
import yaml

from bev_preheat.control.itinerary import SCHEMA
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.tunables import MOST_STOPS

ROUTE = """duration_s,speed_mps,propulsion_power_w,ambient_temperature_c
600,20,17000,-6
900,25,21000,-4
"""
DRIVE_S = 1500.0
PLAN = ['plan', '--vehicle', 'reference', '--temperature', '-6', '--soc', '0.75']
# Two legs, the first with a stop at its end.
FIRST = {'route': './drive.csv', 'target_battery_temperature_c': 19.0, 'minimum_arrival_soc': 0.2,
         'stop_duration_s': 1200, 'departure_temperature_c': 33.0, 'departure_soc': 0.85}
LAST = {'route': 'drive.csv', 'charging_planned': False, 'minimum_arrival_soc': 0.3}


@pytest.fixture
def trip(tmp_path):
    """Write an itinerary of legs; returns the words of a command that plans it."""
    (tmp_path / 'drive.csv').write_text(ROUTE)
    (tmp_path / 'cycle.csv').write_text('time_s,speed_kmh\n0,50\n60,50\n')

    def words(*legs):
        (tmp_path / 'trip.yaml').write_text(yaml.safe_dump({'name': 'there and on', 'legs': list(legs)}))
        return [*PLAN, '--itinerary', './trip.yaml']

    return words


@pytest.fixture
def plans_of(said, trip, tmp_path):
    """Return the JSON that the command writes."""
    def run(*legs, arguments=()):
        status, _, errors = said(*trip(*legs), '--json', 'plans.json', *arguments)
        assert (status, errors) == (0, '')
        return json.loads((tmp_path / 'plans.json').read_text())['plans']

    return run


# Results

def test_each_leg_has_a_plan_from_its_departure_for_its_own_end(plans_of):
    first, last = plans = plans_of(FIRST, LAST)
    for key, expected in (('route', ['./drive.csv', 'drive.csv']), ('departure_s', [0.0, DRIVE_S + 1200.0]),
                          ('arrival_time_s', [DRIVE_S] * 2), ('target_temperature_c', [19.0, 25.0])):
        assert [plan[key] for plan in plans] == expected
    assert [(plan['battery_temperature_c'][0], plan['soc'][0]) for plan in plans] == [(-6.0, 0.75), (33.0, 0.85)]
    assert first['energy_wh']['hvch_electric'] > 100.0
    assert (last['status'], last['energy_wh']['hvch_electric']) == ('NO_CHARGING_PLANNED', 0.0)


def test_a_highest_temperature_of_one_leg_cools_that_leg_alone(refused, trip, plans_of, tmp_path):
    (tmp_path / 'hot.csv').write_text(ROUTE.replace('-6', '35').replace('-4', '35'))
    first, last = ({'route': 'hot.csv', 'target_battery_temperature_c': 19.0, **more} for more in (
        {'stop_duration_s': 1200, 'departure_temperature_c': 44.0, 'departure_soc': 0.85},
        {'maximum_arrival_temperature_c': 41.0}))
    car = ('--vehicle', 'heat_pump_car', '--temperature', '44', '--soc', '0.75')
    whole, cooled = plans_of(first, last, arguments=car)
    assert whole['heat_source_power_w']['chiller'] == [0.0] * len(whole['heat_source_power_w']['chiller'])
    assert whole['arrival_temperature_c'] > 44.0 and 'maximum_arrival_temperature_c' not in whole
    assert cooled['maximum_arrival_temperature_c'] == 41.0
    assert cooled['arrival_temperature_c'] == pytest.approx(41.0, abs=0.01)
    for most_c, allowed in ((18.0, '19 ... 55 degC'), (61, 'at most 60'), (float('nan'), 'not a finite number')):
        problem = refused(*trip(first, {**last, 'maximum_arrival_temperature_c': most_c}), *car)
        assert 'maximum' in problem and f'{most_c:g}' in problem and allowed in problem


@pytest.mark.parametrize('probability', [1.0, 0.3])
def test_a_leg_alone_is_the_route_alone(plans_of, said, probability):
    wanted = {'charging_planned': True, 'minimum_arrival_soc': 0.3,
              'target_battery_temperature_c': 14.0, 'charging_probability': probability}
    in_itinerary, = plans_of({**LAST, **wanted})
    alone = json.loads(said(
        *PLAN, '--route', './drive.csv', '--target', '14', '--min-soc', '0.3', '--json', '-',
        '--charging-probability', str(probability))[1])
    assert ('prospect_explanation' in alone) is (probability < 1.0)
    # The itinerary's assumptions about the car are listed once for all legs.
    ignored = ('route', 'departure_s', 'planning_time_s', 'vehicle_assumed')
    assert {key: value for key, value in in_itinerary.items() if key not in ignored} == {
        key: value for key, value in alone.items() if key not in ignored}


@pytest.mark.costly
def test_the_trip_is_drawn(said, trip, tmp_path):
    said(*trip(FIRST, LAST), '--plot', 'trip.svg')
    # Text is drawn as shapes, with the characters in comments.
    drawn = (tmp_path / 'trip.svg').read_text()
    assert [text for text in ('battery', 'target', 'stop', 'trip time [min]')
            if f'<!-- {text} -->' not in drawn] == []


@pytest.mark.parametrize(
    'path', sorted(configuration_folder('itineraries').glob('*.yaml')), ids=lambda path: path.stem)
def test_shipped_itineraries_can_be_driven(said, path):
    status, output, errors = said(*PLAN, '--itinerary', path.stem)
    assert (status, errors, 'SOC_LIMITED' in output or 'POWER_LIMITED' in output) == (0, '', False)


# Refusals

def without(leg, left_out):
    return {key: value for key, value in leg.items() if key != left_out}


@pytest.mark.parametrize('legs, problem', [
    ([without(FIRST, 'departure_soc'), LAST],
     'legs[0]: missing departure_soc of the stop at its end'),
    ([LAST, LAST], 'legs[0]: missing stop_duration_s, departure_temperature_c, departure_soc of '
     'the stop at its end'),
    ([FIRST, FIRST], 'legs[1]: stop_duration_s, departure_temperature_c, departure_soc not '
     'allowed: no stop lies behind the last leg'),
    ([FIRST, {**LAST, 'minimum_arrival_soc': -0.5}],
     'legs[1].minimum_arrival_soc: -0.5 is not allowed; it must be at least 0 and at most 1'),
    ([FIRST, {**LAST, 'target_battery_temperature_c': 'warm'}],
     "legs[1].target_battery_temperature_c: 'warm' is not a number"),
    ([FIRST, {**LAST, 'target': 20}], "legs[1]: unknown key 'target'; "),
    ([without(FIRST, 'route'), LAST], 'legs[0]: missing route'),
    ([FIRST, {**LAST, 'route': 'winter_comute'}],
     "legs[1].route: route 'winter_comute' is unknown; did you mean 'winter_commute'?"),
    ([FIRST, {**LAST, 'route': './no.csv'}], 'no.csv: no such file'),
    ([FIRST, {**LAST, 'route': 'cycle.csv'}], 'give it [degC], such as: ambient_temperature_c: -5 beside route'),
], ids=['missing', 'missing all', 'beyond', 'minimum', 'text', 'unknown', 'no route', 'route', 'file', 'ambient'])
def test_a_bad_itinerary_is_refused_with_file_and_key(refused, trip, legs, problem):
    found = refused(*trip(*legs))
    assert 'trip.yaml: ' in found and problem in found


@pytest.mark.parametrize('arguments, problem', [
    (('--min-soc', '0.2'), '--min-soc: not allowed with --itinerary, because each leg has its own'),
    (('--target', '30'), '--target: not allowed with this itinerary, because each charging leg has its own'),
    (('--ambient', '3'), '--ambient: not allowed with --itinerary'),
    (('--no-charging',), '--no-charging: not allowed with --itinerary, because each leg has its own'),
    (('--itinerary', 'winter_holidy'), "itinerary 'winter_holidy' is unknown; did you mean 'winter_holiday'?")])
def test_other_arguments_are_refused(refused, trip, arguments, problem):
    assert refused(*trip(FIRST, LAST), *arguments).startswith(problem)


def test_a_file_may_hold_as_many_stops_as_the_node_plans():
    schema = yaml.safe_load(SCHEMA.read_text())
    assert schema['properties']['legs']['maxItems'] == MOST_STOPS + 1
