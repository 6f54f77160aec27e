# SPDX-License-Identifier: Apache-2.0
"""Bytes without sign, all bits set, units that an app's user chooses: explained only if one cause is the best."""

from logs_written import drive, write_leafspy, write_wide
import numpy as np
import pytest

from bev_preheat.logs.reading import read_recording

TRUE_C = np.round(np.linspace(-4.0, 3.0, 301))


def log_of(readings, ambient_c=-6.0):
    log = drive(600.0, 2.0)
    return {**log, 'battery_temperature_c': readings, 'ambient_c': ambient_c + 0.0 * log['time_s']}


def temperature(path, repair=False):
    recording = read_recording(path, repair=repair)
    said = ' '.join(remark for remark in recording.remarks if 'battery_temperature_c' in remark)
    series = recording.signals.get('battery_temperature_c')
    return (np.zeros(0) if series is None else series.value), said


@pytest.mark.parametrize('modulus, step', [(256.0, 1.0), (65536.0, 1.0), (6553.6, 0.1)])
def test_negative_values_of_an_unsigned_word_are_named_and_repaired(tmp_path, modulus, step):
    true_c = TRUE_C if step == 1.0 else np.round(np.linspace(-4.0, 3.0, 301), 1)
    path = write_wide(tmp_path / 'a.csv', log_of(np.where(true_c < 0.0, true_c + modulus, true_c)))
    values, said = temperature(path)
    assert values.min() >= 0.0 and f'as negative ones (minus {modulus:g})' in said and '--repair' in said
    values, said = temperature(path, repair=True)
    np.testing.assert_allclose(values, true_c, atol=1e-6)
    assert said.endswith('repaired')


def test_regeneration_that_lost_its_sign_is_repaired(tmp_path):
    log = drive(600.0, 2.0)
    true_a = np.round(log['current_a'] - 20.0)
    path = write_wide(tmp_path / 'a.csv', log | {'current_a': np.where(true_a < 0.0, true_a + 65536.0, true_a)})
    assert any('as negative ones (minus 65536)' in remark for remark in read_recording(path).remarks)
    np.testing.assert_allclose(read_recording(path, repair=True).signals['current_a'].value, true_a)


def test_a_byte_that_is_all_negative_is_repaired_beside_the_outside_temperature_only(tmp_path):
    true_c = np.round(np.linspace(-9.0, -5.0, 301))
    log = log_of(true_c + 256.0)
    np.testing.assert_allclose(temperature(write_wide(tmp_path / 'a.csv', log), repair=True)[0], true_c)
    # Alone, 247 ... 251 may be kelvin, tenths or a byte without its sign.
    del log['ambient_c']
    values, said = temperature(write_wide(tmp_path / 'a.csv', log), repair=True)
    assert not values.size
    assert all(words in said for words in ('kelvin', 'a factor of 0.1', 'minus 256', 'name it in a signal map'))
    assert 'repaired' not in said


@pytest.mark.parametrize('kelvins, words', [(1.0, 'with the unit kelvin they'), (
    10.0, 'with the unit kelvin and a factor of 0.1 they')])
def test_kelvin_in_a_column_without_a_unit_is_named_and_repaired(tmp_path, kelvins, words):
    log = log_of(np.round(kelvins * (TRUE_C + 273.15)))
    path = write_wide(tmp_path / 'a.csv', log, names={'battery_temperature_c': 'battery temp'})
    values, said = temperature(path)
    assert not values.size and words in said
    np.testing.assert_allclose(temperature(path, repair=True)[0], TRUE_C, atol=0.2)


def test_a_charge_of_160_may_be_tenths_or_halves_of_a_percent_and_is_not_repaired(tmp_path):
    log = drive(200.0)
    path = write_wide(tmp_path / 'a.csv', log | {'soc': np.round(200.0 * log['soc'])})
    recording = read_recording(path, repair=True)
    assert 'soc' not in recording.signals
    assert any('with a factor of 0.1, or with a factor of 0.5 they are plausible; name it in a signal map' in each
               for each in recording.remarks)


def test_the_voltage_of_12_v_is_no_tenth_of_the_packs(tmp_path):
    log = drive(200.0)
    path = write_wide(tmp_path / 'a.csv', log | {'voltage_v': 14.0 + 0.001 * log['time_s']})
    recording = read_recording(path, repair=True)
    assert not recording.signals.keys() & {'voltage_v', 'power_w'}
    assert any('voltage_v: 14 is implausible (plausible: 20 ... 1500); it is dropped' in each
               for each in recording.remarks)


def test_whole_readings_of_44_may_be_tenths_or_a_byte_and_are_not_repaired(tmp_path):
    path = write_wide(tmp_path / 'a.csv', log_of(np.full(301, 44.0)))
    values, said = temperature(path, repair=True)
    assert set(values) == {44.0} and 'degF, in tenths, or a byte without its offset?' in said


def test_a_single_wild_reading_is_dropped_and_explained_by_nothing(tmp_path):
    readings = np.full(301, 20.0)
    readings[100] = 250.0
    values, said = temperature(write_wide(tmp_path / 'a.csv', log_of(readings)), repair=True)
    assert set(values) == {20.0} and len(values) == 300
    assert '250 is implausible' in said and 'plausible;' not in said


def test_a_code_that_never_changes_is_no_temperature_in_tenths(tmp_path):
    path = write_wide(tmp_path / 'a.csv', log_of(np.full(301, -50.0)))
    values, said = temperature(path, repair=True)
    assert not values.size and '-50 is implausible' in said and 'a factor of' not in said
    path = write_wide(tmp_path / 'a.csv', log_of(10.0 * np.round(np.linspace(-5.0, -2.0, 301)) - 10.0))
    np.testing.assert_allclose(temperature(path, repair=True)[0][[0, -1]], [-6.0, -3.0])


@pytest.mark.parametrize('nothing', [65.535, 655.35, 6553.5, 65535.0, 255.0, 127.5, 215.0, 32.767])
def test_all_bits_set_is_no_reading(tmp_path, nothing):
    readings = np.where(np.arange(301) < 100, nothing, 2.0)
    for repair in (False, True):
        values, said = temperature(write_wide(tmp_path / 'a.csv', log_of(readings)), repair)
        assert set(values) == {2.0} and len(values) == 201
        assert f'{nothing:g} has all bits set' in said or f'{nothing:.2f}' in said


def test_a_signal_that_passes_through_such_a_value_keeps_it(tmp_path):
    log = drive(60.0)
    log |= {'odometer_m': 65505.0 + log['time_s'], 'battery_temperature_c': 24.0 + 0.05 * log['time_s'],
            'speed_mps': 20.0 + 0.1 * np.round(log['time_s'])}
    recording = read_recording(write_wide(tmp_path / 'a.csv', log))
    assert recording.remarks == ()
    for signal in ('odometer_m', 'battery_temperature_c', 'speed_mps'):
        np.testing.assert_allclose(recording.signals[signal].value, log[signal], rtol=1e-6)


@pytest.mark.parametrize('ambient_c, battery_c, in_fahrenheit', [
    (8.5, 10.0, False), (8.5, 10.0, True), (8.0, 10.0, False), (-11.0, -10.0, True), (30.0, 31.0, False)])
def test_the_outside_temperature_of_leafspy_has_the_unit_set(tmp_path, ambient_c, battery_c, in_fahrenheit):
    log = drive(1700.0, 17.0)
    log['battery_temperature_c'] = battery_c + 0.0 * log['time_s']
    # The writer converts to degF.
    log['ambient_c'] = (ambient_c if in_fahrenheit else (ambient_c - 32.0) / 1.8) + 0.0 * log['time_s']
    recording = read_recording(write_leafspy(tmp_path / 'a.csv', log))
    np.testing.assert_allclose(recording.signals['ambient_c'].value, ambient_c, atol=0.01)
    assert recording.sources['ambient_c'] == (f'Ambient [{"degF" if in_fahrenheit else "degC"}]',)


def test_an_open_unit_that_nothing_tells_is_a_doubt(tmp_path):
    # 14 degC or degF (-10 degC), beside a battery of 2 degC.
    log = drive(1700.0, 17.0)
    log['battery_temperature_c'], log['ambient_c'] = 2.0 + 0.0 * log['time_s'], -10.0 + 0.0 * log['time_s']
    recording = read_recording(write_leafspy(tmp_path / 'a.csv', log))
    assert any('Ambient: its readings, 14 in the middle, may be in degF or degC' in remark
               for remark in recording.remarks)
