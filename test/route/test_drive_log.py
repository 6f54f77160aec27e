# SPDX-License-Identifier: Apache-2.0
"""Drive logs: means, root mean squares, gaps and faults, on small synthetic logs."""

from dataclasses import asdict, fields, replace
import errno
import os
from pathlib import Path

import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.planning.dynamics import run_forward
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.drive_log import load_drive_logs
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import Defaults
from bev_preheat.vehicle.model import make_runge_kutta_4

DEFAULTS = Defaults(cabin_heating_power_w=1111.0, auxiliary_power_w=222.0,
                    target_battery_temperature_c=21.0)
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


def problems_with(path, **options):
    with pytest.raises(InvalidInput) as caught:
        load_drive_logs([path], DEFAULTS, **options)
    for problem in caught.value.problems:
        assert problem.startswith(str(path))
    return [problem.removeprefix(str(path)) for problem in caught.value.problems]


def with_value(name, index, value):
    columns = {key: list(values) for key, values in samples().items()}
    columns[name][index] = value
    return columns


def assert_same_route(one, other, **tolerance):
    for field in fields(Route):
        np.testing.assert_allclose(getattr(one, field.name), getattr(other, field.name),
                                   **tolerance)


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
    propulsion_w = (log['voltage_v'] * log['current_a'] - log['cabin_heater_w'] - log['aircon_w']
                    - 222.0)
    assert route.propulsion_power_rms_w**2 @ route.duration_s == pytest.approx(
        propulsion_w @ propulsion_w)
    assert route.distance_m == pytest.approx(log['speed_mps'].sum())


def test_power_may_stand_in_for_voltage_and_current(write):
    log = samples()
    power = {**log, 'power_w': log['voltage_v'] * log['current_a']}
    del power['voltage_v'], power['current_a']
    assert_same_route(load_drive_logs([write(power, 'power.csv')], DEFAULTS).route,
                      load_drive_logs([write(log)], DEFAULTS).route, rtol=1e-12)


def test_without_air_conditioning_the_constant_auxiliaries_remain(write):
    log = samples()
    with_aircon = load_drive_logs([write(log)], DEFAULTS).route
    del log['aircon_w']
    without = load_drive_logs([write(log)], DEFAULTS).route
    aircon_w = np.array([90.0 + 14.5, 90.0 + 44.5])
    assert without.auxiliary_power_w == pytest.approx([222.0, 222.0])
    assert without.propulsion_power_w == pytest.approx(with_aircon.propulsion_power_w + aircon_w)


def test_other_columns_and_comments_are_left_alone(write):
    log = samples()
    expected = load_drive_logs([write(log)], DEFAULTS).route
    extra = {'elevation_m': ['high'] * 60, **log, 'soc': np.full(60, 7.0)}
    path = write(extra, 'extra.csv')
    path.write_text('# made today\n\n' + path.read_text(encoding='utf-8'), encoding='utf-8')
    assert_same_route(load_drive_logs([path], DEFAULTS).route, expected)


def test_ten_samples_a_second(write):
    time = np.arange(600) / 10.0
    current = 40.0 + 30.0 * np.sin(time)
    route = load_drive_logs([write({
        'time_s': time, 'speed_mps': np.full(600, 20.0), 'voltage_v': np.full(600, 400.0),
        'current_a': current, 'cabin_heater_w': np.full(600, 0.0),
        'ambient_c': np.full(600, 1.0)})], DEFAULTS).route
    assert route.total_duration_s == pytest.approx(60.0)
    assert route.propulsion_power_w == pytest.approx(
        400.0 * current.reshape(2, 300).mean(axis=1) - 222.0)


def test_logs_are_joined_in_order(write):
    first, second = samples(40), samples(35, start=500)
    joined = load_drive_logs([write(first, 'a.csv'), write(second, 'b.csv')], DEFAULTS).route
    both = {name: np.concatenate((first[name], second[name])) for name in first}
    both['time_s'] = np.arange(75)
    assert joined.duration_s.tolist() == [30.0, 30.0, 15.0]
    assert_same_route(joined, load_drive_logs([write(both, 'both.csv')], DEFAULTS).route,
                      rtol=1e-12)


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
        f'{path}, line 22: 10 s without a valid sample, from 19 s to 29 s, are bridged',)


def test_a_longer_gap_is_refused(write):
    assert problems_with(write(RAMP, left_out=range(20, 30))) == [
        ', line 22: 11 s without a valid sample, from 19 s to 30 s; at most 10 s are bridged']


def test_too_many_gaps_are_refused(write):
    assert problems_with(write(RAMP, left_out=range(1, 60, 4))) == [
        ': 15 s without samples, in 15 gaps; at most 11.8 s, 20% of the log, are bridged']


def test_the_sixth_gap_and_more_are_counted(write):
    columns = {name: np.concatenate((values, values[-1] + np.arange(1, 61) * (
        1.0 if name == 'time_s' else 0.0))) for name, values in RAMP.items()}
    path = write(columns, left_out=range(10, 110, 10))
    remarks = load_drive_logs([path], DEFAULTS).remarks
    assert len(remarks) == 6
    assert remarks[4].startswith(f'{path}, line 48: 2 s without a valid sample, from 49 s to 51 s')
    assert remarks[5] == f'{path}: 5 more gaps are bridged'


@pytest.mark.parametrize('name, value, allowed', [
    ('speed_mps', -0.5, '0 ... 100'), ('speed_mps', 130.0, '0 ... 100'),
    ('voltage_v', 0.0, '1 ... 1500'), ('voltage_v', -370.0, '1 ... 1500'),
    ('current_a', 65535.0, '-3000 ... 3000'), ('current_a', -3200.0, '-3000 ... 3000'),
    ('ambient_c', 271.0, '-60 ... 60'), ('ambient_c', -99.0, '-60 ... 60'),
    ('cabin_heater_w', -1.0, '0 ... 50000'), ('cabin_heater_w', 1e6, '0 ... 50000'),
    ('aircon_w', -9.0, '0 ... 50000'),
    ('speed_mps', 'nan', '0 ... 100'), ('voltage_v', '', '1 ... 1500'),
    ('current_a', 'inf', '-3000 ... 3000')])
def test_an_impossible_sample_is_reported_and_bridged(write, name, value, allowed):
    path = write(with_value(name, 17, value), 'fault.csv')
    made = load_drive_logs([path], DEFAULTS)
    shown = 'nan' if value == '' else f'{float(value):g}'
    assert made.remarks == (
        f'{path}, line 19: {name}: {shown} is dropped; allowed: {allowed}',
        f'{path}, line 20: 2 s without a valid sample, from 16 s to 18 s, are bridged')
    missing = load_drive_logs([write(samples(), left_out=[17])], DEFAULTS)
    assert_same_route(made.route, missing.route, rtol=1e-12)


def test_further_impossible_samples_are_counted(write):
    columns = with_value('voltage_v', 7, 0.0)
    columns['voltage_v'][31] = columns['voltage_v'][32] = -1.0
    path = write(columns)
    assert load_drive_logs([path], DEFAULTS).remarks[0] == (
        f'{path}, line 9: voltage_v: 0 is dropped; allowed: 1 ... 1500 (and 2 more lines)')


def test_impossible_samples_at_the_ends_shorten_the_log(write):
    columns = with_value('voltage_v', 0, 0.0)
    columns['voltage_v'][59] = 0.0
    route = load_drive_logs([write(columns)], DEFAULTS).route
    assert route.total_duration_s == pytest.approx(58.0)


def test_a_log_of_impossible_samples_is_refused(write):
    columns = {**samples(), 'voltage_v': np.full(60, 0.0)}
    assert problems_with(write(columns)) == [
        ': has 0 valid samples; at least 2 are needed']


@pytest.mark.parametrize('value, shown', [(16.0, '16'), (3.5, '3.5')])
def test_time_that_does_not_rise_is_refused(write, value, shown):
    assert problems_with(write(with_value('time_s', 17, value))) == [
        f', line 19: time_s: {shown} is not after 16 of the previous sample']


def test_time_that_is_missing_is_refused(write):
    assert problems_with(write(with_value('time_s', 17, ''))) == [
        ', line 19: time_s: nan is not a time']


def test_text_in_place_of_a_number_is_refused(write):
    assert problems_with(write(with_value('current_a', 4, 'n/a'))) == [
        ", line 6: current_a: 'n/a' is not a number"]


def test_rows_of_another_length_are_refused(write):
    path = write(samples())
    with path.open('a', encoding='utf-8') as file:
        file.write('60,1,2\n')
    assert problems_with(path) == [', line 62: has 3 values; the header names 7 columns']


def test_missing_columns_are_named_with_what_they_may_be_called(write):
    log = samples()
    renamed = {'time_s': log['time_s'], 'speed_mps': log['speed_mps'], 'voltage': log['voltage_v'],
               'amps': log['current_a'], 'ambient_c': log['ambient_c']}
    assert problems_with(write(renamed)) == [
        ', line 1: missing column cabin_heater_w or cabin_heater_kw',
        ", line 1: column 'voltage' has no unit: rename it to voltage_v",
        ', line 1: missing column current_a (or power_w or power_kw)']


def test_columns_named_twice_are_refused(tmp_path):
    path = tmp_path / 'twice.csv'
    path.write_text(f'# log\n{HEADER},speed_mps\n' + '0,1,2,3,4,5,6,7\n' * 2, encoding='utf-8')
    assert problems_with(path) == [', line 2: column speed_mps is named more than once']


@pytest.mark.parametrize('rows, count', [(0, 0), (1, 1)])
def test_logs_of_less_than_two_samples_are_refused(tmp_path, rows, count):
    path = tmp_path / 'short.csv'
    path.write_text(f'{HEADER}\n' + '0,1,2,3,4,5,6\n' * rows, encoding='utf-8')
    assert problems_with(path) == [
        f': has {count} samples; at least 2 are needed, below a header']


def test_a_log_that_is_not_there_is_named(tmp_path):
    assert problems_with(tmp_path / 'nowhere.csv') == [
        f': cannot be read: {os.strerror(errno.ENOENT)}']


@pytest.mark.parametrize('step_s', [0.0, -30.0, 4000.0, float('nan')])
def test_steps_that_make_no_sense_are_refused(write, step_s):
    with pytest.raises(InvalidInput, match=f'^step: {step_s:g} s is not allowed; it must be '
                                           '1 ... 3600 s$'):
        load_drive_logs([write(samples())], DEFAULTS, step_s=step_s)


def test_current_of_the_wrong_sign_is_noticed(write):
    log = samples()
    log['current_a'] = -log['current_a']
    path = write(log)
    assert load_drive_logs([path], DEFAULTS).remarks == (
        f'{path}: net regeneration over the log; is the current really positive when the '
        'battery is discharged?',)


# Measured drives --------------------------------------------------------------------------------

def measured_logs():
    """Return nine winter drives of a BMW i3 (TU Munich, doi 10.21227/6jr9-5235), not in this project."""
    folder = os.environ.get('BEV_PREHEAT_DRIVE_LOGS')
    folder = Path(folder) if folder else (
        Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'i3_winter_trips')
    return sorted(folder.glob('Trip*.csv'))


needs_measured_logs = pytest.mark.skipif(not measured_logs(), reason=(
    'needs the measured winter drives of a BMW i3 (TU Munich, doi 10.21227/6jr9-5235) in the '
    'folder BEV_PREHEAT_DRIVE_LOGS'))


@needs_measured_logs
def test_measured_drives():
    for path in measured_logs():
        made = load_drive_logs([path], DEFAULTS)
        table = np.genfromtxt(path, delimiter=',', names=True)
        route = made.route
        terminal_w = (route.propulsion_power_w + route.cabin_heating_power_w
                      + route.auxiliary_power_w)
        # These logs have no gaps: no remarks, no losses.
        assert made.remarks == ()
        assert route.total_duration_s == len(table)
        assert route.distance_m == pytest.approx(table['speed_mps'].sum())
        assert terminal_w @ route.duration_s == pytest.approx(
            table['voltage_v'] @ table['current_a'], rel=1e-9)
        # A third or more of the mean square is variation that the means hide.
        assert (route.propulsion_power_rms_w**2 @ route.duration_s
                > 1.5 * route.propulsion_power_w**2 @ route.duration_s)


@needs_measured_logs
def test_a_measured_hour_in_steps_of_half_a_minute_warms_as_it_was_driven():
    """At the paper's share of the drivetrain's heat, compared with the model driven second by second."""
    car = load_vehicle('small_car')
    car = replace(car, drivetrain=replace(
        car.drivetrain, efficiency=0.9, heat_recovery_efficiency=0.8))

    def arrival_c(route):
        trip = make_trip(car, route)
        return run_forward(trip, make_runge_kutta_4, 0.9, 0.0)[1][-1]

    hour = measured_logs()[:3]
    driven = load_drive_logs(hour, car.defaults, 1.0).route
    planned = load_drive_logs(hour, car.defaults, 30.0).route
    unknown = make_route({**asdict(planned), 'propulsion_power_magnitude_w': None}, None)
    assert driven.total_duration_s > 3600.0
    driven_c = arrival_c(driven)
    assert arrival_c(planned) == pytest.approx(driven_c, abs=0.5)
    assert arrival_c(unknown) == pytest.approx(driven_c, abs=0.5)
    # The magnitude of the mean alone would not give this.
    still = replace(planned, propulsion_power_magnitude_w=np.abs(planned.propulsion_power_w))
    assert arrival_c(still) < driven_c - 1.5
