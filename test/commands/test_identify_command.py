# SPDX-License-Identifier: Apache-2.0
"""`preheat check` and `preheat identify` on logs that the simulated drives of a synthetic car wrote."""

import json

import numpy as np
import pytest

from bev_preheat.vehicle import load_vehicle

COLUMNS = ('battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'speed_mps', 'ambient_c', 'cabin_heater_w',
           'auxiliary_w')


@pytest.fixture(scope='module')
def logs(tmp_path_factory):
    from bev_preheat_studies.identification.synthetic_car import draw_car, record_car
    folder, generator = tmp_path_factory.mktemp('logs'), np.random.default_rng(11)
    car = draw_car(generator, load_vehicle('small_car'))
    paths = []
    for recording in record_car(car, generator, heats=False)[:4]:
        path = folder / f'{recording.name.replace(" ", "_")}.csv'
        series = recording.signals
        rows = np.column_stack([series['soc'].time_s, *(series[name].value for name in COLUMNS)])[:600]
        np.savetxt(path, rows, '%.5g', ',', header=','.join(('time_s', *COLUMNS)), comments='')
        paths.append(str(path))
    return paths


def test_check_writes_its_figures_and_keeps_the_bound(logs, tmp_path, said):
    words = ['check', *logs[:2], '--vehicle', 'small_car', '--no-replay', '--json', 'c.json']
    assert said(*words, '--bound', '50')[0] == 0
    figures = json.loads((tmp_path / 'c.json').read_text())
    errors = [trip['arrival_error_k'] for trip in figures['trips']]
    assert [trip['name'] for trip in figures['trips']] == ['drive_1', 'drive_2']
    assert figures['rmse_k'] == pytest.approx(np.sqrt(np.mean(np.square(errors))))
    assert figures['worst_k'] == pytest.approx(np.max(np.abs(errors)))
    for trip in figures['trips']:
        assert trip['arrival_error_k'] == pytest.approx(
            trip['predicted_arrival_temperature_c'] - trip['measured_arrival_temperature_c'])
    status, output, _ = said(*words, '--bound', f'{0.5 * figures["worst_k"]}')
    assert status == 1 and 'exceeds the bound' in output


@pytest.mark.needs('matplotlib')
def test_check_draws(logs, tmp_path, said):
    assert said('check', logs[0], '--vehicle', 'small_car', '--no-replay', '--plot', 'c.png')[0] == 0
    assert (tmp_path / 'c.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('text, problem', [
    ('these are words\nand more\n', 'log.csv: is text, but no log'),
    ('time_s,soc,ambient_c,power_w\n' + '\n'.join(f'{at},0.5,0,9000' for at in range(300)),
     'log: no battery_temperature_c')])
def test_a_log_that_tells_nothing_is_refused(refused, tmp_path, text, problem):
    (tmp_path / 'log.csv').write_text(text)
    assert refused('check', 'log.csv', '--vehicle', 'small_car').startswith(problem)


@pytest.mark.parametrize('bound', ['-1', 'nan'])
def test_a_bound_out_of_range_is_refused(refused, bound):
    assert refused('check', 'log.csv', '--vehicle', 'small_car', '--bound', bound) == (
        f'--bound: {bound} K; it must be 0 ... 100 K')


@pytest.mark.needs('casadi', 'scipy')
def test_identify_refuses_too_few_logs_and_an_existing_file(logs, tmp_path, refused):
    words = ['identify', *logs[:2], '--vehicle', 'small_car', '--output', 'my.yaml']
    assert '2 usable logs; at least 3 are needed' in refused(*words)
    (tmp_path / 'my.yaml').write_text('mine')
    assert 'exists; --force replaces it' in refused(*words)
    assert (tmp_path / 'my.yaml').read_text() == 'mine'


@pytest.mark.costly
@pytest.mark.needs('casadi', 'matplotlib', 'scipy', 'jinja2')
def test_the_identified_file_is_a_vehicle_file_and_predicts_better(logs, tmp_path, said):
    status, output, _ = said('identify', *logs[:3], '--vehicle', 'small_car', '--output', 'my.yaml', '--report',
                             'r.html', '--json', 'i.json')
    assert status == 0 and 'Not told by these logs' in output
    car = load_vehicle('./my.yaml')
    result = json.loads((tmp_path / 'i.json').read_text())
    estimates = {item['name']: item for item in result['parameters']}
    assert car.battery.capacity_ah == pytest.approx(estimates['capacity']['estimate'], rel=1e-4)
    assert car.battery.heat_capacity_j_per_k == pytest.approx(estimates['heat_capacity']['estimate'], rel=1e-4)
    text = (tmp_path / 'r.html').read_text()
    assert text.count('<svg') == 5
    # Self-contained: no picture, style or script from elsewhere.
    assert 'src=' not in text and '<link' not in text and '<script' not in text
    worst = []
    for vehicle in ('small_car', './my.yaml'):
        said('check', *logs[3:], '--vehicle', vehicle, '--no-replay', '--json', 'c.json')
        worst.append(json.loads((tmp_path / 'c.json').read_text())['rmse_k'])
    assert worst[1] < worst[0]


@pytest.mark.deep
@pytest.mark.costly
@pytest.mark.needs('casadi', 'scipy')
def test_a_sensor_of_another_car_gives_no_vehicle_file(logs, tmp_path, said):
    paths = []
    for number, log in enumerate(logs[:3]):
        rows = np.loadtxt(log, delimiter=',', skiprows=1)[:800]
        # Column 1 is the temperature: it falls and rises against all physics.
        rows[:, 1] = np.round(10.0 + (-1.0)**number * 12.0 * np.sin(rows[:, 0] / 300.0 + number))
        paths.append(str(tmp_path / f'{number}.csv'))
        np.savetxt(paths[-1], rows, '%.5g', ',', header=','.join(('time_s', *COLUMNS)), comments='')
    status, _, errors = said(
        'identify', *paths, '--vehicle', 'small_car', '--output', 'my.yaml', '--json', 'i.json')
    assert status == 2 and 'my.yaml: not written: trips that the fit has not seen' in errors
    assert 'none has the power of a battery heater (battery_heater_w): record it if the car heats' in errors
    assert not (tmp_path / 'my.yaml').exists()
    assert 'should not be trusted' in json.loads((tmp_path / 'i.json').read_text())['verdict'][0]
