# SPDX-License-Identifier: Apache-2.0
"""Plans of the native core and of Python, back to back in random situations, also uncertain and priced ones."""

from collections import Counter
from dataclasses import astuple, replace

import drawn_situations
from drawn_situations import in_both
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning.limits import run_unheated
from bev_preheat.planning.methods import plan_by_values
from bev_preheat.planning.outcome import find_outcome
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.core_library import core_in_words
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

SAME_INSTANT_S = 1e-3
SAME_ENERGY_WH = 1e-3
SAME_COST_WH = 0.1


def plan_or_error(situation):
    vehicle, route, state, goal, method, uncertainty = situation
    try:
        return plan_preheating(vehicle, route, state, goal, method, uncertainty)
    except (InvalidInput, PlanningFailure) as error:
        return str(error)


def figures_of(plan):
    """Return the parts of a plan that must agree exactly, the instants [s] and the energies [Wh]."""
    if isinstance(plan, str):
        return plan, [], []
    intervals = [interval.reason for interval in plan.intervals]
    instants_s = [plan.heating_start_s, plan.heating_end_s, plan.undeliverable_at_s] + [
        instant_s for interval in plan.intervals for instant_s in (interval.start_s, interval.end_s)]
    energies_wh = list(vars(plan.energy_wh).values())
    return ((plan.status, intervals, [instant_s is None for instant_s in instants_s]),
            [instant_s or 0.0 for instant_s in instants_s], energies_wh)


def check(numbers, most_steps):
    """
    Plan each situation both ways; return how often each status came.

    The core takes values between temperatures from a parabola. Where many plans cost the same, this decides which
    is found: rarely, and then the cost is the same.
    """
    assert core_in_words().startswith('used: ')
    seen, others = Counter(), []
    for number in numbers:
        situation = drawn_situations.draw(number, most_steps)
        found, expected = in_both(lambda: plan_or_error(situation))
        (found_facts, *found_figures), (facts, instants_s, energies_wh) = map(
            figures_of, (found, expected))
        assert found_facts == facts, number
        if found_figures != [pytest.approx(instants_s, rel=0.0, abs=SAME_INSTANT_S),
                             pytest.approx(energies_wh, rel=0.0, abs=SAME_ENERGY_WH)]:
            others.append(number)
            assert found.energy_wh.battery_total == pytest.approx(
                expected.energy_wh.battery_total, rel=0.0, abs=SAME_COST_WH), number
            assert found.shortfall_k == pytest.approx(expected.shortfall_k, abs=1e-3), number
        seen[expected if isinstance(expected, str) else expected.status.name] += 1
    assert len(others) <= len(numbers) / 200, others
    return seen


@pytest.mark.costly
def test_plans_of_short_trips_are_the_same():
    seen = check(range(100), most_steps=8)
    # The situations differ enough to mean something.
    assert {'WAITING', 'HEATING', 'NOT_NEEDED', 'TARGET_UNREACHABLE', 'SOC_LIMITED', 'POWER_LIMITED',
            'OUT_OF_CHARGE'} <= set(seen)


@pytest.mark.deep
@pytest.mark.parametrize('part', range(10))
def test_plans_of_10_000_situations_are_the_same(part):
    assert sum(check(range(1000 * part, 1000 * (part + 1)), most_steps=120).values()) == 1000


def test_where_the_charge_runs_out_the_outcome_is_the_same():
    drawn = draw_limit_trip(drawn_situations.car('reference'), 31, 4)
    trip = make_trip(drawn.vehicle, drawn.route)
    run = run_unheated(trip, replace(drawn.state, soc=0.05))
    assert run.empty_at_s is not None
    found, expected = in_both(lambda: find_outcome(trip, run))
    assert astuple(found.energy_wh) == pytest.approx(astuple(expected.energy_wh), rel=1e-9, abs=1e-6)


# Under an uncertainty, and with prices

def check_uncertain(numbers, most_steps):
    """Plan situations both ways; return how often which kind of plan came."""
    assert core_in_words().startswith('used: ')
    seen = Counter()
    for number in numbers:
        vehicle, route, state, goal = drawn_situations.draw(number, most_steps)[:4]
        uncertainty = drawn_situations.draw_uncertainty(number)[0]
        trip = make_trip(vehicle, route)
        price = np.random.default_rng(number).uniform(0.0, 1.0, len(trip.route)) if number % 3 == 0 else None
        found, expected = in_both(lambda: plan_by_values(
            trip, state, goal, uncertainty=uncertainty, price=price))
        np.testing.assert_allclose(found.heater_power_w, expected.heater_power_w, rtol=0.0, atol=1e-6)
        assert found.heating_end_s == pytest.approx(expected.heating_end_s), number
        seen['heated' if expected.heater_power_w.any() else 'not heated'] += 1
        seen['ends within a step'] += expected.heating_end_s is not None
        seen['with prices'] += price is not None
    return seen


def test_uncertain_plans_are_the_same():
    seen = check_uncertain(range(40), most_steps=10)
    assert min(seen[kind] for kind in ('heated', 'not heated', 'ends within a step', 'with prices')) > 1


@pytest.mark.deep
@pytest.mark.parametrize('part', range(10))
def test_uncertain_plans_of_1_000_situations_are_the_same(part):
    assert sum(check_uncertain(range(100 * part, 100 * (part + 1)), most_steps=80).values()) > 100


def test_the_share_and_the_lag_of_the_heater_are_planned_with_too():
    for number in range(12):
        vehicle, route, state, goal = drawn_situations.draw_without_limits(number)
        uncertainty, share, lag_s = drawn_situations.draw_uncertainty(number)
        plan, expected = in_both(lambda: plan_preheating(
            vehicle, route, state, goal, uncertainty=uncertainty, heater_share=share, heat_lag_s=lag_s))
        assert plan.status is expected.status
        np.testing.assert_allclose(plan.hvch_battery_power_w, expected.hvch_battery_power_w, rtol=0.0, atol=1e-6)
