# SPDX-License-Identifier: Apache-2.0
"""`preheat route` from descriptions, logs, navigation and drive cycles, and `preheat plan` with such files."""

import json

import pytest
import route_examples as examples

from bev_preheat.errors import InvalidInput
from bev_preheat.route import load_route, route_for
from bev_preheat.vehicle import load_vehicle

CAR = load_vehicle('small_car')
STATE = ('--temperature', '0', '--soc', '0.8')
MAKE = ('route', '--output', 'made.csv')


@pytest.fixture(autouse=True)
def files(tmp_path):
    (tmp_path / 'answer.json').write_text(examples.osrm(legs=2))
    (tmp_path / 'cycle.csv').write_text(examples.speed_table())
    (tmp_path / 'powers.csv').write_text(
        'duration_s,speed_mps,propulsion_power_w,ambient_temperature_c\n30,20,15000,-5\n')


@pytest.fixture
def preheat(said):
    """Run the command with the small car; returns exit status, standard output and standard error."""
    return lambda *arguments: said(*arguments, '--vehicle', 'small_car')


def test_a_drive_log_becomes_a_route(preheat, tmp_path):
    # 360 V and 50 A, 20 m/s, 900 W cabin heating; two seconds are missing.
    rows = [f'{second},20,360,50,900,-3' for second in range(90) if second not in (40, 41)]
    (tmp_path / 'drive.csv').write_text('\n'.join([
        'time_s,speed_mps,voltage_v,current_a,cabin_heater_w,ambient_c', *rows]), encoding='utf-8')
    status, output, _ = preheat(*MAKE, '--log', 'drive.csv', '--step', '45')
    assert status == 0
    route = load_route('made.csv', None)
    assert route.duration_s.tolist() == [45.0, 45.0]
    assert route.propulsion_power_w.tolist() == [360.0 * 50.0 - 900.0 - CAR.defaults.auxiliary_power_w] * 2
    assert 'Route drive\n' in output
    assert ('note: drive.csv: speed_mps and power_w: 3 s without a valid sample, from 39 s to 42 s, are bridged'
            in output)


@pytest.mark.costly
def test_a_plot_has_title_units_and_legend(preheat, tmp_path):
    status, output, _ = preheat(*MAKE, '--legs', 'winter_commute', '--plot', 'route.svg')
    assert status == 0 and 'drawn: route.svg' in output
    # matplotlib names each text in a comment of the SVG.
    text = (tmp_path / 'route.svg').read_text(encoding='utf-8')
    for words in ('route winter_commute', 'km/h', 'kW', '°C', 'trip time [min]', 'mean of the segment',
                  'standard deviation within the segment'):
        assert words in text


def test_a_plan_of_a_file_is_that_of_the_route_made_from_it(preheat, tmp_path):
    status, output, _ = preheat(*MAKE, '--from', 'answer.json', '--ambient', '-5')
    assert status == 0 and 'written: made.csv' in output
    plans = []
    for route in (('answer.json', '--ambient', '-5'), ('made.csv',)):
        assert preheat('plan', '--route', *route, *STATE, '--json', 'plan.json')[0] == 0
        plans.append(json.loads((tmp_path / 'plan.json').read_text()))
    trajectories = [[value for key, value in plan.items() if 'temperature' in key] for plan in plans]
    assert trajectories[0] == trajectories[1] and trajectories[0]
    assert route_for(tmp_path / 'made.csv', CAR).made_for == 'small_car'


def test_charging_stops_are_written_and_read_again(preheat, tmp_path):
    assert preheat(*MAKE, '--from', 'answer.json', '--ambient', '-5', '--stop-duration', '20')[0] == 0
    route = route_for(tmp_path / 'made.csv', CAR)
    stop, = route.stops
    half_s = 0.5 * examples.LENGTH_M / examples.SPEED_MPS
    assert route.route.time_s[stop.after_segment + 1] == pytest.approx(half_s, rel=0.01)
    assert stop.duration_s == 1200.0
    status, _, errors = preheat('plan', '--route', 'made.csv', *STATE)
    assert status == 0 and 'planned up to the charging stop, after 8 min' in errors
    text = (tmp_path / 'made.csv').read_text()
    for wrong in ('0, 1200', '99, 1200', '5, 0'):
        (tmp_path / 'made.csv').write_text(
            text.replace(f'segment {stop.after_segment + 1}, 1200', f'segment {wrong}'))
        with pytest.raises(InvalidInput, match='charging stop: .* is not allowed; it must be'):
            route_for(tmp_path / 'made.csv', CAR)


def test_the_comparison_with_averages_is_printed(preheat):
    status, output, _ = preheat(*MAKE, '--from', 'cycle.csv', '--ambient', '5', '--averages', '20', '60')
    rows = [line for line in output.splitlines() if ' s │' in line]
    assert status == 0 and len(rows) == 2 and all(row.count('%') == 4 for row in rows)


@pytest.mark.parametrize('arguments, problem', [
    ((*MAKE, '--legs', 'winter_comute'), "'winter_comute' is unknown; did you mean 'winter_commute'"),
    ((*MAKE, '--legs', 'reference', '--step', '10'),
     '--step: not allowed with --legs, whose file states segment_duration_s'),
    ((*MAKE, '--legs', 'reference', '--ambient', '3'), '--ambient: only with --from'),
    ((*MAKE, '--log', 'nowhere.csv'), 'nowhere.csv: no such file'),
    ((*MAKE, '--from', 'nowhere.gpx'), 'nowhere.gpx: no such file'),
    ((*MAKE, '--from', 'powers.csv'), 'is a route file with powers already'),
    ((*MAKE, '--from', 'trip.yaml'), 'is a description of legs; use --legs trip.yaml'),
    (('plan', '--route', 'powers.csv', '--ambient', '3', *STATE),
     'has its own ambient temperature; leave out --ambient'),
    (('plan', '--route', 'cycle.csv', '--ambient', '300', *STATE), '--ambient: 300 degC is not allowed'),
    ((*MAKE, '--from', 'answer.json', '--ambient', '3', '--stop-duration', '-1'),
     '--stop-duration: -1 min is not allowed'),
    (('plan', '--route', 'bare.yaml', '--ambient', '3', *STATE), 'legs[0]: missing ambient_temperature_c'),
    ((*MAKE, '--from', 'answer.json', '--ambient', '3', '--averages', '30'), '--averages: needs a drive cycle')])
def test_mistakes_have_one_line(refused, tmp_path, arguments, problem):
    (tmp_path / 'bare.yaml').write_text('name: bare\nlegs: [{length_m: 9000, speed_limit_kmh: 80}]\n')
    assert problem in refused(*arguments, '--vehicle', 'small_car')
