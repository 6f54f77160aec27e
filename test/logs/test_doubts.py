# SPDX-License-Identifier: Apache-2.0
"""Mix-ups of sign, unit and scale are named, and repaired on request only."""


from logs_written import drive, write_wide
import numpy as np
import pytest

from bev_preheat.logs.reading import read_recording

# Signal, the mix-up, words of the doubt.
MIX_UPS = (
    ('current_a', lambda value: -value, 'positive must mean discharging'),
    ('current_a', lambda value: 1e-3 * value, 'a factor of 1000 is missing'),
    ('speed_mps', lambda value: 3.6 * value, 'km/h taken as m/s?'),
    ('speed_mps', lambda value: value / 3.6, 'm/s taken as km/h?'),
    ('battery_temperature_c', lambda value: 1.8 * value + 32.0, 'is it in degF?'),
    ('battery_temperature_c', lambda value: value + 273.15, 'with the unit kelvin they are plausible'),
    ('ambient_c', lambda value: 1.8 * (value + 12.0) + 32.0, 'is it in degF?'),
    ('voltage_v', lambda value: 10.0 * value, 'with a factor of 0.1 they are plausible'),
    ('cabin_heater_w', lambda value: 1e-3 * value, 'is it in kW?'),
)


@pytest.mark.parametrize('signal, mixed, words', MIX_UPS)
def test_a_mix_up_is_named_and_repaired_on_request_only(tmp_path, signal, mixed, words):
    log = drive(900.0)
    # A battery of 15 degC reads 59 as degF, an ambient of 8 degC reads 46.
    log['battery_temperature_c'] = log['battery_temperature_c'] + 12.0
    path = write_wide(tmp_path / 'mixed.csv', {**log, signal: mixed(log[signal])})
    expected = log[signal] + (12.0 if signal == 'ambient_c' else 0.0)
    as_it_is, repaired = read_recording(path), read_recording(path, repair=True)
    named = [remark for remark in as_it_is.remarks if words in remark]
    assert len(named) == 1 and signal in named[0] and 'repair' in named[0]
    series = repaired.signals[signal]
    np.testing.assert_allclose(series.value, np.interp(series.time_s, log['time_s'], expected),
                               rtol=1e-4, atol=1e-4)
    assert any(remark.endswith('repaired') for remark in repaired.remarks)
    kept = as_it_is.signals.get(signal)
    assert kept is None or not np.allclose(kept.value, np.interp(kept.time_s, log['time_s'], expected), rtol=0.01)


@pytest.mark.parametrize('changes, words', [
    ({'current_a': lambda value: value + 1000.0}, 'a factor of 0.1 is missing, or an offset; name the unit'),
    ({'time_s': lambda value: value / 1000.0}, 'are the times in seconds? name the unit')])
def test_a_mix_up_that_no_factor_explains_is_not_repaired(tmp_path, changes, words):
    log = drive(2400.0)
    mixed = log | {name: change(log[name]) for name, change in changes.items()}
    recording = read_recording(write_wide(tmp_path / 'a.csv', mixed), repair=True)
    assert any(words in remark for remark in recording.remarks)
    for signal in ('current_a', 'speed_mps'):
        np.testing.assert_allclose(recording.signals[signal].value, mixed[signal], rtol=1e-5)


def test_power_is_compared_with_voltage_times_current(tmp_path):
    log = drive(300.0)
    # Otherwise the state of charge tells it.
    del log['soc']
    log['power_w'] = -log['voltage_v'] * log['current_a']
    assert 'has the opposite sign of voltage times current' in ' '.join(
        read_recording(write_wide(tmp_path / 'a.csv', log)).remarks)
    log['power_w'] = log['voltage_v'] * log['current_a'] / 1000.0
    repaired = read_recording(write_wide(tmp_path / 'a.csv', log), repair=True)
    np.testing.assert_allclose(repaired.signals['power_w'].value, 1000.0 * log['power_w'], rtol=1e-4)


def test_a_power_that_is_not_voltage_times_current_by_any_unit_is_named(tmp_path):
    # The power of three phases beside voltage and current of one, as a wallbox logs them.
    log = {'time_s': np.arange(300.0), 'power_w': np.full(300, 11e3), 'voltage_v': np.full(300, 230.0),
           'current_a': np.full(300, 16.0)}
    recording = read_recording(write_wide(tmp_path / 'a.csv', log), repair=True)
    assert any('power_w: is 2.99 times voltage times current; do all three belong to the battery?' in each
               for each in recording.remarks)
    assert set(recording.signals['power_w'].value) == {11e3}


def in_miles(folder, names, left_out=()):
    """Write a drive whose speed and odometer are in miles, with these names."""
    log = {name: values for name, values in drive(900.0).items() if name not in left_out}
    driven_m = np.concatenate([[0.0], np.cumsum(0.5 * (log['speed_mps'][1:] + log['speed_mps'][:-1]))])
    log |= {'speed_mps': log['speed_mps'] / 0.44704, 'odometer_m': (2e7 + driven_m) / 1609.344,
            'soc': 100.0 * log['soc']}
    return log, write_wide(folder / 'a.csv', log, names=names)


def test_miles_are_told_by_the_position(tmp_path):
    # Names without a unit.
    log, path = in_miles(tmp_path, {'speed_mps': 'speed', 'odometer_m': 'odo'})
    said = ' '.join(read_recording(path).remarks)
    assert 'mph taken as km/h?' in said and 'odometer_m: its change' in said and 'miles taken as km?' in said
    repaired = read_recording(path, repair=True).signals
    np.testing.assert_allclose(repaired['speed_mps'].value, 0.44704 * log['speed_mps'], rtol=1e-4)
    np.testing.assert_allclose(repaired['odometer_m'].value, 1609.344 * log['odometer_m'], rtol=1e-4)
    # Names of an export whose unit is open.
    names = {'speed_mps': 'speed', 'odometer_m': 'odometer', 'soc': 'battery_level', 'ambient_c': 'outside_temp',
             'latitude_deg': 'latitude', 'longitude_deg': 'longitude'}
    recording = read_recording(in_miles(tmp_path, names)[1])
    assert recording.signal_map == 'teslamate' and recording.sources['speed_mps'] == ('speed [mile/hour]',)
    np.testing.assert_allclose(recording.signals['speed_mps'].value, 0.44704 * log['speed_mps'], rtol=1e-4)
    # Without a position it stays a doubt.
    recording = read_recording(in_miles(tmp_path, names, ('latitude_deg', 'longitude_deg'))[1])
    assert any('speed: its readings' in each and 'may be in km/h or mile/hour; taken as km/h' in each
               for each in recording.remarks)


def test_an_odometer_in_miles_and_a_speed_in_other_units_explain_each_other(tmp_path):
    log, path = in_miles(tmp_path, {'odometer_m': 'odo'}, ('latitude_deg', 'longitude_deg'))
    written = {**log, 'speed_mps': 0.44704 * log['speed_mps'], 'soc': 0.01 * log['soc']}
    path = write_wide(path, written, names={'odometer_m': 'odo'})
    for repair in (False, True):
        recording = read_recording(path, repair=repair)
        assert any('km/h taken as mph, or an odometer in miles? name the unit in a signal map' in each
                   for each in recording.remarks)
        np.testing.assert_allclose(recording.signals['speed_mps'].value, 0.44704 * log['speed_mps'], rtol=1e-4)


def test_what_happens_while_nothing_is_logged_is_no_mix_up(tmp_path):
    # Two drives of a day in one log; between them the car is charged and driven, and the trip meter is reset.
    first = drive(900.0)
    first = {name: first[name] for name in ('time_s', 'battery_temperature_c', 'soc', 'current_a', 'speed_mps')}
    first['soc'] = first['soc'] - 0.3
    driven_m = np.concatenate([[0.0], np.cumsum(0.5 * (first['speed_mps'][1:] + first['speed_mps'][:-1]))])
    for later_m in (17e3, -16e3):
        first['odometer_m'] = 2e7 + driven_m
        second = first | {'time_s': first['time_s'] + 40_000.0, 'soc': first['soc'] + 0.35,
                          'odometer_m': first['odometer_m'] + later_m}
        log = {name: np.concatenate([first[name], second[name]]) for name in first}
        recording = read_recording(write_wide(tmp_path / 'a.csv', log), repair=True)
        assert recording.remarks == ()
        np.testing.assert_allclose(recording.signals['current_a'].value, log['current_a'], rtol=1e-4)


def test_a_moving_car_without_a_state_of_charge_tells_the_sign(tmp_path):
    log = drive(900.0)
    log = {name: log[name] for name in ('time_s', 'battery_temperature_c', 'speed_mps', 'ambient_c')}
    for signal, values in (('power_w', 9e3 + 4e3 * np.sin(log['time_s'] / 23.0)),
                           ('current_a', 25.0 + 0.0 * log['time_s'])):
        assert read_recording(write_wide(tmp_path / 'a.csv', {**log, signal: values})).remarks == ()
        path = write_wide(tmp_path / 'a.csv', {**log, signal: -values})
        remark, = read_recording(path).remarks
        assert f'{signal}: is -' in remark and 'in the mean while the car drives' in remark
        np.testing.assert_allclose(read_recording(path, repair=True).signals[signal].value, values, rtol=1e-5)
        # Down a mountain, of 300 m over 14 km, the battery is charged.
        log_down = {**log, signal: -values, 'elevation_m': 900.0 - log['time_s'] / 3.0}
        assert read_recording(write_wide(tmp_path / 'a.csv', log_down)).remarks == ()


def test_a_voltage_that_rises_with_the_current_tells_its_sign(tmp_path):
    # A battery of 0.1 ohm at stand, heated in steps.
    time_s = np.arange(0.0, 900.0, 5.0)
    current_a = np.where(time_s // 30.0 % 2.0 == 0.0, 20.0, 2.0)
    log = {'time_s': time_s, 'current_a': current_a, 'voltage_v': 380.0 - 0.1 * current_a}
    assert read_recording(write_wide(tmp_path / 'a.csv', log)).remarks == ()
    remark, = read_recording(write_wide(tmp_path / 'a.csv', {**log, 'current_a': -current_a})).remarks
    assert 'current_a: the voltage rises by 100 mV for each ampere drawn' in remark


def test_a_power_that_rises_with_the_acceleration_has_its_sign(tmp_path):
    # Recuperation down an unknown slope: 1500 kg, 8 kW of the slope.
    log = drive(900.0)
    acceleration = 7.0 / 31.0 * np.cos(log['time_s'] / 31.0)
    power_w = -8e3 + 1500.0 * acceleration * log['speed_mps']
    log = {'time_s': log['time_s'], 'speed_mps': log['speed_mps'], 'power_w': power_w}
    assert read_recording(write_wide(tmp_path / 'a.csv', log)).remarks == ()
