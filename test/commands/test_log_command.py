# SPDX-License-Identifier: Apache-2.0
"""`preheat log`: table, JSON, picture, refusals; `preheat route --log` with a signal map."""

import json

import pytest

LOG = 'time_s;v;T;SOC;U;I;out\n' + ''.join(
    f'{17 * at};{36 + at};{4 + at / 8};{800_000 - 4000 * at};370;-{20 + at % 5};-3\n' for at in range(40))
MAP = """
signals:
  battery_temperature_c: {channels: T, unit: degC}
  soc: {channels: SOC, unit: percent, scale: 0.0001}
  voltage_v: U
  current_a: {channels: I, positive: charging}
  speed_mps: {channels: v, unit: km/h}
  ambient_c: {channels: out, unit: degC}
"""


@pytest.fixture(autouse=True)
def log(tmp_path):
    (tmp_path / 'map.yaml').write_text(MAP, encoding='utf-8')
    (tmp_path / 'drive.csv').write_text(LOG, encoding='utf-8')


def test_json_has_the_signals_in_si_units(said):
    found = json.loads(said('log', 'drive.csv', '--signals', './map.yaml', '--json', '-')[1])
    assert found['signals'].keys() == {'battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'speed_mps',
                                       'ambient_c', 'power_w'}
    assert all(entry.keys() == {'min', 'max', 'samples'} for entry in found['signals'].values())
    assert found['signals']['soc'] == pytest.approx({'min': 0.644, 'max': 0.8, 'samples': 40})
    assert found['signals']['power_w'] == {'min': 7400.0, 'max': 8880.0, 'samples': 40}
    assert [found[key] for key in ('format', 'signal_map', 'start', 'duration_s')] == ['CSV', 'map', None, 663.0]
    assert found['sampling']['soc'] == {'interval_s': 17.0, 'gaps': 0, 'longest_gap_s': 0.0}
    assert found['sources']['current_a'] == ['I']
    assert found['remarks'] == []


@pytest.mark.needs('matplotlib')
def test_table_and_picture(said, tmp_path):
    status, out, _ = said('log', 'drive.csv', '--signals', './map.yaml', '--plot', 'drive.png')
    out = ' '.join(out.split())
    assert status == 0
    assert 'battery_temperature_c │ 4 │ 8.875 │ 40 │ 17 │' in out
    assert 'current_a: from I' in out
    assert (tmp_path / 'drive.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('arguments, problem', [
    (['log', 'drive.csv', '--signals', 'absent'], "signal map 'absent' is unknown"),
    (['log', 'drive.csv', '--plot', 'a.txt'], '--plot'),
    (['route', '--legs', 'alpine_pass', '--repair', '--vehicle', 'small_car', '--output', 'a.csv'],
     '--signals and --repair: only with --log')])
def test_wrong_arguments_are_refused_in_one_line(refused, arguments, problem):
    assert problem in refused(*arguments)
