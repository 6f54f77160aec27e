# SPDX-License-Identifier: Apache-2.0
"""Results as people see them in Python, functions as methods, wrong arguments, routes without some figures."""

import base64
import json
from operator import methodcaller
from pathlib import Path
import re

import numpy as np
import pytest
import route_examples as examples

import bev_preheat as bp
from bev_preheat.logs.recording import Series

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'reference' / 'python.md'
STATE = bp.BatteryState(-7.0, 0.9)
# A line of a terminal and a half.
MOST_CHARACTERS = 160
# As IPython asks for it.
in_a_notebook = methodcaller('_repr_html_')


def last_20_minutes(situation):
    """Heat for the last 20 minutes."""
    return situation.full_power(situation.time_s[-1] - 1200.0)


@pytest.fixture(scope='module')
def results(vehicle, route, worth, session, drive):
    endless = bp.charging_session(vehicle, bp.BatteryState(5.0, 0.2), 1e3, 0.8, -7.0, auxiliary_power_w=2e3)
    return {'plan': bp.plan(vehicle, route, STATE), 'worth': worth, 'session': session,
            'endless session': endless, 'drive': drive}


NAMES = ('plan', 'worth', 'session', 'endless session', 'drive')


@pytest.mark.parametrize('name', NAMES)
def test_the_text_of_a_result_is_one_short_line_with_its_figures(results, name):
    result = results[name]
    text = repr(result)
    assert len(text) <= MOST_CHARACTERS and '\n' not in text
    figures = {'plan': lambda: f'{result.arrival_temperature_c:.1f} degC',
               'worth': lambda: f'{result.best_target_c:.1f} degC',
               'session': lambda: f'{result.charging_time_s / 60.0:.1f} min',
               'endless session': lambda: result.problem,
               'drive': lambda: f'{result.arrival_error_k:+.2f} K'}
    assert figures[name]() in text and text.startswith(f'<{type(result).__name__}: ')


def test_the_texts_of_inputs_are_short(vehicle, route):
    assert repr(route) == '<Route: 120 segments, 60.0 min, 73.0 km, -7.0 ... -7.0 degC>'
    recording = bp.Recording('a', {'soc': Series(np.array([0.0, 90.0]), np.array([0.8, 0.7]))})
    assert repr(recording) == '<Recording a: 1.5 min; soc>'
    assert repr(vehicle).startswith('<Vehicle reference: heater 7 kW')


@pytest.mark.needs('matplotlib')
@pytest.mark.parametrize('name', NAMES)
def test_a_notebook_shows_line_and_picture(results, name):
    page = in_a_notebook(results[name])
    picture = re.fullmatch(r'<p>(.*)</p><img alt="" src="data:image/png;base64,(.*)">', page)
    assert picture[1].replace('&#x27;', "'") == results[name].in_words()
    assert base64.b64decode(picture[2]).startswith(b'\x89PNG')


def test_without_matplotlib_a_notebook_shows_the_line(results, monkeypatch):
    monkeypatch.setattr('bev_preheat.interface.results.is_installed', lambda module: False)
    assert in_a_notebook(results['plan']) == f'<p>{results["plan"].in_words()}</p>'


@pytest.mark.needs('matplotlib')
@pytest.mark.parametrize('name', NAMES)
def test_plot_returns_the_axes(results, name, tmp_path):
    from matplotlib.figure import Figure
    axis = Figure().subplots()
    assert results[name].plot(ax=axis) is axis
    assert axis.get_lines() and axis.get_ylabel() and axis.get_xlabel()
    axes = results[name].plot()
    assert len(axes) > 1 and len({each.figure for each in axes}) == 1
    with pytest.raises(bp.InvalidInput, match='^plot: file and ax are given; give file or ax$'):
        results[name].plot(tmp_path / 'a.png', axis)


def test_a_function_is_a_method(vehicle, route, short_route):
    plan = bp.plan(vehicle, route, STATE, method=last_20_minutes)
    expected_w = np.where(route.time_s[1:] > route.total_duration_s - 1200.0 + 1e-6,
                          vehicle.hvch.maximum_power_w - route.cabin_heating_power_w, 0.0)
    np.testing.assert_allclose(plan.hvch_battery_power_w, expected_w)
    # 20 min are more than the whole drive: the heater is on, although the target is reached.
    drive = bp.drive(vehicle, short_route, bp.BatteryState(20.0, 0.9), method=last_20_minutes,
                     sensors=bp.Sensors(period_s=4.0))
    assert drive.arrival_error_k > 3.0 and (drive.command_w[2:len(drive.command_w) // 2] > 0.0).all()
    assert bp.methods() == ('value_function', 'optimal_switch', 'paper')


@pytest.mark.needs('casadi')
def test_functions_are_compared(vehicle, route):
    compared = bp.compare(vehicle, route, STATE, methods=['value_function', last_20_minutes])
    assert list(compared.plans) == ['value_function', 'function last_20_minutes']
    assert len(repr(compared)) <= MOST_CHARACTERS and len(repr(compared.optimum)) <= MOST_CHARACTERS
    with pytest.raises(bp.InvalidInput, match='two functions have the same name'):
        bp.compare(vehicle, route, STATE, methods=[lambda one: 0, lambda other: 0])


@pytest.mark.parametrize('call, problem', [
    (lambda vehicle, route: bp.plan('reference', route, STATE), 'vehicle: must be a Vehicle, .* not str'),
    (lambda vehicle, route: bp.plan(vehicle, 'reference', STATE), 'route: must be a Route, .* not str'),
    (lambda vehicle, route: bp.plan(vehicle, route, (-7.0, 0.9)), r'state: must be a BatteryState .* not tuple'),
    (lambda vehicle, route: bp.plan(vehicle, route, bp.BatteryState('-7', 0.9)), 'state: must be a BatteryState'),
    (lambda vehicle, route: bp.plan(vehicle, route, bp.BatteryState(-7.0, soc=80.0)),
     r'^state of charge: 80 is not allowed; it must be 0 \.\.\. 1'),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE, '25'), 'goal: must be a Goal or a number .* str'),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE, bp.Goal('25')), 'goal: must be a Goal or a number'),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE, method=3), "method: must be the name .* not int '3'"),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE, method='best'), "method: 'best' is not one of"),
    (lambda vehicle, route: bp.compare(vehicle, route, STATE, methods='paper'), 'methods: must be a list'),
    (lambda vehicle, route: bp.worth(vehicle, route, STATE, '150', 0.8), 'charger_power_w: must be a number'),
    (lambda vehicle, route: bp.worth(vehicle, route, STATE, True, 0.8), 'charger_power_w: must be a number'),
    (lambda vehicle, route: bp.charging_session(vehicle, STATE, 150e3, 0.8, None), 'ambient_c: must be a number'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, seed=0.5), 'seed: must be a whole number'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, mismatch=1.1), 'mismatch: must be a Mismatch'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, sensors=1), 'sensors: must be Sensors'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, heater_faults=['dead']),
     'heater_faults: must be a list of HeaterFaults'),
    # As in a scenario file.
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, mismatch=bp.Mismatch(heat_capacity=-1.0)),
     r'mismatch.heat_capacity: -1.* must be .*0.3'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, mismatch=bp.Mismatch(heater=np.float64('nan'))),
     'mismatch.heater: nan'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, sensors=bp.Sensors(period_s=0)),
     'sensors.period_s: 0'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, heater_faults=[bp.HeaterFault(0.0, share=2.0)]),
     r'heater_faults\[0\].share: 2'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, heater_faults=[bp.HeaterFault(9.0, 5.0)]),
     r'heater_faults\[0\]: \[9, 5\] must rise'),
    (lambda vehicle, route: bp.drive(vehicle, route, STATE, heater_faults=[bp.HeaterFault(0.0, source='pump')]),
     'pump'),
    (lambda vehicle, route: bp.load_recording('log.csv', repair='yes'), 'repair: must be True or False'),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE).plot('plan.txt'), 'file: plan.txt: must end in .png'),
    (lambda vehicle, route: bp.plan(vehicle, route, STATE).plot(ax=3), 'ax: must be Axes of Matplotlib, not int'),
    (lambda vehicle, route: bp.check(vehicle, 'log.csv'), 'recordings: must be a list of Recordings'),
    (lambda vehicle, route: bp.identify(vehicle, ['log.csv']), 'recordings: must be a list of Recordings'),
    (lambda vehicle, route: bp.load_vehicle(3), "name_or_file: must be a name or a path .* not int '3'"),
    (lambda vehicle, route: bp.make_route([1.0], vehicle), 'columns: must be a dictionary'),
    (lambda vehicle, route: bp.make_route({'duration_s': 'long'}, vehicle), 'duration_s: must be numbers'),
    (lambda vehicle, route: bp.load_recording(None), 'file: must be a name or a path')])
def test_a_wrong_argument_is_refused_with_what_is_allowed(vehicle, route, call, problem):
    with pytest.raises(bp.InvalidInput, match=problem):
        call(vehicle, route)


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / 'route'
        path.write_text(text)
        return path
    return write


def test_figures_that_a_file_lacks_are_arguments(file):
    car = bp.load_vehicle('small_car')
    cycle = file(examples.speed_table())
    with pytest.raises(bp.InvalidInput, match=r'no ambient temperature; give it \[degC\], such as: ambient_c=-5$'):
        bp.load_route(cycle, car)
    route = bp.load_route(cycle, car, ambient_c=-5.0)
    assert (route.ambient_temperature_c == -5.0).all()
    line = file(examples.geojson(times=False))
    with pytest.raises(bp.InvalidInput, match='such as: free_speed_kmh=90'):
        bp.load_route(line, car, ambient_c=-5.0)
    route = bp.load_route(line, car, ambient_c=-5.0, free_speed_kmh=72.0)
    assert route.total_duration_s == pytest.approx(examples.LENGTH_M / 20.0, rel=0.05)
    segments = file(examples.segments_json())
    with pytest.raises(bp.InvalidInput, match="consumption='total' or consumption='drivetrain'"):
        bp.load_route(segments, car, ambient_c=-5.0)
    with pytest.raises(bp.InvalidInput, match="consumption: must be 'total' or 'drivetrain', not 'all'"):
        bp.load_route(segments, car, ambient_c=-5.0, consumption='all')
    route = bp.load_route(segments, car, ambient_c=-5.0, consumption='drivetrain')
    assert route.propulsion_power_w @ route.duration_s / 3.6e6 == pytest.approx(2.5 + 5.1)


def test_a_way_with_charging_stops_is_one_route_a_leg(file):
    car, text = bp.load_vehicle('small_car'), examples.tomtom(charging_s=900.0)
    legs = [bp.load_route(file(text), car, ambient_c=-5.0, leg=leg) for leg in (0, 1)]
    assert [leg.distance_m for leg in legs] == pytest.approx(examples.HALF_M)
    assert bp.load_route(file(text), car, ambient_c=-5.0, leg=None).distance_m == pytest.approx(examples.LENGTH_M)
    with pytest.raises(bp.InvalidInput, match=r'^leg: 2 is not allowed; it must be 0 \.\.\. 1$'):
        bp.load_route(file(text), car, ambient_c=-5.0, leg=2)


@pytest.mark.needs('casadi')
def test_a_sweep_in_python_is_that_of_the_command(vehicle, capsys):
    from bev_preheat.commands.main import main
    swept = bp.sweep(vehicle, 2)
    assert main(['sweep', '--feasible', '2', '--jobs', '1', '--json', '-']) == 0
    shown = json.loads(capsys.readouterr().out)['results']
    assert [trip['optimal_energy_wh'] for trip in swept.to_dict()['results']] == pytest.approx(
        [trip['optimal_energy_wh'] for trip in shown])
    # A table instead of a formula for the resistance.
    assert len(bp.sweep(bp.load_vehicle('small_car'), 1).to_dict()['results']) == 1
    assert repr(swept).startswith('<SweepResult: 2 trips; above the optimum at most: value_function 0.0')
    with pytest.raises(bp.InvalidInput, match='a function is known in this process only; leave out jobs'):
        bp.sweep(vehicle, 2, methods=[last_20_minutes], jobs=2)
    with pytest.raises(bp.InvalidInput, match=r'^feasible: 0 is not allowed; it must be 1 \.\.\. 100000$'):
        bp.sweep(vehicle, 0)


def test_robustness_in_python(vehicle, short_route):
    result = bp.robustness(vehicle, short_route, bp.BatteryState(20.0, 0.9), trips=1)
    assert repr(result).startswith('<RobustnessResult: 1 trips; worst error on arrival: ')
    [trip] = result.to_dict()['results']
    assert result.summary['planner']['arrival_error_k']['worst'] == trip['methods']['planner']['arrival_error_k']
    with pytest.raises(bp.InvalidInput, match="^fault: 'broken' is not one of none, "):
        bp.robustness(vehicle, short_route, STATE, fault='broken')


@pytest.mark.needs('casadi')
def test_the_reproduction_in_python():
    result = bp.reproduce()
    assert len(repr(result)) <= MOST_CHARACTERS
    paper = {(cell['column'], cell['row']): cell['paper'] for cell in result.to_dict()['cells']}
    # Table II of the paper.
    assert paper['NLP', 'joule'] == 361.4 and paper['heuristic', 'hvch_heat'] == 2038.9


def test_the_page_shows_what_its_examples_print():
    """The example runs; each comment behind a print has the figures that it prints, each text the line."""
    code = re.findall(r'```python\n(.*?)```', PAGE.read_text(), re.DOTALL)[0]
    shown = []
    space = {'print': lambda *values: shown.append(values)}
    exec(code, space)  # the project's own page
    comments = re.findall(r'^print\(.*\)\s+# (.*)$', code, re.MULTILINE)
    assert len(comments) == len(shown) > 3
    for comment, values in zip(comments, shown):
        for value in values:
            if not isinstance(value, float):
                assert str(value) == comment or str(value) in comment, comment
                continue
            assert re.search(rf'(?<![\d.]){re.escape(f"{value:.1f}")}(?!\d)', comment), (comment, value)
