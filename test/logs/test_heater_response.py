# SPDX-License-Identifier: Apache-2.0
"""Heaters that warm the battery, told from those that do not, and how a map names them."""

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.heater_response import heater_response
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.recording import Series
from bev_preheat.logs.signal_map import load_signal_map

AMBIENT_C, CAPACITY_J_PER_K, LEAKAGE_W_PER_K, RESISTANCE_OHM = -5.0, 3e5, 15.0, 0.12
TIME_S = np.arange(0.0, 3000.0, 2.0)


def drive(heater_w, share, step_k=0.0):
    """Return signals of a drive by Euler steps; `share` of the heater's power warms the battery."""
    power_w = 18e3 + 12e3 * np.sin(TIME_S / 11.0) + 6e3 * np.sin(TIME_S / 300.0)
    at_c, course = 0.0, []
    for own_w, warm_w in zip(power_w, heater_w):
        course.append(at_c)
        at_c += 2.0 / CAPACITY_J_PER_K * ((own_w / 380.0)**2 * RESISTANCE_OHM + share * warm_w
                                          - LEAKAGE_W_PER_K * (at_c - AMBIENT_C))
    read_c = np.array(course) if step_k == 0.0 else step_k * np.round(np.array(course) / step_k)
    values = {'battery_temperature_c': read_c, 'power_w': power_w + heater_w, 'heater_w': heater_w,
              'ambient_c': np.full(len(TIME_S), AMBIENT_C)}
    return {name: Series(TIME_S, value) for name, value in values.items()}


def switched(begin_s, end_s, power_w=5000.0):
    return np.where((TIME_S >= begin_s) & (TIME_S < end_s), power_w, 0.0)


@pytest.mark.parametrize('step_k', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('times_s', [(600.0, 2400.0), (0.0, 1500.0), (1400.0, 3000.0)])
def test_a_battery_that_is_heated_answers(times_s, step_k):
    response = heater_response(drive(switched(*times_s), 0.87, step_k))
    assert response.energy_j == pytest.approx(5000.0 * (times_s[1] - times_s[0]), rel=0.05)
    assert response.rise_k == pytest.approx(0.87 * response.energy_j / CAPACITY_J_PER_K, rel=0.25)


@pytest.mark.parametrize('step_k', [0.0, 1.0])
def test_a_battery_that_only_the_drive_warms_does_not(step_k):
    for heater_w in (switched(600.0, 2400.0), switched(0.0, 3000.0), switched(0.0, 0.0),
                     1500.0 + 3500.0 * np.exp(-TIME_S / 500.0)):
        assert heater_response(drive(heater_w, 0.0, step_k)) is None


@pytest.fixture
def log(tmp_path):
    signals = drive(switched(600.0, 2400.0), 0.87, 0.5)
    columns = {'t': TIME_S, 'battery_temperature_c': signals['battery_temperature_c'].value,
               'PTC heater power [kW]': signals['heater_w'].value / 1000.0,
               'voltage_v': 380.0 - 2e-4 * signals['power_w'].value,
               'current_a': signals['power_w'].value / 380.0, 'ambient_c': np.full(len(TIME_S), AMBIENT_C),
               'soc': 0.9 - np.cumsum(2.0 * signals['power_w'].value) / 380.0 / 3600.0 / 160.0,
               'speed_mps': np.full(len(TIME_S), 20.0)}
    path = tmp_path / 'warm.csv'
    np.savetxt(path, np.column_stack(list(columns.values())), '%.6g', ',',
               header=','.join(columns).replace('t,', 'time_s,', 1), comments='')
    return path


def test_the_map_that_the_note_shows_names_the_heater(log, tmp_path, said):
    note = next(remark for remark in read_recording(log).remarks if 'answers to it' in remark)
    own = tmp_path / 'own.yaml'
    own.write_text(note[note.index('{extends'):])
    recording = read_recording(log, own)
    assert 'heater_w' not in recording.signals
    assert recording.signals['battery_heater_w'].value.max() == pytest.approx(5000.0)
    assert recording.signals.keys() - {'battery_heater_w'} == read_recording(log).signals.keys() - {'heater_w'}
    assert not any('answers to it' in remark for remark in recording.remarks)
    words = ['check', log, '--vehicle', 'small_hatchback', '--no-replay']
    assert 'answers to it' in ' '.join(said(*words)[1].split())
    status, output, _ = said(*words, '--signals', own)
    assert status == 0 and 'heater_w' not in output.replace('no cabin_heater_w', '')


def test_a_map_extends_one_beside_it_and_keeps_the_rest(tmp_path):
    (tmp_path / 'base.yaml').write_text('no_reading: [255]\ntime: t\nsignals: {soc: A, voltage_v: U}\n')
    (tmp_path / 'own.yaml').write_text('extends: base.yaml\nsignals: {soc: {channels: B, unit: percent}}\n')
    base, own = load_signal_map(tmp_path / 'base.yaml'), load_signal_map(tmp_path / 'own.yaml')
    assert own.name == 'own' and own.time == base.time and own.no_reading == (255.0,)
    assert own.sources['voltage_v'] == base.sources['voltage_v']
    assert own.sources['soc'].channels == ('B',) and own.inherited == {'voltage_v'}


@pytest.mark.parametrize('extends, line', [('own.yaml', 'extends itself'), ('nowhere', 'nowhere')])
def test_a_map_that_extends_itself_or_nothing_is_refused(tmp_path, extends, line):
    (tmp_path / 'own.yaml').write_text(f'extends: {extends}\nsignals: {{soc: A}}\n')
    with pytest.raises(InvalidInput, match=line):
        load_signal_map(tmp_path / 'own.yaml')
