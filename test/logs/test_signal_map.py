# SPDX-License-Identifier: Apache-2.0
"""Signal maps: channels, units, sign, scale, validity; refusals; the maps that ship."""

import pytest
from refusals import problems_of

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.logs.reading import read_recording
from bev_preheat.logs.signal_map import load_signal_map, recognised_map, shipped_maps


def map_file(tmp_path, text):
    path = tmp_path / 'map.yaml'
    path.write_text(text, encoding='utf-8')
    return path


def log_file(tmp_path, header, *rows):
    path = tmp_path / 'drive.csv'
    path.write_text('\n'.join([header, *rows]) + '\n', encoding='utf-8')
    return path


def values(recording, signal):
    return recording.signals[signal].value.tolist()


def test_unit_scale_offset_and_sign_are_those_of_the_map(tmp_path):
    signals = map_file(tmp_path, """
time: when
signals:
  current_a: {channels: I, unit: mA, scale: 1000, positive: charging}
  speed_mps: {channels: v, unit: mph}
  battery_temperature_c: {channels: T, unit: degF, scale: 0.5, offset: -40}
  ambient_c: {channels: outside, unit: K}
""")
    log = log_file(tmp_path, 'when,I,v,T,outside', '0,20,60,160,270.15', '1,-5,30,170,271.15')
    recording = read_recording(log, signals)
    assert values(recording, 'current_a') == pytest.approx([-20.0, 5.0])
    # A mile is 1609.344 m.
    assert values(recording, 'speed_mps') == pytest.approx([26.8224, 13.4112])
    # (160 / 2 - 40 - 32) / 1.8
    assert values(recording, 'battery_temperature_c') == pytest.approx([8.0 / 1.8, 13.0 / 1.8])
    assert values(recording, 'ambient_c') == pytest.approx([-3.0, -2.0])
    assert recording.signal_map == 'map'


@pytest.mark.parametrize('combine, expected', [
    ('mean', [5.0, 14.0 / 3.0]), ('min', [2.0, 2.0]), ('max', [8.0, 8.0]), ('first', [2.0])])
def test_several_temperatures_become_one(tmp_path, combine, expected):
    # A sensor without a reading keeps its last one for a minute.
    signals = map_file(tmp_path, f'signals: {{battery_temperature_c: {{channels: /^T\\d/, combine: {combine}, '
                                 'no_reading: [-40]}}')
    log = log_file(tmp_path, 'time_s,T1,T2,T3', '0,2,5,8', '1,-40,4,none')
    assert values(read_recording(log, signals), 'battery_temperature_c') == pytest.approx(expected)


def test_readings_that_mean_none_are_counted(tmp_path):
    signals = map_file(tmp_path, 'no_reading: [65535]\nsignals: {soc: {channels: S, unit: percent}}')
    log = log_file(tmp_path, 'time_s,S', '0,50', '1,65535', '2,49', '3,65535', '4,48')
    recording = read_recording(log, signals)
    assert values(recording, 'soc') == pytest.approx([0.5, 0.49, 0.48])
    assert recording.remarks == (f'{log}, line 3: S: 65535 means no reading; it is dropped (and 1 more sample)',)


@pytest.mark.parametrize('raw, expected', [
    ('812345', 0.812345), ('8123', 0.8123), ('81.2', 0.812), ('0.81', 0.81)])
def test_one_of_several_scales_is_chosen_by_plausibility(tmp_path, raw, expected):
    log = log_file(tmp_path, 'epoch time,Gids,SOC,Pack Volts,Pack Amps', f'1700000000,1,{raw},370,5',
                   f'1700000017,1,{raw},370,5')
    recording = read_recording(log)
    assert recording.signal_map == 'leafspy'
    assert values(recording, 'soc') == pytest.approx([expected, expected])


@pytest.mark.parametrize('text, problem', [
    ('signals: {}', 'signals: '),
    ('signals: {voltge_v: U}', "signals: unknown key 'voltge_v'; did you mean 'voltage_v'?"),
    ('signals: {soc: {channel: S}}', "signals.soc: unknown key 'channel'; did you mean 'channels'?"),
    ('signals: {soc: {channels: S, unit: V}}', "signals.soc: unit: unit 'volt' cannot be converted to 1"),
    ('signals: {soc: {channels: S, unit: furlongs}}', 'signals.soc: unit: unit '),
    ('signals: {soc: {channels: S, unit: "__import__(1)"}}', 'signals.soc: unit: unit '),
    ('signals: {soc: {channels: /(/}}', "signals.soc: '/(/' is not a regular expression"),
    ('signals: {soc: {channels: S, range: [1, 0]}}', 'signals.soc: range: 1 is not below 0'),
    ('signals: {soc: {channels: S, positive: charging}}', 'signals.soc: positive: only current_a and power_w'),
    ('signals: {soc: S}\ntime: /(/', "'/(/' is not a regular expression"),
])
def test_a_faulty_map_is_refused(tmp_path, text, problem):
    path = map_file(tmp_path, text)
    assert any(each.startswith(f'{path}: {problem}') for each in problems_of(load_signal_map, path))


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(InvalidInput, match="^signal map 'leafspi' is unknown; did you mean 'leafspy'.*common"):
        load_signal_map('leafspi')


def test_the_maps_that_ship_are_valid_and_the_common_one_is_last():
    names = [each.name for each in shipped_maps()]
    assert sorted(names) == sorted(path.stem for path in configuration_folder('signals').glob('*.yaml'))
    assert names[-1] == 'common'
    assert recognised_map(['a', 'b']).name == 'common'


def test_a_damaged_name_does_not_hold_the_reader_up(tmp_path):
    lines = [f'{at};{"[" * (3000 if at == 5 else 0)}SOC;50;%' for at in range(9)]
    log = log_file(tmp_path, 'SECONDS;PID;VALUE;UNITS', *lines)
    assert len(read_recording(log).signals['soc'].value) == 8
