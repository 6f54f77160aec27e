# SPDX-License-Identifier: Apache-2.0
"""Plans with and without the native core, back to back in random situations; calls it declines are counted."""

from collections import Counter
from dataclasses import astuple, replace

import drawn_situations
import pytest

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.planning.limits import run_unheated
from bev_preheat.planning.outcome import find_outcome
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.core_library import core_in_words, without_core
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
        found = plan_or_error(situation)
        with without_core():
            expected = plan_or_error(situation)
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
    with without_core():
        expected = find_outcome(trip, run)
    assert astuple(find_outcome(trip, run).energy_wh) == pytest.approx(
        astuple(expected.energy_wh), rel=1e-9, abs=1e-6)
