# SPDX-License-Identifier: Apache-2.0
"""`preheat route --from` and `preheat plan --route` with files of navigation and drive cycles."""

import json

import pytest
import route_examples as examples

from bev_preheat.errors import InvalidInput
from bev_preheat.route.csv_file import load_file_route
from bev_preheat.vehicle import load_vehicle

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
    assert load_file_route(tmp_path / 'made.csv', CAR.defaults).made_for == 'small_car'


def test_charging_stops_are_written_and_read_again(preheat, tmp_path):
    assert preheat('route', '--from', 'answer.json', '--ambient', '-5', '--stop-duration', '20',
                   '--output', 'made.csv')[0] == 0
    route = load_file_route(tmp_path / 'made.csv', CAR.defaults)
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
            load_file_route(tmp_path / 'made.csv', CAR.defaults)


def test_the_comparison_with_averages_is_printed(preheat):
    status, output, _ = preheat('route', '--from', 'cycle.csv', '--ambient', '5', '--averages', '20', '60',
                                '--output', 'made.csv')
    rows = [line for line in output.splitlines() if ' s │' in line]
    assert status == 0 and len(rows) == 2 and all(row.count('%') == 4 for row in rows)


@pytest.mark.parametrize('arguments, problem', [
    (('route', '--from', 'made.csv', '--output', 'out.csv'), 'is a route file with powers already'),
    (('route', '--legs', 'reference', '--ambient', '3', '--output', 'out.csv'), '--ambient: only with --from'),
    (('route', '--from', 'nowhere.gpx', '--output', 'out.csv'), 'nowhere.gpx: no such file'),
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
