# SPDX-License-Identifier: Apache-2.0
"""The distributions of a study's cars."""


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


@pytest.mark.parametrize('tells', [False, True])
def test_the_position_is_said_where_it_is_asked_for(tells):
    car = draw_car(short_conditions(tells_position=tells, traffic=0.2), 1, 2).car()
    car.mission(0)
    assert (car.progress(0) is not None) is tells
    # The trip planner sends no updates.
    car.advance_under(NO_LEASE, 30.0)
    assert car.route_news(0) is None
