# SPDX-License-Identifier: Apache-2.0
"""Drive logs: means, root mean squares, gaps and faults, on small synthetic logs."""

from dataclasses import fields

import numpy as np
import pytest
from refusals import problems_in

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.identification.recorded_route import load_drive_logs
from bev_preheat.route.segments import Route
from bev_preheat.vehicle.description import Defaults

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0, target_battery_temperature_c=21.0)
HEADER = 'time_s,speed_mps,voltage_v,current_a,cabin_heater_w,ambient_c,aircon_w'


def samples(count=60, start=0):
    """Return the columns of a log in which everything varies, 1 Hz."""
    time = np.arange(start, start + count, dtype=float)
    return {'time_s': time, 'speed_mps': 15.0 + 9.0 * np.sin(time / 7.0),
            'voltage_v': 370.0 - 11.0 * np.cos(time / 5.0),
            'current_a': 30.0 + 80.0 * np.sin(time / 3.0),
            'cabin_heater_w': 1700.0 + 13.0 * time, 'ambient_c': -2.0 - 0.01 * time,
            'aircon_w': 90.0 + time}


@pytest.fixture
def write(tmp_path):
    def write(columns, name='drive.csv', left_out=()):
        """Write columns without the rows `left_out`; row k of the columns is line k + 2."""
        rows = [','.join(columns)]
        rows += [','.join(value if isinstance(value, str) else repr(float(value)) for value in row)
                 for index, row in enumerate(zip(*columns.values())) if index not in left_out]
        path = tmp_path / name
        path.write_text('\n'.join(rows) + '\n', encoding='utf-8')
        return path
    return write


def problems_with(path):
    return problems_in(path, load_drive_logs, [path], DEFAULTS)


@pytest.mark.parametrize('charged, refused', [
    (slice(30, 100), True), (slice(60, 130), True), (slice(30, 60), False)])
def test_a_log_with_charging_inside_or_at_its_end_is_no_drive(write, charged, refused):
    columns = samples(130)
    columns['speed_mps'][charged], columns['current_a'][charged] = 0.0, -240.0
    path = write(columns)
    if refused:
        assert problems_with(path) == [
            f': the car is charged at stand, from {charged.start} s to {charged.stop - 1} s; cut this out of the '
            'log; drives are joined by --log A B']
    else:
        assert load_drive_logs([path], DEFAULTS).route.propulsion_power_w.min() < -50e3


def with_value(name, index, value):
    columns = {key: list(values) for key, values in samples().items()}
    columns[name][index] = value
    return columns


def assert_same_route(one, other, **tolerance):
    for field in fields(Route):
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name), **tolerance)


# Means and root mean squares --------------------------------------------------------------------

def test_mean_and_root_mean_square_of_segments(write):
    # 350 V at 100 A and -20 A alternately, minus 1500 W cabin, 60 W aircon and 222 W auxiliaries.
    time = np.arange(70)
    route = load_drive_logs([write({
        'time_s': time, 'speed_mps': 10.0 + 5.0 * (time >= 30), 'voltage_v': np.full(70, 350.0),
        'current_a': np.where(time % 2, 100.0, -20.0), 'cabin_heater_w': np.full(70, 1500.0),
        'ambient_c': np.where(time < 60, -3.0, -4.0), 'aircon_w': np.full(70, 60.0)})],
        DEFAULTS).route
    others = 1500.0 + 60.0 + 222.0
    high, low = 35e3 - others, -7e3 - others
    assert route.duration_s.tolist() == [30.0, 30.0, 10.0]
    assert route.speed_mps == pytest.approx([10.0, 15.0, 15.0])
    assert route.propulsion_power_w == pytest.approx(3 * [(high + low) / 2.0])
    assert route.propulsion_power_rms_w == pytest.approx(3 * [np.sqrt((high**2 + low**2) / 2.0)])
    assert route.ambient_temperature_c == pytest.approx([-3.0, -3.0, -4.0])
    assert route.cabin_heating_power_w == pytest.approx(3 * [1500.0])
    assert route.auxiliary_power_w == pytest.approx(3 * [282.0])


@pytest.mark.parametrize('step_s', [1.0, 7.0, 30.0, 100.0])
def test_all_of_the_terminal_energy_goes_somewhere(write, step_s):
    log = samples(100)
    route = load_drive_logs([write(log)], DEFAULTS, step_s=step_s).route
    assert len(route) == int(np.ceil(100.0 / step_s))
    terminal_w = route.propulsion_power_w + route.cabin_heating_power_w + route.auxiliary_power_w
    assert terminal_w @ route.duration_s == pytest.approx(log['voltage_v'] @ log['current_a'])
    propulsion_w = (log['voltage_v'] * log['current_a'] - log['cabin_heater_w'] - log['aircon_w'] - 222.0)
    assert route.propulsion_power_rms_w**2 @ route.duration_s == pytest.approx(propulsion_w @ propulsion_w)
    assert route.distance_m == pytest.approx(log['speed_mps'].sum())


def test_logs_are_joined_in_order(write):
    first, second = samples(40), samples(35, start=500)
    joined = load_drive_logs([write(first, 'a.csv'), write(second, 'b.csv')], DEFAULTS).route
    both = {name: np.concatenate((first[name], second[name])) for name in first}
    both['time_s'] = np.arange(75)
    assert joined.duration_s.tolist() == [30.0, 30.0, 15.0]
    assert_same_route(joined, load_drive_logs([write(both, 'both.csv')], DEFAULTS).route, rtol=1e-12)


# Gaps and faults --------------------------------------------------------------------------------

RAMP = {'time_s': np.arange(60.0), 'speed_mps': 0.2 * np.arange(60.0),
        'power_w': 1e3 + 100.0 * np.arange(60.0), 'cabin_heater_w': np.full(60, 100.0),
        'ambient_c': 1.0 - 0.1 * np.arange(60.0), 'aircon_w': np.arange(60.0)}


def test_missing_seconds_are_bridged_in_a_straight_line(write):
    whole = load_drive_logs([write(RAMP, 'whole.csv')], DEFAULTS)
    path = write(RAMP, left_out=range(20, 29))
    bridged = load_drive_logs([path], DEFAULTS)
    assert_same_route(bridged.route, whole.route, rtol=1e-12)
    assert whole.remarks == ()
    assert bridged.remarks == (
        f'{path}: speed_mps and power_w: 10 s without a valid sample, from 19 s to 29 s, are bridged',)


UNUSABLE = {
    'a longer gap': (
        RAMP, range(20, 30),
        ': speed_mps: 11 s without a valid sample, from 19 s to 30 s; at most 10 s are bridged'),
    'many gaps': (
        RAMP, range(1, 60, 4),
        ': speed_mps: 15 s without samples, in 15 gaps; at most 11.8 s, 20% of the log, are bridged'),
    'backwards': (
        {**samples(), 'time_s': samples()['time_s'][::-1]}, (),
        ', line 3: the time goes back by 1 s, and 59 of 60 readings lie before one above them; a log must be one '
        'drive: split it, or name the channel of the time in a signal map'),
    'slow': ({**samples(), 'time_s': 60.0 * samples()['time_s']}, (),
             ': has a sample every 60 s; at most 40 s are allowed'),
    'without signals': (
        {name: values for name, values in samples().items() if name not in ('ambient_c', 'speed_mps')}, (),
        ': has no speed_mps, no ambient_c; signals found: voltage_v, current_a, cabin_heater_w, aircon_w, '
        'power_w; name its channel in a signal map (--signals), or rename the column')}


@pytest.mark.parametrize('columns, left_out, problem', UNUSABLE.values(), ids=UNUSABLE)
def test_a_log_that_cannot_be_used_is_refused(write, columns, left_out, problem):
    assert problems_with(write(columns, left_out=left_out)) == [problem]


@pytest.mark.parametrize('name, value, plausible', [
    ('speed_mps', -0.5, '0 ... 350'), ('speed_mps', 430.0, '0 ... 350'),
    ('voltage_v', 0.0, '20 ... 1500'), ('voltage_v', -370.0, '20 ... 1500'),
    ('current_a', 65000.0, '-3000 ... 3000'), ('current_a', -3200.0, '-3000 ... 3000'),
    ('ambient_c', 271.0, '-60 ... 60'), ('ambient_c', -99.0, '-60 ... 60'),
    ('cabin_heater_w', -1.0, '0 ... 50000'), ('cabin_heater_w', 1e6, '0 ... 50000'),
    ('aircon_w', -9.0, '0 ... 50000')])
def test_an_impossible_sample_is_reported_and_bridged(write, name, value, plausible):
    path = write(with_value(name, 17, value), 'fault.csv')
    made = load_drive_logs([path], DEFAULTS)
    assert made.remarks[0] == (
        f'{path}, line 19: {name}: {figure(value)} is implausible (plausible: {plausible}); it is dropped')
    assert_same_route(made.route, straight(write, name), rtol=1e-9)


def straight(write, name):
    """Return the Route of a log in which a straight line replaces one sample of a signal, or of the power."""
    log = samples()
    log['power_w'] = log['voltage_v'] * log['current_a']
    if name == 'voltage_v':
        log['power_w'][17] = log['current_a'][17] * log['voltage_v'][[16, 18]].mean()
    name = 'power_w' if name == 'current_a' else name
    log[name][17] = 0.5 * (log[name][16] + log[name][18])
    return load_drive_logs([write(log, 'straight.csv')], DEFAULTS).route


def test_speeds_that_no_car_reaches_are_dropped(write):
    path = write(with_value('speed_mps', 17, 130.0), 'fault.csv')
    made = load_drive_logs([path], DEFAULTS)
    assert made.remarks[0] == f'{path}: speed_mps: 130 at 17 s is dropped (plausible: 0 ... 100)'
    assert_same_route(made.route, straight(write, 'speed_mps'), rtol=1e-12)


def test_a_log_of_impossible_samples_is_refused(write):
    columns = {**samples(), 'voltage_v': np.full(60, 0.0)}
    assert problems_with(write(columns)) == [
        ': has no power_w (or voltage_v and current_a); signals found: current_a, speed_mps, ambient_c, '
        'cabin_heater_w, aircon_w; name its channel in a signal map (--signals), or rename the column',
        ', line 2: voltage_v: 0 is implausible (plausible: 20 ... 1500); it is dropped (and 59 more samples)']


@pytest.mark.parametrize('interval_s', [0.1, 2.0, 7.0, 17.0, 30.0])
def test_any_sampling_keeps_distance_and_energy(write, interval_s):
    # Two hours of the same sines, sampled slowly; a sample holds until the next one.
    time = np.arange(0.0, 7200.0 if interval_s > 1.0 else 300.0, interval_s)
    log = {'time_s': time, 'speed_mps': 15.0 + 9.0 * np.sin(time / 97.0),
           'power_w': 9e3 + 7e3 * np.sin(time / 61.0), 'ambient_c': np.full(len(time), -4.0),
           'cabin_heater_w': np.full(len(time), 700.0)}
    made = load_drive_logs([write(log)], DEFAULTS)
    total_w = made.route.propulsion_power_w + 700.0 + 222.0
    assert made.route.distance_m == pytest.approx(interval_s * log['speed_mps'].sum(), rel=1e-9)
    assert total_w @ made.route.duration_s == pytest.approx(interval_s * log['power_w'].sum(), rel=1e-9)
    assert [remark.rpartition(': ')[2][:22] for remark in made.remarks] == (
        [f'has a sample every {interval_s:g} s'[:22]] if interval_s >= 5.0 else [])


def test_auxiliaries_that_are_always_zero_are_not_believed(write):
    log = samples()
    expected = load_drive_logs([write(log)], DEFAULTS).route
    path = write({**log, 'auxiliary_w': np.zeros(60)}, 'zero.csv')
    made = load_drive_logs([path], DEFAULTS)
    assert_same_route(made.route, expected)
    assert made.remarks == (f'{path}: auxiliary_w is always 0; auxiliaries (222 W) are those of the vehicle',)


@pytest.mark.parametrize('rows, problem', [
    (0, ': is text, but no log: a CSV log has a header that names its columns and lines of values below it, JSON '
     'lines have an object a line, candump has (time) channel frame'),
    (1, ': has 1 samples of speed and power at the same time; at least 2 are needed')])
def test_logs_of_less_than_two_samples_are_refused(tmp_path, rows, problem):
    path = tmp_path / 'short.csv'
    path.write_text(f'{HEADER}\n' + '0,1,200,3,4,5,6\n' * rows, encoding='utf-8')
    assert problems_with(path) == [problem]


@pytest.mark.parametrize('step_s', [0.0, -30.0, 4000.0, float('nan')])
def test_steps_that_make_no_sense_are_refused(write, step_s):
    with pytest.raises(InvalidInput, match=f'^step: {step_s:g} s is not allowed; it must be 1 ... 3600 s$'):
        load_drive_logs([write(samples())], DEFAULTS, step_s=step_s)


def test_current_of_the_wrong_sign_is_refused_until_it_is_repaired(write):
    log = samples()
    right = load_drive_logs([write(log)], DEFAULTS).route
    log['current_a'] = -log['current_a']
    path = write(log)
    with pytest.raises(InvalidInput, match='current_a: is -.* A in the mean while the car drives; positive must '
                       r'mean discharging; read the log with repair \(--repair\)') as refused:
        load_drive_logs([path], DEFAULTS)
    assert len(refused.value.problems) == 1
    assert_same_route(load_drive_logs([path], DEFAULTS, repair=True).route, right, rtol=1e-9)


def test_a_log_that_holds_its_last_readings_is_refused(write):
    columns = {name: np.where(np.arange(600) < 200, column, column[200]) for name, column in samples(600).items()}
    path = write(columns | {'time_s': np.arange(600.0)})
    with pytest.raises(InvalidInput, match='current_a: stays at .* for 399 s from 200 s on while the car drives'):
        load_drive_logs([path], DEFAULTS)
