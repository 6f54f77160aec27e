# SPDX-License-Identifier: Apache-2.0
"""Plans that heat early, in one call of the core, and in Python: back to back in random situations."""

from collections import Counter
from dataclasses import replace

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native.library import core_in_words, without_core
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning import unlimited
from bev_preheat.planning.heating_intervals import Reason
from bev_preheat.planning.planner import plan_preheating, plan_unheated
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.uncertainty_margin import UncertaintyMargin
from bev_preheat.planning.unlimited import plan_unlimited
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.terminal_limits import make_terminal_limits

CAR = drawn_situations.car('reference')


def told(plan):
    """Return the parts of a plan that must be bit-identical, and its energies [Wh]."""
    told = plan.as_dictionary()
    del told['planning_time_s']
    energies_wh = list(told.pop('energy_wh').values())
    energies_wh += [interval.pop('energy_wh') for interval in told['stretches']]
    return told, energies_wh


def assert_same(make_plan, number=None):
    """Compare a plan of the core with Python's, which is returned."""
    found, energies_wh = told(make_plan())
    with without_core():
        plan = make_plan()
    expected, expected_wh = told(plan)
    assert found == expected, number
    assert energies_wh == pytest.approx(expected_wh, rel=1e-12, abs=1e-9), number
    return plan


def check(numbers):
    """Plan situations both ways; return how often which kind of plan came, and came from the core alone."""
    assert core_in_words().startswith('used: ')
    seen = Counter()
    for number in numbers:
        vehicle, route, state, goal = drawn_situations.draw_without_limits(number)
        uncertainty_margin, share, lag_s = drawn_situations.draw_margin(number)
        method = ('value_function', 'optimal_switch')[number % 2]
        whole = plan_unlimited(
            make_trip(vehicle, route, share, lag_s), state, goal, uncertainty_margin, method == 'optimal_switch')
        if whole is None or whole[1] is None:
            # A limit is active, or heat is cheaper elsewhere: test_same_plans.py.
            continue
        careful = assert_same(lambda: plan_preheating(
            vehicle, route, state, goal, method, uncertainty_margin, share, heat_lag_s=lag_s), number)
        plain = plan_preheating(vehicle, route, state, goal, method, replace(
            uncertainty_margin, lead_k=0.0, is_heating=False, least_heating_s=0.0), share, heat_lag_s=lag_s)
        seen['in the core'] += 1
        if plain.heating_start_s is None:
            seen['not heated'] += 1
        elif careful.heating_start_s is None:
            seen['left out'] += 1
        elif careful.heating_start_s == plain.heating_start_s:
            seen['not earlier'] += 1
        else:
            seen['at once' if careful.heating_start_s == 0.0 else 'earlier'] += 1
            seen['until it is enough'] += careful.heating_end_s is not None
    return seen


def test_careful_plans_are_the_same():
    seen = check(range(150))
    assert seen['in the core'] > 90
    assert min(seen[kind] for kind in (
        'not heated', 'left out', 'not earlier', 'at once', 'earlier', 'until it is enough')) > 1


@pytest.mark.deep
@pytest.mark.parametrize('part', range(10))
def test_careful_plans_of_10_000_situations_are_the_same(part):
    assert check(range(1000 * part, 1000 * (part + 1)))['in the core'] > 500


def steady_route(last_power_w=14e3):
    """Return a route of an hour of steady driving and five seconds at another power [W]."""
    return make_route({
        'duration_s': [60.0] * 60 + [5.0], 'speed_mps': [22.0], 'propulsion_power_w': [14e3] * 60 + [last_power_w],
        'ambient_temperature_c': [-9.0], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [300.0]}, CAR.defaults)


@pytest.mark.parametrize('limit, reason', [(0, Reason.DESCENT), (1, Reason.CLIMB), (None, Reason.ARRIVAL)])
def test_what_careful_heating_is_for_is_told_without_python(monkeypatch, limit, reason):
    # The battery can deliver the last seconds' power unheated, but not 5 K below the plan.
    state, uncertainty_margin = BatteryState(3.0, 0.8), UncertaintyMargin(0.1, 7.0)
    unheated = plan_unheated(CAR, steady_route(), state, Goal(10.0))
    limits_w = make_terminal_limits(CAR, ARRAYS)(
        unheated.soc[-1:], unheated.battery_temperature_c[-1:] - 1.5, np.zeros(1))
    route = steady_route() if limit is None else steady_route(float(limits_w[limit][0]) - 1800.0)
    goal = Goal(unheated.arrival_temperature_c + 2.0)
    careful = assert_same(lambda: plan_preheating(CAR, route, state, goal, uncertainty_margin=uncertainty_margin))
    assert careful.heating_end_s < 3600.0
    assert [interval.reason for interval in careful.intervals] == [reason]
    monkeypatch.setattr(unlimited, 'heating_intervals', None)
    found = plan_unlimited(make_trip(CAR, route), state, goal, uncertainty_margin)
    assert found[1].intervals[0].end_s == careful.intervals[0].end_s
