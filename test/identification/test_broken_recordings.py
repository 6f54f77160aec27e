# SPDX-License-Identifier: Apache-2.0
"""Recordings that cannot tell anything are answered by one line each."""

from dataclasses import replace

import numpy as np
import pytest
from recorded import night, recording
from refusals import problems_of

from bev_preheat.errors import InvalidInput
from bev_preheat.identification.recording_checks import refuse_doubted
from bev_preheat.identification.trips import refuse_poor, trip_of, trips_of
from bev_preheat.logs.recording import Series
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('small_car')
TIME_S = np.arange(1200.0)


@pytest.mark.parametrize('changes, line', [
    ({'battery_temperature_c': None}, "no battery_temperature_c; record the battery's temperature"),
    ({'soc': None}, 'no soc; record the state of charge'),
    ({'ambient_c': None}, 'no ambient_c; record the outside temperature'),
    ({'current_a': None}, 'no power; record voltage_v and current_a, or power_w'),
    ({'soc': lambda soc: 100.0 * soc}, 'soc: 79.9889 after 0 s; it must be 0 ... 1'),
    ({'battery_temperature_c': lambda at_c: at_c + 273.15}, 'battery_temperature_c: 278.15 after 0 s'),
    ({'voltage_v': lambda v: v / 1000.0}, 'voltage_v: 0.376'),
    ({'voltage_v': lambda v: np.full_like(v, 380.0)}, 'voltage_v: stays at 380.0 V while the current changes'),
    ({'current_a': lambda a: -a}, 'current_a: it grows while the state of charge rises; positive must'),
    ({'current_a': lambda a: 1000.0 * a}, 'current_a: '),
    ({'speed_mps': lambda v: 10.0 * v}, 'speed_mps: 150 after 0 s; it must be 0 ... 100'),
    ({'cabin_heater_w': lambda w: 1000.0 * w}, 'cabin_heater_w: 1000000 after 0 s'),
    ({'ambient_c': lambda at_c: at_c + 99.0}, 'ambient_c: 99 after 0 s'),
    ({'soc': Series(TIME_S + 5000.0, np.full(1200, 0.5))}, 'together last 0 s; a log must last at least 120 s'),
    # Stuck or jumping signals.
    ({'soc': lambda soc: np.full_like(soc, 0.5)},
     'soc: stays at 0.5 while +13.5 Ah are drawn; record the state of charge'),
    ({'current_a': lambda a: 0.0 * a, 'speed_mps': lambda v: np.where(TIME_S < 600.0, v, 0.0)},
     "current_a: stays at 0 A while the car drives; record the battery's current"),
    ({'current_a': lambda a: np.where(TIME_S < 700.0, a, a[700]), 'speed_mps': lambda v: np.where(
        TIME_S < 700.0, v, 15.0)}, ' for 499 s from 700 s on while the car drives; the logger held its last'),
    ({'battery_temperature_c': lambda c: c + np.where(TIME_S < 600.0, 0.0, 20.0)},
     'battery_temperature_c: jumps from '),
])
def test_a_broken_recording_is_answered_by_one_line(changes, line):
    (problem,) = problems_of(trip_of, recording('B', **changes), VEHICLE)
    assert problem.startswith('B: ') and line in problem


def test_a_refusal_for_little_change_names_the_gap_that_cut_the_logs():
    gap = (TIME_S > 500.0) & (TIME_S < 800.0)
    cut = {key: Series(each.time_s[~gap], each.value[~gap]) for key, each in recording().signals.items()}
    cut['battery_temperature_c'] = Series(TIME_S, np.where(TIME_S < 600.0, 5.0, 9.0))
    trips = [trip_of(replace(recording(name), signals=cut), VEHICLE) for name in 'ABC']
    with pytest.raises(InvalidInput, match='no sample for 300 s after 500 s'):
        refuse_poor(trips)


@pytest.mark.parametrize('missing, told', [
    ((0.0, 500.0), ['soc: begins after 500 s; only 500 ... 1199 s are used']),
    ((700.0, 1200.0), ['soc: ends after 699 s; only 0 ... 699 s are used']), ((0.0, 100.0), [])])
def test_a_signal_that_cuts_the_log_is_named(missing, told):
    known = (TIME_S < missing[0]) | (TIME_S >= missing[1])
    soc = Series(TIME_S[known], recording().signals['soc'].value[known])
    assert [each for each in trip_of(recording(soc=soc), VEHICLE).remarks if 'are used' in each] == told


def test_a_night_lasts_as_long_as_its_temperature_although_the_charge_is_logged_on_change():
    signals = {key: each for key, each in night(hours=8.0).signals.items() if key != 'power_w'}
    signals['soc'] = Series(np.array([0.0, 600.0]), np.array([0.6, 0.61]))
    trip = trip_of(replace(night(), signals=signals), VEHICLE)
    assert len(trip) == 8 * 3600 - 60 + 1 and trip.soc[[0, -1]].tolist() == [0.6, 0.61]


@pytest.mark.parametrize('above_k, told', [(19.0, False), (22.0, True)])
def test_a_battery_that_the_car_may_have_cooled_is_named(above_k, told):
    """With one log in which a chiller worked, a car's heat capacity came out a quarter too small."""
    trip = trip_of(recording(battery_temperature_c=lambda at_c: at_c + above_k), VEHICLE)
    assert any(remark.endswith('leave the log out if the car cools it there') for remark in trip.remarks) == told


def test_the_heater_of_cabin_and_battery_counts_the_battery_once():
    heated_w = np.where(TIME_S < 600.0, 3000.0, 0.0)
    trip = trip_of(recording(cabin_heater_w=None, battery_heater_w=Series(TIME_S, heated_w),
                             heater_w=Series(TIME_S, heated_w + 1000.0)), VEHICLE)
    assert trip.cabin_heating_power_w == pytest.approx(1000.0)
    assert trip.propulsion_power_w == pytest.approx(trip.voltage_v * trip.current_a - heated_w - 1400.0)
    assert not trip.remarks


RARE_S = TIME_S[::25]


@pytest.mark.parametrize('changes', [
    {'battery_temperature_c': lambda c: np.where(np.abs(TIME_S - 600.0) < 2.0, 60.0, c)},
    {'current_a': lambda a: np.where(TIME_S < 700.0, a, 4.0),
     'speed_mps': lambda v: np.where(TIME_S < 699.0, v, 0.0)},
    {'current_a': Series(RARE_S, np.where(RARE_S < 700.0, 80.0 + RARE_S % 7.0, 84.0))}],
    ids=['three wrong readings', 'steady current of a car that stands', 'few readings, the same for minutes'])
def test_what_may_be_is_not_refused(changes):
    assert len(trip_of(recording(**changes), VEHICLE))


def test_the_longest_part_of_a_log_with_a_hole_is_used():
    whole = trip_of(recording('A'), VEHICLE)
    for begin_s, part in ((900.0, slice(0, 900)), (200.0, slice(200, 1200))):
        times_s = np.where(TIME_S < begin_s, TIME_S, TIME_S + 121.0)
        broken = {key: Series(times_s, series.value) for key, series in recording().signals.items()}
        trip = trip_of(recording('B', **broken), VEHICLE)
        assert np.array_equal(trip.power_w, whole.power_w[part])
        said = ' '.join(trip.remarks)
        assert f'no sample for 122 s after {begin_s - 1.0:.0f} s while the car draws power' in said
        assert f'only {times_s[part][0]:.0f} ... {times_s[part][-1]:.0f} s are used' in said
    short = {key: Series(np.where(TIME_S[:200] < 100.0, TIME_S[:200], TIME_S[:200] + 99.0), series.value[:200])
             for key, series in recording().signals.items()}
    with pytest.raises(InvalidInput, match='a log must last at least 120 s .(current_a|voltage_v): no sample for'):
        trip_of(recording('D', **short), VEHICLE)


def test_a_gap_is_named_as_such_however_much_charge_it_would_hold():
    # The last sample before the gap regenerates: 40 A for 14 h would be more than the battery holds.
    held = recording('B').signals['current_a'].value.copy()
    held[598:600] = -40.0
    broken = recording('B', current_a=Series(np.where(TIME_S < 600.0, TIME_S, TIME_S + 50000.0), held))
    assert 'current_a: no sample for 50001 s after 599 s' in ' '.join(trip_of(broken, VEHICLE).remarks)


def test_a_fit_refuses_a_unit_in_doubt_and_a_refusal_says_what_the_reading_dropped():
    thousandth = recording('B', current_a=lambda a: a / 1000.0)
    with pytest.raises(InvalidInput, match='B: current_a: its integral .* a factor of 1000 is missing; correct'):
        refuse_doubted(thousandth)
    refuse_doubted(recording('B'))
    kilowatts = recording('B', battery_heater_w=Series(TIME_S, np.full(1200, 6.5)))
    with pytest.raises(InvalidInput, match='B: battery_heater_w: is at most 6.5 W; is it in kW. correct it'):
        refuse_doubted(kilowatts)
    without = replace(recording('B', soc=None), remarks=('b.csv: soc: is dropped', 'b.csv: other'))
    assert problems_of(trip_of, without, VEHICLE) == [
        'B: no soc; record the state of charge (b.csv: soc: is dropped)']


def test_a_short_recording_and_one_of_days_are_refused():
    with pytest.raises(InvalidInput, match='B: .* together last 59 s; a log must last at least 120 s'):
        trip_of(recording('B', 60), VEHICLE)
    with pytest.raises(InvalidInput, match='B: lasts 80 h; at most 72 h'):
        trip_of(night('B', 80.0), VEHICLE)


def test_a_recording_named_twice_is_refused():
    with pytest.raises(InvalidInput, match='B: is the same recording as A; name each log once'):
        trips_of([recording('A'), recording('B')], VEHICLE)


@pytest.mark.parametrize('recordings, line', [
    ([recording('A')], '1 usable log; at least 3 are needed'),
    ([recording(str(number), 1200 + number, battery_temperature_c=lambda c: 0.0 * c + 7.0) for number in range(3)],
     'battery_temperature_c changes by at most 0.0 K within a log'),
    ([recording(name, current_a=lambda a: np.full_like(a, -40.0), speed_mps=lambda v: 0.0 * v,
                soc=lambda s: 0.5 + TIME_S / 1e4, voltage_v=lambda v: 0.0 * v + 384.0) for name in 'A'],
     'none of the logs is a drive')])
def test_trips_that_tell_too_little_are_refused_with_what_to_record(recordings, line):
    problem, *_ = problems_of(lambda: refuse_poor(trips_of(recordings, VEHICLE)))
    assert line in problem and 'record' in problem


def test_standing_has_no_propulsion_whatever_is_charged():
    trip = trip_of(recording(current_a=lambda a: np.full_like(a, -40.0), speed_mps=lambda v: 0.0 * v,
                             soc=lambda s: 0.5 + TIME_S / 1e4, voltage_v=lambda v: 0.0 * v + 384.0),
                   VEHICLE)
    assert trip.kind == 'charging session'
    assert np.abs(trip.propulsion_power_w).max() == 0.0
