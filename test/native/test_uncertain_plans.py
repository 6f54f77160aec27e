# SPDX-License-Identifier: Apache-2.0
"""Plans under an uncertainty, and with prices, of the core and in Python: back to back in random situations."""

from collections import Counter

import drawn_situations
import numpy as np
import pytest

from bev_preheat.planning.methods import plan_by_values
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.core_library import core_in_words, without_core


def check(numbers, most_steps):
    """Plan situations both ways; return how often which kind of plan came."""
    assert core_in_words().startswith('used: ')
    seen = Counter()
    for number in numbers:
        vehicle, route, state, goal = drawn_situations.draw(number, most_steps)[:4]
        uncertainty = drawn_situations.draw_uncertainty(number)[0]
        trip = make_trip(vehicle, route)
        price = np.random.default_rng(number).uniform(0.0, 1.0, len(trip.route)) if number % 3 == 0 else None

        def plan():
            return plan_by_values(trip, state, goal, uncertainty=uncertainty, price=price)

        found = plan()
        with without_core():
            expected = plan()
        np.testing.assert_allclose(found.heater_power_w, expected.heater_power_w, rtol=0.0, atol=1e-6)
        assert found.heating_end_s == pytest.approx(expected.heating_end_s), number
        seen['heated' if expected.heater_power_w.any() else 'not heated'] += 1
        seen['ends within a step'] += expected.heating_end_s is not None
        seen['with prices'] += price is not None
    return seen


def test_uncertain_plans_are_the_same():
    seen = check(range(40), most_steps=10)
    assert min(seen[kind] for kind in ('heated', 'not heated', 'ends within a step', 'with prices')) > 1


@pytest.mark.deep
@pytest.mark.parametrize('part', range(10))
def test_uncertain_plans_of_1_000_situations_are_the_same(part):
    assert sum(check(range(100 * part, 100 * (part + 1)), most_steps=80).values()) > 100


def test_the_share_and_the_lag_of_the_heater_are_planned_with_too():
    for number in range(12):
        vehicle, route, state, goal = drawn_situations.draw_without_limits(number)
        uncertainty, share, lag_s = drawn_situations.draw_uncertainty(number)
        plan = plan_preheating(
            vehicle, route, state, goal, uncertainty=uncertainty, heater_share=share, heat_lag_s=lag_s)
        with without_core():
            expected = plan_preheating(
                vehicle, route, state, goal, uncertainty=uncertainty, heater_share=share, heat_lag_s=lag_s)
        assert plan.status is expected.status
        np.testing.assert_allclose(plan.hvch_battery_power_w, expected.hvch_battery_power_w, rtol=0.0, atol=1e-6)
