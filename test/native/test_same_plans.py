# SPDX-License-Identifier: Apache-2.0
"""Plans with and without the native core, back to back in random situations."""

from collections import Counter

import drawn_situations
import pytest

from bev_preheat.errors import InvalidInput, PlanningFailure
from bev_preheat.native.library import core_in_words, without_core
from bev_preheat.planning.planner import plan_preheating

SAME_INSTANT_S = 1e-3
SAME_ENERGY_WH = 1e-3


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
    """Plan each situation both ways; return how often each status came."""
    assert core_in_words().startswith('used: ')
    seen = Counter()
    for number in numbers:
        situation = drawn_situations.draw(number, most_steps)
        found = plan_or_error(situation)
        with without_core():
            expected = plan_or_error(situation)
        (found_facts, *found_figures), (facts, instants_s, energies_wh) = map(
            figures_of, (found, expected))
        assert found_facts == facts, number
        assert found_figures[0] == pytest.approx(instants_s, rel=0.0, abs=SAME_INSTANT_S), number
        assert found_figures[1] == pytest.approx(energies_wh, rel=0.0, abs=SAME_ENERGY_WH), number
        seen[expected if isinstance(expected, str) else expected.status.name] += 1
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
