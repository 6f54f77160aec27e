# SPDX-License-Identifier: Apache-2.0
"""The same drive read from every form of text in which it may be logged."""

from datetime import datetime, UTC

from logs_written import (
    assert_same,
    drive,
    moments,
    START_S,
    write_json_lines,
    write_leafspy,
    write_long,
    write_wide,
)
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.reading import read_recording

SIGNALS = ('battery_temperature_c', 'soc', 'voltage_v', 'current_a', 'speed_mps', 'ambient_c', 'cabin_heater_w')


def assert_is(recording, log, signals=SIGNALS, rtol=1e-5, atol=1e-5):
    assert_same(recording, log, signals, rtol=rtol, atol=atol)


@pytest.mark.parametrize('separator, decimal', [(',', '.'), (';', ','), (';', '.'), ('\t', ','), ('|', '.')])
@pytest.mark.parametrize('end, mark', [('\n', ''), ('\r\n', '\ufeff'), ('\r', '')])
def test_separators_marks_and_line_ends(tmp_path, separator, decimal, end, mark):
    log = drive(60.0)
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, separator, decimal, end, mark))
    assert_is(recording, log)
    assert recording.remarks == ()
    assert recording.start_s is None
    assert recording.format == 'CSV'


def test_a_minus_sign_may_be_that_of_swedish(tmp_path):
    log = drive(60.0) | {'current_a': -drive(60.0)['current_a'], 'soc': 0.8 + drive(60.0)['time_s'] / 9000.0}
    path = write_wide(tmp_path / 'a.csv', log, ';', ',')
    path.write_text(path.read_text().replace('-', '\u2212'), encoding='utf-8')
    assert_is(read_recording(path), log)


@pytest.mark.parametrize('form', [
    '%Y-%m-%dT%H:%M:%S+00:00', '%Y-%m-%dT%H:%M:%SZ', '%Y-%m-%d %H:%M:%S', '%Y-%m-%d %H:%M:%S.%f',
    '%d.%m.%Y %H:%M:%S', '%m/%d/%Y %I:%M:%S %p', '%d/%m/%Y %H:%M:%S', '%d-%b-%Y %H:%M:%S.%f', '%Y/%m/%d %H:%M:%S',
    '%d %b %Y %H:%M:%S', '%s', '%s000', '%s000000'])
def test_absolute_times(tmp_path, form):
    log = drive(60.0)
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, names={'time_s': 'Timestamp'},
                                          times=moments(log, form)))
    assert_is(recording, log)
    # 14 November 2023 is no month's 14th in disguise.
    assert recording.start_s == START_S
    assert recording.remarks == ()


def test_the_newest_reading_may_be_the_first(tmp_path):
    log = drive(60.0)
    path = write_wide(tmp_path / 'a.csv', {name: column[::-1] for name, column in log.items()},
                      times=moments(log, '%Y-%m-%dT%H:%M:%SZ')[::-1])
    recording = read_recording(path)
    assert_is(recording, log)
    assert [remark.partition(': ')[2] for remark in recording.remarks] == [
        'begins with the newest reading; the readings are sorted']


def test_a_time_in_another_form_is_shown_with_advice(tmp_path):
    log = drive(60.0)
    with pytest.raises(InvalidInput, match="time_s: 'Tue Nov 14 22:13:20 CET 2023' is not read as one; write"):
        read_recording(write_wide(tmp_path / 'a.csv', log, times=moments(log, '%a %b %d %H:%M:%S CET %Y')))


@pytest.mark.parametrize('heading, times, start_s', [
    ('time', lambda second: f'{int(second) // 60:02}:{second % 60:04.1f}', None),
    ('Zeit', lambda second: f'{25569.0 + (START_S + second) / 86400.0:.9f}', START_S),
    ('Uhrzeit', lambda second: f'{(86390.0 + second) / 86400.0 % 1.0:.9f}', None),
    ('elapsed', lambda second: '0 days 23:59:' + f'{second:02.0f}' if second < 60 else '1 days 00:00:00', None),
    ('time_ms', lambda second: f'{1000.0 * second:.0f}', None),
    ('millis', lambda second: f'{1000.0 * second + 977.0:.0f}', None), ('t[s]', lambda second: f'{second}', None),
    ('time [min]', lambda second: f'{second / 60.0:.9f}', None),
    ('t', lambda second: f'{1000.0 * second:.0f}', None),
    ('time', lambda second: f'{int(86390 + second) % 86400 // 3600}:{int(86390 + second) % 3600 // 60:02}'
     f':{(86390 + second) % 60:02.0f}', None)])
def test_relative_times(tmp_path, heading, times, start_s):
    log = drive(60.0)
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, names={'time_s': heading},
                                          times=[times(second) for second in log['time_s']]))
    assert_is(recording, log)
    assert recording.signals['soc'].time_s[-1] == pytest.approx(60.0)
    assert recording.start_s == start_s
    assert len(recording.remarks) == (heading in ('t', 'Zeit', 'Uhrzeit', 'millis'))


def test_headings_of_a_german_spreadsheet(tmp_path):
    log = drive(60.0)
    names = {'time_s': 'Zeit [s]', 'battery_temperature_c': 'Batterietemperatur [°F]', 'soc': 'Ladezustand (%)',
             'voltage_v': 'Spannung Batterie [V]', 'current_a': 'Strom Batterie [mA]',
             'speed_mps': 'Geschwindigkeit [mph]', 'ambient_c': 'Außentemperatur [K]'}
    written = {name: log[name] for name in names}
    written |= {'battery_temperature_c': 1.8 * log['battery_temperature_c'] + 32.0, 'soc': 100.0 * log['soc'],
                'current_a': 1000.0 * log['current_a'], 'speed_mps': log['speed_mps'] / 0.44704,
                'ambient_c': log['ambient_c'] + 273.15}
    recording = read_recording(write_wide(tmp_path / 'a.csv', written, ';', ',', names=names))
    assert_is(recording, log, list(names)[1:])


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-16', 'utf-16-le', 'utf-16-be', 'cp1252'])
@pytest.mark.parametrize('duration_s', [60.0, 6000.0])
def test_encodings_of_short_and_long_files(tmp_path, encoding, duration_s):
    log = drive(duration_s)
    written = {**log, 'battery_temperature_c': 1.8 * log['battery_temperature_c'] + 32.0}
    path = write_wide(tmp_path / 'a.csv', written, names={'battery_temperature_c': 'Batterie-Temp. (°F)'})
    path.write_bytes(path.read_text(encoding='utf-8').encode(encoding))
    assert_is(read_recording(path), log)


def test_a_log_of_leafspy(tmp_path):
    log = drive(1700.0, 17.0)
    recording = read_recording(write_leafspy(tmp_path / 'Log.csv', log))
    assert recording.signal_map == 'leafspy'
    assert recording.start_s == START_S
    assert_is(recording, log, (*SIGNALS, 'latitude_deg', 'longitude_deg'), rtol=1e-4, atol=1e-3)
    # The mean of the three sensors that the car has.
    assert recording.sources['battery_temperature_c'] == ('Pack T1 C', 'Pack T2 C', 'Pack T4 C')
    # A sine sampled 17 s apart: the distance by position is not quite that by speed, but no unit is mixed up.
    assert recording.remarks == ()
    np.testing.assert_allclose(recording.signals['power_w'].value, log['voltage_v'] * log['current_a'], rtol=1e-4)


def test_a_reading_a_line_in_russian(tmp_path):
    log = drive(700.0)
    names = {'speed_mps': ('Скорость автомобиля', 'км/ч', 3.6),
             'soc': ('[BMS] Уровень заряда батареи (SOC)', '%', 100.0),
             'battery_temperature_c': ('Температура батареи', '℃', 1.0),
             'voltage_v': ('Напряжение батареи', 'V', 1.0),
             'current_a': ('Ток батареи', 'A', 1.0), 'ambient_c': ('Температура наружного воздуха', '℃', 1.0)}
    recording = read_recording(write_long(tmp_path / 'a.csv', log, names))
    assert recording.format == 'CSV, one reading a line'
    assert recording.duration_s == pytest.approx(700.0, abs=1.0)
    assert_is(recording, log, list(names), rtol=1e-4, atol=1e-4)


def test_json_lines_with_nested_fields_that_arrive_singly(tmp_path):
    log = drive(700.0)
    names = {'speed_mps': ('speed', 3.6), 'soc': ('soc', 100.0), 'battery_temperature_c': ('batt_temp', 1.0),
             'voltage_v': ('voltage', 1.0), 'current_a': ('current', 1.0), 'ambient_c': ('ext_temp', 1.0)}
    recording = read_recording(write_json_lines(tmp_path / 'a.jsonl', log, names))
    assert (recording.format, recording.signal_map, recording.start_s) == ('JSON lines', 'abrp', START_S)
    assert_is(recording, log, list(names), rtol=1e-4, atol=1e-4)


def iso_times(log):
    return moments(log, '%Y-%m-%dT%H:%M:%SZ')


def test_a_history_of_home_assistant(tmp_path):
    log = drive(600.0, 5.0)
    names = {'battery_temperature_c': ('sensor.my_car_battery_temperature', 1.0),
             'soc': ('sensor.my_car_soc', 100.0),
             'speed_mps': ('sensor.my_car_speed', 3.6), 'ambient_c': ('sensor.my_car_outside_temperature', 1.0)}
    lines = ['entity_id,state,last_changed']
    for signal, (entity, factor) in names.items():
        for at, moment in enumerate(iso_times(log)):
            lines.append(f'{entity},{factor * log[signal][at]:.5f},{moment}')
            lines += [f'{entity},{word},{moment}' for word in ('unavailable', 'unknown') if at == 7]
    path = tmp_path / 'history.csv'
    path.write_text('\n'.join(lines) + '\n')
    recording = read_recording(path)
    assert recording.format == 'CSV, one reading a line' and recording.start_s == START_S
    assert_is(recording, log, list(names), rtol=1e-4, atol=1e-4)
    assert all('has no unit' in remark for remark in recording.remarks)


def test_the_unit_in_the_log_comes_before_that_of_a_recognised_map(tmp_path):
    log = drive(600.0, 5.0)
    lines = ['time,v.b.soc,v.b.temp,v.p.speed']
    lines += [f'{moment},{100.0 * soc:.4f}%,{1.8 * battery_c + 32.0:.4f}°F,{speed_mps / 0.44704:.4f}Mph'
              for moment, soc, battery_c, speed_mps in zip(iso_times(log), *(
                  log[name] for name in ('soc', 'battery_temperature_c', 'speed_mps')))]
    path = tmp_path / 'metrics.csv'
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    recording = read_recording(path)
    assert recording.signal_map == 'ovms'
    assert_is(recording, log, ['soc', 'battery_temperature_c', 'speed_mps'], rtol=1e-4, atol=1e-3)
    # The user's word counts.
    own = tmp_path / 'own.yaml'
    own.write_text('signals: {battery_temperature_c: {channels: v.b.temp, unit: degC}}', encoding='utf-8')
    assert read_recording(path, own).signals['battery_temperature_c'].value[0] == pytest.approx(37.4)


@pytest.mark.parametrize('text', [
    'time_s,battery power,battery temp\n0,950 W,41 °F\n10,1.2 kW,5 °C\n20,0.8 kW,3.6 V\n30,-70 W,278.15 K\n',
    'time,name,value,unit\n' + ''.join(f'{time},{name},{value},{unit}\n' for time, *both in (
        (0, (950, 'W'), (41, '°F')), (10, (1.2, 'kW'), (5, '°C')), (20, (0.8, 'kW'), (3.6, 'V')),
        (30, (-70, 'W'), (278.15, 'K'))) for name, (value, unit) in zip(('battery power', 'battery temp'), both))])
def test_each_reading_may_have_a_unit_of_its_own(tmp_path, text):
    (tmp_path / 'a.csv').write_text(text, encoding='utf-8')
    recording = read_recording(tmp_path / 'a.csv')
    np.testing.assert_allclose(recording.signals['power_w'].value, [950.0, 1200.0, 800.0, -70.0])
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value, [5.0, 5.0, 5.0])
    assert "'3.6 V' is no reading of battery_temperature_c; it is dropped" in ' '.join(recording.remarks)


@pytest.mark.parametrize('separator, cell', [
    (';', '{} °C'), (';', '{}\u00a0°C'), (',', '"{}"'), (',', '"{} °C"'), ('\t', '{}°C')])
def test_decimal_commas_in_quotes_or_before_units(tmp_path, separator, cell):
    temperatures_c = np.linspace(-3.5, 6.25, 40)
    rows = [separator.join((f'2026-01-15 07:30:{at:02d}', cell.format(f'{temperature_c:.2f}'.replace('.', ','))))
            for at, temperature_c in enumerate(temperatures_c)]
    (tmp_path / 'a.csv').write_text('\n'.join((separator.join(('time', 'battery temp')), *rows)), encoding='utf-8')
    np.testing.assert_allclose(read_recording(tmp_path / 'a.csv').signals['battery_temperature_c'].value,
                               temperatures_c, atol=0.006)


def test_names_of_several_words_between_blanks_shift_no_column(tmp_path):
    rows = '\n'.join(f'{at} {50 + at} 4 {6.5 + at / 10}' for at in range(30))
    path = tmp_path / 'a.txt'
    path.write_text(f'Time (s) Speed (km/h) Gear Battery_temp [degC]\n{rows}\n')
    signals = read_recording(path).signals
    np.testing.assert_allclose(signals['speed_mps'].value[[0, -1]], [50.0 / 3.6, 79.0 / 3.6])
    np.testing.assert_allclose(signals['battery_temperature_c'].value[[0, -1]], [6.5, 9.4])
    path.write_text(f'Time s Vehicle speed Gear Battery temp\n{rows}\n')
    with pytest.raises(InvalidInput, match='a CSV log has a header that names its columns'):
        read_recording(path)


ROWS = ''.join(f'{at},{6.5 + at / 10},{80 - at / 10},50\n' for at in range(30))


@pytest.mark.parametrize('text, problem', [
    ('time_s,car,battery temp [C],soc [%],speed [km/h]\n' + ROWS,
     'line 2: has 4 values; the header names 5 columns$'),
    (f'time_s,battery temp [C],soc [%],speed [km/h]\n{ROWS}time_s,soc [%],battery temp [C],speed [km/h]\n{ROWS}',
     'line 32: names other columns than line 1; split the file there')])
def test_columns_that_do_not_fit_their_header_are_refused(tmp_path, text, problem):
    (tmp_path / 'a.csv').write_text(text)
    with pytest.raises(InvalidInput, match=problem):
        read_recording(tmp_path / 'a.csv')


def test_lines_of_two_words_above_the_header_are_titles(tmp_path):
    (tmp_path / 'a.csv').write_text('Vehicle,ID.3\nStart,2026-01-15\n\n'
                                    'time_s,battery temp [C],soc [%],speed [km/h]\n' + ROWS)
    recording = read_recording(tmp_path / 'a.csv')
    np.testing.assert_allclose(recording.signals['battery_temperature_c'].value[[0, -1]], [6.5, 9.4])
    assert recording.remarks == ()


def test_units_with_a_step_and_units_that_nobody_knows(tmp_path):
    log = drive(60.0)
    names = {'battery_temperature_c': ('Battery temp [0.1 °C]', 10.0), 'soc': ('SOC [0.5 %]', 200.0),
             'current_a': ('Battery current [0,1 A]', 10.0), 'voltage_v': ('Pack voltage [0.01V]', 100.0)}
    path = write_wide(tmp_path / 'a.csv', {'time_s': log['time_s']} | {
        name: factor * log[name] for name, (_, factor) in names.items()}, ';',
        names={name: heading for name, (heading, _) in names.items()})
    recording = read_recording(path)
    assert_is(recording, log, list(names), rtol=1e-4)
    assert recording.remarks == ()
    path.write_text(path.read_text().replace('0.1 °C', 'dC'))
    assert read_recording(path).remarks == (
        f"{path}: Battery temp [dC]: 'dC' is no known unit; its readings are taken as degC",)


def test_a_recognised_log_may_have_channels_of_its_own(tmp_path):
    log = drive(60.0) | {'battery_heater_power': np.full(61, 5000.0)}
    names = {'battery_temperature_c': 'batt_temp', 'ambient_c': 'ext_temp', 'time_s': 'utc'}
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, names=names, times=moments(log, '%s')))
    assert recording.signal_map == 'abrp'
    assert_is(recording, log, ('battery_temperature_c', 'speed_mps', 'ambient_c'))
    assert set(recording.signals['battery_heater_w'].value) == {5000.0}


def test_positions_of_teslalogger_have_metric_horsepower(tmp_path):
    log = drive(120.0)
    path = write_wide(
        tmp_path / 'pos.csv', {'time_s': log['time_s'], 'lat': log['latitude_deg'], 'lng': log['longitude_deg'],
                               'speed': 3.6 * log['speed_mps'], 'power': np.full(121, 20.0),
                               'ideal_battery_range_km': log['soc'], 'battery_level': 100.0 * log['soc']},
        times=moments(log, '%Y-%m-%d %H:%M:%S'), names={'time_s': 'Datum'})
    recording = read_recording(path)
    assert recording.signal_map == 'teslalogger'
    assert set(np.round(recording.signals['power_w'].value, 1)) == {14710.0}
    assert_is(recording, log, ['speed_mps', 'soc'], rtol=1e-4)


@pytest.mark.parametrize('mark', ['#', '# '])
@pytest.mark.parametrize('separator', [',', ' '])
def test_the_names_may_be_a_comment_as_numpy_writes_them(tmp_path, mark, separator):
    log = drive(60.0)
    path = write_wide(tmp_path / 'a.csv', log, separator)
    path.write_text('# logged in Oslo\n' + mark + path.read_text())
    assert_is(read_recording(path), log)


def test_points_between_thousands_beside_decimal_commas(tmp_path):
    (tmp_path / 'a.csv').write_text('time_s;battery power [W];battery temp [degC];odometer [km]\n'
                                    '0;-1.250;2,0;12.345,6\n10;24.046;2,5;12.345,9\n20;980;3;1.012.346\n')
    signals = read_recording(tmp_path / 'a.csv').signals
    assert signals['power_w'].value.tolist() == [-1250.0, 24046.0, 980.0]
    np.testing.assert_allclose(signals['odometer_m'].value, [12345600.0, 12345900.0, 1012346000.0])
    assert signals['battery_temperature_c'].value.tolist() == [2.0, 2.5, 3.0]


@pytest.mark.parametrize('thousand, mark', [(',', '.'), ("'", '.'), ('\u202f', ','), (' ', ',')])
def test_separators_between_thousands(tmp_path, thousand, mark):
    power_w = np.linspace(-2400.0, 24_000.5, 120)
    rows = [f'{at};{power:,.1f};{31000 + at:,};3.5' for at, power in enumerate(power_w)]
    text = '\n'.join(('time_s;battery power [W];odometer [km];battery temp [degC]', *rows))
    (tmp_path / 'a.csv').write_text(text.translate({ord(','): thousand, ord('.'): mark}), encoding='utf-8')
    signals = read_recording(tmp_path / 'a.csv').signals
    np.testing.assert_allclose(signals['power_w'].value, power_w, atol=0.06)
    # 31,000 may be 31.000 as well, if no other cell of the column tells.
    assert ('odometer_m' in signals) == (thousand != ',')


def test_the_few_readings_that_a_wrong_unit_leaves_are_none(tmp_path):
    log = drive(900.0)
    recording = read_recording(write_wide(tmp_path / 'a.csv', log | {'current_a': 1e3 * (log['current_a'] - 30.0)},
                                          names={'current_a': 'battery current'}))
    assert 'current_a' not in recording.signals and 'power_w' not in recording.signals
    assert any('battery current: few of its readings are left, so it is not taken for current_a' in each
               for each in recording.remarks)


def test_labels_behind_a_name_are_not_part_of_it(tmp_path):
    log = drive(60.0)
    names = {'time_s': '"Time"', 'soc': '"car_soc{job=""status""}"', 'battery_temperature_c':
             '"car_battery_temperature_celsius{car=""id3"", instance=""10.0.0.1:9100""}"'}
    recording = read_recording(write_wide(tmp_path / 'a.csv', {name: log[name] for name in names}, names=names,
                                          times=moments(log, '%Y-%m-%d %H:%M:%S')))
    assert_is(recording, log, ('battery_temperature_c', 'soc'))
    assert recording.remarks == ()


def test_rows_of_one_reading_each_count_milliseconds(tmp_path):
    log = drive(60.0)
    del log['latitude_deg'], log['longitude_deg']
    names = list(log)[1:]
    # As Scan My Tesla writes them, with a separator at the end of each row.
    rows = [['Time', *names, '']] + [
        [f'{1000.0 * second + 123456.0 + 17.0 * at:.0f}', *('' for _ in names[:at]), f'{log[name][row]:.7g}',
         *('' for _ in names[at:])] for row, second in enumerate(log['time_s']) for at, name in enumerate(names)]
    (tmp_path / 'a.csv').write_text('\n'.join(map(','.join, rows)))
    recording = read_recording(tmp_path / 'a.csv')
    assert_is(recording, log, rtol=0.02, atol=0.02)
    assert recording.remarks == (f'{tmp_path}/a.csv: times have no unit; steps of 1000 are taken as milliseconds',)


@pytest.mark.parametrize('step, seconds, taken', [
    (120, 120.0, 'seconds'), (300, 300.0, 'seconds'), (900, 900.0, 'seconds'), (200, 0.2, 'milliseconds'),
    (3000, 3.0, 'milliseconds'), (1_000_000, 1.0, 'microseconds'), (2_000_000_000, 2.0, 'nanoseconds')])
def test_steps_of_whole_minutes_up_to_a_quarter_of_an_hour_are_no_milliseconds(tmp_path, step, seconds, taken):
    rows = [f'{step * at},{12.0 - 0.1 * at:.1f},70,-3' for at in range(20)]
    (tmp_path / 'night.csv').write_text('\n'.join(('time,batt_temp_c,soc_percent,ambient_c', *rows)))
    recording = read_recording(tmp_path / 'night.csv')
    assert recording.duration_s == pytest.approx(19 * seconds)
    assert recording.remarks[0].endswith(f'times have no unit; steps of {step} are taken as {taken}')


@pytest.mark.parametrize('text, is_absolute', [
    (lambda moment, second: f'{moment:%Y%m%d%H%M%S}', True), (lambda moment, second: f'{moment:%H%M%S}', False),
    (lambda moment, second: f'{moment:%H%M%S}.00'.lstrip('0'), False),
    (lambda moment, second: f'{(second + 62135596800) * 10**7:.0f}', True),
    (lambda moment, second: f'{(second + 11644473600) * 10**7:.0f}', True),
    (lambda moment, second: f'{second / 86400 + 719529:.7f}', True)])
def test_dates_and_times_of_day_in_digits_and_other_epochs(tmp_path, text, is_absolute):
    log = drive(600.0, 5.0)
    seconds = START_S - 50_000.0 + log['time_s']
    times = [text(datetime.fromtimestamp(second, UTC), second) for second in seconds]
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, names={'time_s': 'time'}, times=times))
    assert recording.start_s == (pytest.approx(seconds[0], abs=0.01) if is_absolute else None)
    assert_is(recording, log, rtol=1e-3, atol=0.01)


def test_seconds_that_could_be_times_of_day_stay_seconds(tmp_path):
    rows = [f'{100_000 + 100 * at},{12.0 - 0.1 * at:.1f},70' for at in range(20)]
    (tmp_path / 'night.csv').write_text('\n'.join(('time,batt_temp_c,soc_percent', *rows)))
    assert read_recording(tmp_path / 'night.csv').duration_s in (1900.0, pytest.approx(1.9))


@pytest.mark.parametrize('is_home_assistant', [False, True])
def test_an_annotated_csv_of_influxdb(tmp_path, is_home_assistant):
    log = drive(600.0, 5.0)
    names = {'battery_temperature_c': ('battery_temp', '°F'), 'speed_mps': ('speed', 'm/s'),
             'ambient_c': ('outside_temp', '°C')}
    times = '2023-01-01T00:00:00Z,2024-01-01T00:00:00Z'
    lines = ['#group,false,false,true,true,false,false,true,true,true', '#default,_result,,,,,,,,',
             ',result,table,_start,_stop,_time,_value,_field,_measurement,'
             + ('entity_id' if is_home_assistant else 'host')]
    for signal, (name, unit) in names.items():
        for at, moment in enumerate(iso_times(log)):
            value = log[signal][at]
            if is_home_assistant:
                value = 1.8 * value + 32.0 if unit == '°F' else value
                lines.append(f',,0,{times},{moment},{value:.5f},value,{unit},{name}')
            else:
                value = 3.6 * value if signal == 'speed_mps' else value
                lines.append(f',,0,{times},{moment},{value:.5f},{name},car,h')
    path = tmp_path / 'influx.csv'
    path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    assert_is(read_recording(path), log, list(names), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize('heading, first_ms', [
    ('time_ms', 2**32 + 5e6), ('Timestamp(ms)', 3e9), ('time', 2**32 + 5e6), ('time', 3e9),
    ('time_ms', 2**32 - 60e3)])
def test_milliseconds_of_a_counter_of_32_bits_and_of_more(tmp_path, heading, first_ms):
    log = drive(120.0)
    end = 2**32 if first_ms < 2**32 else 2**60
    times = [f'{(first_ms + 1e3 * second) % end:.0f}' for second in log['time_s']]
    recording = read_recording(write_wide(tmp_path / 'a.csv', log, names={'time_s': heading}, times=times))
    assert recording.duration_s == pytest.approx(120.0)
    assert recording.start_s is None
    assert_is(recording, log)


def test_a_table_with_t_env_c_has_no_time_called_env(tmp_path):
    log = drive(60.0)
    names = {'time_s': 't_s', 'ambient_c': 't_env_c', 'battery_temperature_c': 'T_batt_C', 'speed_mps': 'v_mps',
             'odometer_m': 's_m'}
    log['odometer_m'] = 16.0 * log['time_s']
    recording = read_recording(write_wide(tmp_path / 'a.csv', {name: log[name] for name in names}, names=names))
    assert_is(recording, log, list(names)[1:])


def test_damaged_lines_are_one_remark_a_cause(tmp_path):
    log = drive(200.0)
    path = write_wide(tmp_path / 'a.csv', log)
    lines = path.read_text(encoding='utf-8').splitlines()
    for at in range(20, 60):
        lines[at] = lines[at].replace(',', ',65535,', 1)
    for at in (80, 90, 100):
        cells = lines[at].split(',')
        lines[at] = ','.join([*cells[:4], 'high', *cells[5:]])
    path.write_text('\n'.join(lines), encoding='utf-8')
    assert read_recording(path).remarks == (
        f'{path}, line 21: has 11 values; the header names 10 columns; the line is dropped (and 39 more lines)',
        f"{path}, line 81: current_a: 'high' is not a number; it is dropped (and 2 more samples)")


@pytest.mark.parametrize('contents, problem', [
    (b'', 'is empty'), (b'\n \n', 'is empty'), (b'\x00\x01\x02\x03' * 99, 'is no log of a known format'),
    (b'hello world\nthis is a letter\n', 'is text, but no log'),
    (b'a,b\n1,2\n3,4\n', 'none of its channels is a signal of the signal map common; the channels are a, b'),
    (b'colour,speed_mps\nred,2\nblue,4\n', 'line 1: no column holds the time'),
    (b'T_batt,T_amb\n3,-5\n3.5,-5\n', 'no column holds the time; the columns are'),
    (b'time_s,speed_mps\n0,none\n1,none\n', 'no signal has a valid reading'),
    (b'{"speed": 1}\n{"speed": 2}\n', 'no field holds the time'),
    (b'SQLite format 3\0\0 CREATE TABLE positions \0', 'is a database, which is not read; export its table'),
    (b'-- MySQL dump\nCREATE TABLE pos (a int);\n', 'is a dump of a database, which is not read; export its'),
    (b'SQLite format 3\0\0 arbitration_id \0', 'convert it with can_logconvert'),
    (b'PAR1\0\0', 'a Parquet file, which is not read; write it as CSV'), (b'PK\x03\x04', 'save the sheet as CSV'),
    (b'car,vin=x soc=1,t=2 1700000000000000000\n', 'line protocol, which is not read; export it as CSV'),
    (b'<?xml version="1.0"?><gpx/>', 'give it to --route'),
    (b'\x89MCAP0\r\n', 'no message can be read'), (b'MDF     4.10', 'cannot be read as MDF'),
])
@pytest.mark.needs('asammdf', 'rosbags')
def test_files_that_are_no_logs(tmp_path, contents, problem):
    path = tmp_path / 'log.mcap'
    path.write_bytes(contents)
    with pytest.raises(InvalidInput, match='log.mcap(:|,) .*') as caught:
        read_recording(path)
    assert problem in caught.value.problems[0]
