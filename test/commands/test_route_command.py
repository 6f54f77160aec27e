# SPDX-License-Identifier: Apache-2.0
"""
`preheat route` from descriptions, drive logs, navigation and drive cycles: files, tables and plots.

Files of navigation and cycles are also given to `preheat plan --route`.
"""

from dataclasses import fields
import json
import subprocess
import sys

import numpy as np
import pytest
import route_examples as examples

from bev_preheat.errors import InvalidInput
from bev_preheat.route import load_route, route_for
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import load_vehicle

LEGS = """
name: to_the_shop
ambient_temperature_c: [3, 1]
cabin_heating_power_w: 1200
maximum_regeneration_power_w: 50000
driving: {acceleration_mps2: 1.1, deceleration_mps2: 1.3}
legs:
  - {length_m: 1500, speed_limit_kmh: 50, stops: 2, stop_duration_s: 10}
  - {length_m: 2000, speed_limit_kmh: 80}
"""


ROUTE = ['route', '--output', 'made.csv']


def test_a_shipped_description_by_name_makes_the_shipped_route(said):
    assert said(*ROUTE, '--legs', 'winter_commute', '--vehicle', 'reference')[0] == 0
    made, shipped = load_route('made.csv', None), load_route('winter_commute', None)
    for field in fields(Route):
        np.testing.assert_allclose(getattr(made, field.name), getattr(shipped, field.name),
                                   atol=0.0011 if field.name.endswith('_w') else 1.1e-6)


def test_a_drive_log_becomes_a_route(said, tmp_path):
    # 360 V and 50 A, 20 m/s, 900 W cabin heating; two seconds are missing.
    rows = [f'{second},20,360,50,900,-3' for second in range(90) if second not in (40, 41)]
    (tmp_path / 'drive.csv').write_text('\n'.join([
        'time_s,speed_mps,voltage_v,current_a,cabin_heater_w,ambient_c', *rows]), encoding='utf-8')
    status, out, _ = said(*ROUTE, '--log', 'drive.csv', '--vehicle', 'small_car', '--step', '45')
    assert status == 0
    route = load_route('made.csv', None)
    auxiliary_w = load_vehicle('small_car').defaults.auxiliary_power_w
    assert route.duration_s.tolist() == [45.0, 45.0]
    assert route.propulsion_power_w.tolist() == [360.0 * 50.0 - 900.0 - auxiliary_w] * 2
    assert 'Route drive\n' in out
    assert ('note: drive.csv: speed_mps and power_w: 3 s without a valid sample, from 39 s to 42 s, are bridged'
            in out)


@pytest.mark.costly
def test_a_plot_has_title_units_and_legend(said, tmp_path):
    (tmp_path / 'shop.yaml').write_text(LEGS, encoding='utf-8')
    status, out, _ = said(*ROUTE, '--legs', 'shop.yaml', '--vehicle', 'small_car', '--plot', 'route.svg')
    assert status == 0 and 'drawn: route.svg' in out
    # matplotlib names each text in a comment of the SVG.
    text = (tmp_path / 'route.svg').read_text(encoding='utf-8')
    for words in ('route to_the_shop', 'km/h', 'kW', '°C', 'trip time [min]',
                  'mean of the segment', 'standard deviation within the segment'):
        assert words in text


@pytest.mark.parametrize('arguments, problem', [
    (['--legs', 'winter_comute', '--vehicle', 'reference'],
     "'winter_comute' is unknown; did you mean 'winter_commute'"),
    (['--legs', 'reference', '--vehicle', 'reference', '--step', '10'],
     '--step: only with --log; a description of legs states its own segment_duration_s'),
    (['--log', 'nowhere.csv', '--vehicle', 'small_car'],
     'nowhere.csv: no such file'),
    (['--log', 'nowhere.csv', '--vehicle', 'smal_car'],
     "vehicle 'smal_car' is unknown; did you mean 'small_car'?"),
])
def test_input_that_is_refused_is_explained(refused, tmp_path, arguments, problem):
    assert problem in refused(*ROUTE, *arguments)
    assert not (tmp_path / 'made.csv').exists()


@pytest.mark.costly
def test_matplotlib_is_imported_for_plots_only():
    # It may be missing on the planner's computer, and is slow to import.
    code = ('import sys; import bev_preheat.commands.route; '
            'print([name for name in ("matplotlib", "scipy", "casadi") if name in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == '[]'


# --- Files of navigation and drive cycles ---

CAR = load_vehicle('small_car')
STATE = ('--temperature', '0', '--soc', '0.8')


@pytest.fixture
def preheat(said, tmp_path):
    """Run the command in a folder with examples; returns exit status, standard output and standard error."""
    (tmp_path / 'answer.json').write_text(examples.osrm(legs=2))
    (tmp_path / 'cycle.csv').write_text(examples.speed_table())
    return lambda *arguments: said(*arguments, '--vehicle', 'small_car')


def test_a_plan_of_a_file_is_that_of_the_route_made_from_it(preheat, tmp_path):
    status, output, _ = preheat('route', '--from', 'answer.json', '--ambient', '-5', '--output', 'made.csv')
    assert status == 0 and 'written: made.csv' in output
    plans = []
    for route in (('answer.json', '--ambient', '-5'), ('made.csv',)):
        assert preheat('plan', '--route', *route, *STATE, '--json', 'plan.json')[0] == 0
        plans.append(json.loads((tmp_path / 'plan.json').read_text()))
    trajectories = [[value for key, value in plan.items() if 'temperature' in key] for plan in plans]
    assert trajectories[0] == trajectories[1] and trajectories[0]
    assert route_for(tmp_path / 'made.csv', CAR).made_for == 'small_car'


def test_charging_stops_are_written_and_read_again(preheat, tmp_path):
    assert preheat('route', '--from', 'answer.json', '--ambient', '-5', '--stop-duration', '20',
                   '--output', 'made.csv')[0] == 0
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
    status, output, _ = preheat('route', '--from', 'cycle.csv', '--ambient', '5', '--averages', '20', '60',
                                '--output', 'made.csv')
    rows = [line for line in output.splitlines() if ' s │' in line]
    assert status == 0 and len(rows) == 2 and all(row.count('%') == 4 for row in rows)


@pytest.mark.parametrize('arguments, problem', [
    (('route', '--from', 'made.csv', '--output', 'out.csv'), 'is a route file with powers already'),
    (('route', '--legs', 'reference', '--ambient', '3', '--output', 'out.csv'), '--ambient: only with --from'),
    (('route', '--from', 'nowhere.gpx', '--output', 'out.csv'), 'nowhere.gpx: no such file'),
    (('route', '--from', 'trip.yaml', '--output', 'out.csv'), 'is a description of legs; use --legs trip.yaml'),
    (('plan', '--route', 'made.csv', '--ambient', '3', *STATE),
     'has its own ambient temperature; leave out --ambient'),
    (('plan', '--route', 'cycle.csv', '--ambient', '300', *STATE), '--ambient: 300 degC is not allowed'),
    (('route', '--from', 'answer.json', '--ambient', '3', '--stop-duration', '-1', '--output', 'out.csv'),
     '--stop-duration: -1 min is not allowed'),
    (('route', '--from', 'answer.json', '--ambient', '3', '--averages', '30', '--output', 'out.csv'),
     '--averages: needs a drive cycle')])
def test_mistakes_have_one_line(preheat, arguments, problem):
    preheat('route', '--from', 'cycle.csv', '--ambient', '-5', '--output', 'made.csv')
    status, _, errors = preheat(*arguments)
    assert status == 2 and problem in errors and errors.count('\n') == 1
