# SPDX-License-Identifier: Apache-2.0
"""Nights and batteries heated at stand, alone and without charge or power, against closed forms."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat.identification.check import check_trips
from bev_preheat.identification.trips import trip_of
from bev_preheat.logs.recording import Recording, Series
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('small_hatchback')
CAPACITY_J_PER_K, EFFICIENCY = VEHICLE.battery.heat_capacity_j_per_k, VEHICLE.hvch.efficiency
AMBIENT_C, PARKED_C = 2.0, 24.0


def put_night(path, leakage_w_per_k):
    """Write 9 h of a battery that only loses heat: temperatures alone, every 30 s, in tenths of a degree."""
    time_s = np.arange(0.0, 9.0 * 3600.0, 30.0)
    cells_c = AMBIENT_C + (PARKED_C - AMBIENT_C) * np.exp(-leakage_w_per_k / CAPACITY_J_PER_K * time_s)
    np.savetxt(path, np.column_stack((time_s, np.round(cells_c - 1.0, 1), np.round(cells_c + 1.0, 1),
                                      np.full(len(time_s), AMBIENT_C))), '%.5g', ',',
               header='time_s,coldest_cell_c,warmest_cell_c,ambient_c', comments='')


def put_heated(path, ambient_c, end_c, heater_w, capacity_j_per_k, leakage_w_per_k):
    """Write what is known of a heated battery at begin and end as a log of two rows; return its minutes."""
    settled_k = EFFICIENCY * heater_w / leakage_w_per_k
    duration_s = -capacity_j_per_k / leakage_w_per_k * math.log(1.0 - (end_c - ambient_c) / settled_k)
    path.write_text('time_s,battery_temperature_c,ambient_c,battery_heater_w\n'
                    f'0,{ambient_c},{ambient_c},{heater_w}\n{duration_s:.0f},{end_c},{ambient_c},{heater_w}\n')
    return duration_s / 60.0


@pytest.mark.parametrize('leakage_w_per_k', [5.0, 9.0, 20.0])
@pytest.mark.needs('casadi')
def test_a_night_alone_tells_the_leakage_and_nothing_else(tmp_path, said, leakage_w_per_k):
    put_night(tmp_path / 'night.csv', leakage_w_per_k)
    status, output, _ = said(
        'identify', 'night.csv', '--vehicle', 'small_hatchback', '--output', 'my.yaml', '--json', 'my.json')
    assert status == 0 and 'Only 1 log: nothing tests the file' in ' '.join(output.split())
    car, start = load_vehicle(tmp_path / 'my.yaml'), VEHICLE
    assert car.battery.leakage.gamma_0_w_per_k == pytest.approx(leakage_w_per_k, rel=0.05)
    assert car.battery.heat_capacity_j_per_k == start.battery.heat_capacity_j_per_k
    assert car.hvch.efficiency == start.hvch.efficiency
    found = json.loads((tmp_path / 'my.json').read_text())
    leakage = next(item for item in found['parameters'] if item['name'] == 'leakage')
    assert leakage['low'] < leakage_w_per_k < leakage['high'] and leakage['is_identified']
    assert found['leave_one_out'] == {'rmse_k': None, 'worst_k': None, 'trips': []}
    assert 'battery.leakage' not in yaml.safe_load((tmp_path / 'my.yaml').read_text())['assumed']


@pytest.mark.parametrize('scale, leakage_w_per_k', [(0.8, 3.0), (1.15, 10.0)])
@pytest.mark.needs('casadi')
def test_a_third_heating_run_is_predicted_from_two_within_3_percent(tmp_path, said, scale, leakage_w_per_k):
    minutes = {ambient_c: put_heated(tmp_path / f'heated{ambient_c}.csv', ambient_c, 20.0, 5000.0,
                                     scale * CAPACITY_J_PER_K, leakage_w_per_k) for ambient_c in (0, -10, -20)}
    status, output, _ = said('identify', 'heated0.csv', 'heated-10.csv', '--vehicle', 'small_hatchback',
                             '--output', 'my.yaml', '--json', 'my.json')
    assert status == 0 and 'heated from a charger' in ' '.join(output.split())
    parameters = json.loads((tmp_path / 'my.json').read_text())['parameters']
    capacity = next(item for item in parameters if item['name'] == 'heat_capacity')
    assert capacity['low'] < scale * CAPACITY_J_PER_K < capacity['high'] < 1.5 * scale * CAPACITY_J_PER_K
    status, output, _ = said('check', 'heated-20.csv', '--vehicle', './my.yaml', '--json', 'check.json')
    found = json.loads((tmp_path / 'check.json').read_text())['heated_minutes']['heated-20']
    assert found['measured'] == pytest.approx(minutes[-20], abs=0.02)
    assert found['predicted'] == pytest.approx(minutes[-20], rel=0.03)
    assert f'heated for {found["measured"]:.1f} min, predicted {found["predicted"]:.1f} min' in output


@pytest.mark.needs('scipy')
def test_two_logs_have_the_interval_of_the_fit():
    from bev_preheat.identification.uncertainty import bootstrap_intervals
    fit = SimpleNamespace(gradients=np.array([[200.0], [-200.0]]), informations=np.full((2, 1, 1), 15.0),
                          information=np.array([[36.0]]), prior_precision=np.array([[6.0]]),
                          theta=np.array([2.0, 9.0]), free=np.array([True, False]))
    # 1.6449 / sqrt(36); logs that pull apart would draw far wider ends.
    found = bootstrap_intervals(fit)
    assert list(found) == [0] and found[0] == pytest.approx((2.0 - 0.27415, 2.0 + 0.27415), abs=1e-4)


def test_the_minutes_of_a_heated_battery_are_those_of_its_equation(tmp_path, said):
    gamma = VEHICLE.battery.leakage.gamma_0_w_per_k
    minutes = put_heated(tmp_path / 'heated.csv', -20, 15.0, 4000.0, CAPACITY_J_PER_K, gamma)
    for name, end_c in (('early', 10.0), ('late', 17.0)):
        # A car that was colder or warmer after these minutes took longer or less.
        (tmp_path / f'{name}.csv').write_text((tmp_path / 'heated.csv').read_text().replace('15.0', f'{end_c}'))
        expected = -CAPACITY_J_PER_K / gamma * math.log(1.0 - (end_c + 20.0) * gamma / EFFICIENCY / 4000.0) / 60.0
        assert said('check', f'{name}.csv', '--vehicle', 'small_hatchback', '--json', 'check.json')[0] == 0
        found = json.loads((tmp_path / 'check.json').read_text())['heated_minutes'][name]
        assert found['measured'] == pytest.approx(minutes, abs=0.02)
        assert found['predicted'] == pytest.approx(expected, rel=5e-3)


def series(times_s, values):
    return Series(np.array(times_s, dtype=float), np.array(values, dtype=float))


@pytest.mark.parametrize('changes, line', [
    ({'speed_mps': series((0, 600), (0, 20))}, 'no soc'),
    ({'battery_heater_w': None}, 'no power'),
    ({'soc': series((0, 600), (0.8, 0.7))}, 'no power'),
    ({'power_w': series((0, 600), (15e3, 15e3))}, 'no soc'),
    ({'battery_temperature_c': None}, 'as a log of two rows')])
def test_only_a_log_at_stand_may_lack_charge_and_power(changes, line):
    signals = {'battery_temperature_c': series((0, 600), (0, 6)), 'ambient_c': series((0, 600), (0, 0)),
               'battery_heater_w': series((0, 600), (5e3, 5e3))}
    assert trip_of(Recording('heated', signals), VEHICLE).kind == 'heated at stand'
    changed = {name: value for name, value in {**signals, **changes}.items() if value is not None}
    with pytest.raises(InvalidInput, match=line):
        trip_of(Recording('heated', changed), VEHICLE)


def test_a_heater_that_the_battery_feeds_at_stand_is_no_drive():
    time_s = np.arange(7200.0)
    # 5 kW from the battery for half an hour, every hour.
    heater_w = np.where(time_s % 3600.0 < 1800.0, 5000.0, 0.0)
    ends_s = (0, 7199)
    signals = {
        'battery_temperature_c': series(time_s, np.cumsum(heater_w) / 6e5 - 20.0),
        'soc': series(ends_s, (0.8, 0.7)), 'speed_mps': series(ends_s, (0, 0)),
        'ambient_c': series(ends_s, (-20, -20)), 'power_w': series(time_s, heater_w + 50.0),
        'battery_heater_w': series(time_s, heater_w),
        'cabin_heater_w': series(ends_s, (0, 0)), 'auxiliary_w': series(ends_s, (50, 50))}
    trip = trip_of(Recording('chamber', signals), VEHICLE)
    assert trip.kind == 'heated at stand'
    # It rests at the end: nothing says how long the heating should have taken.
    assert not check_trips(VEHICLE, [trip]).heated_minutes
