# SPDX-License-Identifier: Apache-2.0
"""The distributions of a study's cars."""

from dataclasses import replace

import numpy as np
import pytest
from short_drives import short_conditions

from bev_preheat.simulation.heater import NO_LEASE
from bev_preheat_studies.robustness.drawn_cars import draw_car

CONDITIONS = short_conditions()
SPREAD = {'heat_capacity': 0.1, 'leakage': 0.2, 'resistance': 0.2, 'heater': 0.05,
          'propulsion_power': 0.1}


def test_same_seed_and_number_draw_the_same_car():
    first, second = (draw_car(CONDITIONS, 4, 9) for _ in range(2))
    assert first.mismatch == second.mismatch
    cars = first.car(), second.car()
    for car in cars:
        car.plant.advance(60.0, 2000.0)
    assert cars[0].plant.temperature_c == cars[1].plant.temperature_c
    assert cars[0].readings() == cars[1].readings()


@pytest.mark.parametrize('other', [(4, 10), (5, 9), (9, 4)])
def test_other_seed_or_number_draws_another_car(other):
    first, second = draw_car(CONDITIONS, 4, 9), draw_car(CONDITIONS, *other)
    assert first.mismatch != second.mismatch
    powers_w = [trip.car().plant.route.propulsion_power_w for trip in (first, second)]
    # Beyond a factor that is the same in all segments.
    assert np.ptp(powers_w[0] / powers_w[1]) > 0.01


@pytest.fixture(scope='module')
def mismatches():
    return [draw_car(CONDITIONS, 1, number).mismatch for number in range(2000)]


@pytest.mark.parametrize('name', SPREAD)
def test_factors_are_drawn_evenly_within_their_spread(mismatches, name):
    factors = [getattr(mismatch, name) for mismatch in mismatches]
    shares = np.sort((np.array(factors) - 1.0) / SPREAD[name] / 2.0 + 0.5)
    assert 0.0 <= shares[0] and shares[-1] <= 1.0
    # Kolmogorov-Smirnov: a uniform distribution is further off in 1 of 10 000 cases.
    assert np.abs(shares - (np.arange(2000) + 0.5) / 2000).max() < 2.23 / np.sqrt(2000)


def test_factors_are_drawn_independently(mismatches):
    correlations = np.corrcoef([[getattr(mismatch, name) for mismatch in mismatches]
                                for name in SPREAD])
    assert np.abs(correlations - np.eye(5)).max() < 4.5 / np.sqrt(2000)


def test_temperature_is_read_in_whole_degrees_with_noise():
    car = draw_car(short_conditions(period_s=0.5), 1, 2).car()
    car.advance_under(NO_LEASE, 200.0)
    read_c = [reading.temperature_c for reading in car.readings()]
    assert all(value == round(value) for value in read_c)
    # Near 15.5 degC a noise of 0.2 K makes it go up and down.
    assert (np.diff(read_c) > 0).any() and (np.diff(read_c) < 0).any()


def test_power_is_reported_if_wanted():
    for reports in (True, False):
        reading, = draw_car(short_conditions(reports_power=reports), 1, 2).car().readings()
        assert (reading.voltage_v is not None) is reports


@pytest.mark.parametrize('plant, has', [
    ('nominal', ()), ('lag', ('heater_lag_s',)), ('ripple', ()), ('sensor_lag', ('sensor_lag_s',)),
    ('coolant', ('coolant_heat_capacity_j_per_k', 'coolant_conductance_w_per_k')),
    ('all', ('heater_lag_s', 'coolant_heat_capacity_j_per_k', 'coolant_conductance_w_per_k',
             'sensor_lag_s'))])
def test_a_plant_has_what_its_name_says_drawn_from_its_range(plant, has):
    ranges = {'heater_lag_s': (0.0, 90.0), 'coolant_heat_capacity_j_per_k': (5e3, 40e3),
              'coolant_conductance_w_per_k': (200.0, 1000.0), 'sensor_lag_s': (0.0, 120.0)}
    conditions = short_conditions(plant=plant)
    paths = [vars(draw_car(conditions, 1, number).heat_path) for number in range(40)]
    for name, (low, high) in ranges.items():
        values = [path[name] for path in paths]
        if name not in has:
            assert set(values) == {0.0}
            continue
        middle, quarter = 0.5 * (low + high), 0.25 * (high - low)
        assert low <= min(values) < middle - quarter < middle + quarter < max(values) <= high


def test_plants_differ_in_their_path_alone():
    factors = [replace(draw_car(short_conditions(plant=plant), 1, 7).mismatch, visible_variation=False)
               for plant in ('nominal', 'lag', 'all')]
    assert factors[0] == factors[1] == factors[2]


def test_routes_are_taken_in_turn():
    one, other = short_conditions().routes[0], short_conditions().routes[0].with_propulsion(0.9)
    conditions = short_conditions(routes=(one, other))
    assert [draw_car(conditions, 1, number).route for number in range(4)] == [one, other, one, other]


def test_traffic_makes_trips_longer_or_shorter_and_nothing_else():
    plain, slow = short_conditions(), short_conditions(traffic=0.2)
    paces = np.array([draw_car(slow, 1, number).pace for number in range(400)])
    assert 0.8 <= paces.min() < 0.81 and 1.19 < paces.max() <= 1.2
    assert abs(paces.mean() - 1.0) < 0.02
    trips = draw_car(plain, 1, 7), draw_car(slow, 1, 7)
    assert (trips[0].mismatch, trips[0].pace) == (trips[1].mismatch, 1.0)
    before, after = (trip.car().plant for trip in trips)
    assert after.duration_s == pytest.approx(trips[1].pace * before.duration_s)
    assert after.route.distance_m == pytest.approx(before.route.distance_m)


@pytest.mark.parametrize('tells', [False, True])
def test_the_position_is_said_where_it_is_asked_for(tells):
    car = draw_car(short_conditions(tells_position=tells, traffic=0.2), 1, 2).car()
    car.mission(0)
    assert (car.progress(0) is not None) is tells
    # The trip planner sends no updates.
    car.advance_under(NO_LEASE, 30.0)
    assert car.route_news(0) is None
