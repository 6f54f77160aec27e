# SPDX-License-Identifier: Apache-2.0
"""The best target within a range: against a scan of starts, for tables of charging times and sessions."""

import math

import numpy as np
from plain_car import drive
import pytest

from bev_preheat.charging.target_range import by_table, read_charging_times, targets_in_range
from bev_preheat.charging.target_worth import Prices
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.two_switches import maximum_between
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import Table

CAR = load_vehicle('crossover_800v')
STATE, GOAL, PRICES = BatteryState(2.0, 0.7), Goal(25.0, 0.1), Prices(0.5, 15.0)
# 300 s less from 22 to 23 degC, and 40 s less for each 10 % of charge.
STEP = Table((0.0, 1.0), (-10.0, 20.0, 22.0, 23.0, 30.0), (
    (1900.0, 1300.0, 1290.0, 990.0, 980.0), (1500.0, 900.0, 890.0, 590.0, 580.0)))
FLAT = Table((0.0,), (0.0,), ((900.0,),))
HOUR, TEN_MINUTES = (drive(minutes, -6.0, 800.0, 18e3) for minutes in (60, 10))


def cheapest_start(after, low_c, high_c):
    """Return the least cost of heating from one instant until arrival, by a scan in steps of 2 s."""
    trip = make_trip(CAR, HOUR.divided(4.0))
    costs = [math.inf]
    for start_s in np.arange(0.0, 3600.0, 2.0).tolist():
        driven = drive_as_planned(trip, STATE, maximum_between(trip, start_s, 3600.0))
        arrival = BatteryState(float(driven.temperature_c[-1]), float(driven.soc[-1]))
        if low_c <= arrival.temperature_c <= high_c:
            charged = after(arrival)
            costs.append(PRICES.energy_per_kwh * charged.bought_wh / 1e3
                         + PRICES.time_per_h * charged.time_s / 3600.0)
    return min(costs)


@pytest.mark.parametrize('times, low_c, high_c, best_c', [
    (STEP, 18.0, 25.0, 23.0), (STEP, 18.0, 21.5, 18.0), (FLAT, 20.0, 25.0, 20.0)])
def test_the_best_target_costs_no_more_than_the_best_start_of_a_scan(times, low_c, high_c, best_c):
    after = by_table(CAR, times, 0.8)
    best = targets_in_range(CAR, HOUR, STATE, GOAL, (low_c, high_c), after, PRICES)[0]
    assert best.arrival_temperature_c == pytest.approx(best_c, abs=0.06)
    assert best.cost <= cheapest_start(after, low_c, high_c) + 1e-4
    assert best.charging_time_s == pytest.approx(after(BatteryState(
        best.arrival_temperature_c, best.arrival_soc)).time_s)


def test_an_arrival_below_the_range_or_the_reserve_costs_infinitely_and_a_warm_battery_is_not_heated():
    after = by_table(CAR, STEP, 0.8)
    assert targets_in_range(CAR, TEN_MINUTES, STATE, GOAL, (20.0, 25.0), after, PRICES)[0].cost == math.inf
    poor = targets_in_range(CAR, HOUR, BatteryState(2.0, 0.4), Goal(25.0, 0.15), (20.0, 25.0), after, PRICES)[0]
    assert poor.cost == math.inf
    warm = targets_in_range(CAR, TEN_MINUTES, BatteryState(40.0, 0.7), GOAL, (20.0, 25.0), after, PRICES)
    assert len(warm) == 1 and warm[0].hvch_electric_wh == 0.0 and math.isfinite(warm[0].cost)


@pytest.mark.parametrize('range_c', [(25.0, 20.0), (-41.0, 20.0), (20.0, 61.0), (math.nan, 25.0)])
def test_a_range_that_cannot_be_is_refused(range_c):
    with pytest.raises(InvalidInput, match='target range: .* it must rise within -40 ... 60 degC'):
        targets_in_range(CAR, HOUR, STATE, GOAL, range_c, by_table(CAR, STEP, 0.8), PRICES)


@pytest.mark.parametrize('departure_soc', [9.0, -0.1, math.nan])
def test_a_departure_that_cannot_be_is_refused(departure_soc):
    with pytest.raises(InvalidInput, match='departure state of charge: .* it must be 0 ... 1'):
        by_table(CAR, STEP, departure_soc)


HEADER = 'arrival_soc,arrival_temperature_c,charging_time_s\n'


def test_charging_times_are_read_in_any_order_and_are_linear_in_between(tmp_path):
    file = tmp_path / 'times.csv'
    file.write_text(f'{HEADER}0.5,20,600\n0.1,20,1200\n0.1,0,2000\n0.5,0,1000\n')
    table = read_charging_times(file)
    assert table == Table((0.1, 0.5), (0.0, 20.0), ((2000.0, 1200.0), (1000.0, 600.0)))
    assert by_table(CAR, table, 0.8)(BatteryState(10.0, 0.3)).time_s == pytest.approx(1200.0)


@pytest.mark.parametrize('rows, problem', [
    ('0.1,0,2000\n0.1,20,1200\n0.5,0,1000\n', '3 rows for 2 states of charge and 2 temperatures'),
    ('0.1,0,2000\n0.1,0,1200\n', '2 rows for 1 states of charge and 1 temperatures'),
    ('10,0,2000\n', 'arrival_soc: 10 is not allowed; it must be 0 ... 1'),
    ('0.1,0,-1\n', 'charging_time_s: -1 is not allowed; it must be 0 ... 86400'),
    ('0.1,293,900\n', 'arrival_temperature_c: 293 is not allowed; it must be -60 ... 100')])
def test_charging_times_that_cannot_be_are_refused(tmp_path, rows, problem):
    file = tmp_path / 'times.csv'
    file.write_text(HEADER + rows)
    with pytest.raises(InvalidInput, match=problem):
        read_charging_times(file)
    file.write_text('arrival_soc,charging_time_s\n0.1,900\n')
    with pytest.raises(InvalidInput, match='has no column arrival_temperature_c; it must have arrival_soc, '):
        read_charging_times(file)
