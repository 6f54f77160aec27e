# SPDX-License-Identifier: Apache-2.0
"""Early heating within limits and with heat paths, in the core and in Python: back to back in drawn situations."""

from collections import Counter
from ctypes import addressof
from dataclasses import replace
import math

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native.library import core, without_core
from bev_preheat.native.structs import MeritPlanStruct, room
from bev_preheat.planning import uncertainty_margin as uncertainty_margin_module
from bev_preheat.planning.dynamics import keep_accounts, native_vehicle
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.planner import PROPOSALS
from bev_preheat.planning.rows import powers_of, states_of
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.uncertainty_margin import heat_early, UncertaintyMargin
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

SAME_INSTANT_S, SAME_ENERGY_WH = 1e-3, 1e-3
SAME = {'rtol': 1e-9, 'atol': 1e-7}
BAD_ARGUMENT, BAD_INPUT = -1, -3


class Seen(uncertainty_margin_module.LastInterval):
    """Records the results of a Python search for the end of heating."""

    kinds = Counter()

    def without(self):
        Seen.kinds['left out'] += 1
        return super().without()

    def may_leave_limits_aside(self):
        Seen.kinds['earlier'] += 1
        return super().may_leave_limits_aside()

    def until_within_limits(self, end_s):
        # The first run of a search is one, and the last.
        Seen.kinds['within limits'] += self._driven is not None
        return super().until_within_limits(end_s)


@pytest.fixture
def kinds(monkeypatch):
    """Count the kinds of results of plans after a Python search."""
    monkeypatch.setattr(uncertainty_margin_module, 'LastInterval', Seen)
    Seen.kinds.clear()
    return Seen.kinds


def planned(number, most_steps):
    """Return (trip, state, planned Schedule, target [deg C], Caution) of a situation."""
    vehicle, route, state, goal, method, _ = drawn_situations.draw(number, most_steps)
    uncertainty_margin, share, lag_s = drawn_situations.draw_margin(number)
    trip = make_trip(vehicle, route, share, lag_s if vehicle.heat_path.is_direct else 0.0)
    target_c = min(goal.target_temperature_c + uncertainty_margin.margin_k, vehicle.battery.temperature_range_c[1])
    schedule = PROPOSALS[method][0](trip, state, replace(goal, target_temperature_c=target_c))
    return trip, state, schedule, target_c, uncertainty_margin


def assert_same(trip, found, expected, number):
    for name in ('heating_start_s', 'heating_end_s', 'empty_at_s'):
        instant_s, expected_s = getattr(found, name), getattr(expected, name)
        assert (instant_s is None) == (expected_s is None), (number, name)
        assert expected_s is None or abs(instant_s - expected_s) < SAME_INSTANT_S, (number, name)
    np.testing.assert_allclose(states_of(found), states_of(expected), **SAME, err_msg=str(number))
    np.testing.assert_allclose(powers_of(found), powers_of(expected), **SAME, err_msg=str(number))
    assert (found.driven_share is None) == (expected.driven_share is None)
    energies_wh, expected_wh = (list(vars(keep_accounts(trip, run).energy_wh).values())
                                for run in (found, expected))
    assert energies_wh == pytest.approx(expected_wh, rel=0.0, abs=SAME_ENERGY_WH), number


def check(numbers, most_steps, kinds):
    for number in numbers:
        trip, state, schedule, target_c, uncertainty_margin = planned(number, most_steps)
        found = uncertainty_margin_module.found_by_core(trip, schedule, target_c, uncertainty_margin)
        with without_core():
            expected = heat_early(trip, state, schedule, target_c, uncertainty_margin)
        if found is None:
            kinds['in Python'] += 1
        elif expected is schedule:
            kinds['as planned'] += 1
            assert found is schedule, number
        else:
            kinds['with a heat path'] += expected.heat is not None
            kinds['of one that strands'] += expected.empty_at_s is not None
            assert_same(trip, found, expected, number)
    return kinds


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
def test_heating_begins_as_early_within_limits_and_with_heat_paths(kinds):
    check(range(800), 25, kinds)
    assert min(kinds[kind] for kind in ('left out', 'as planned', 'within limits', 'with a heat path')) > 20
    assert kinds['earlier'] > kinds['within limits'] + 20 and kinds['of one that strands'] > 2
    assert kinds['in Python'] < 4


@pytest.mark.deep
@pytest.mark.parametrize('part', range(10))
def test_heating_begins_as_early_in_10_000_situations(part, kinds):
    check(range(1000 * part, 1000 * (part + 1)), 120, kinds)
    assert kinds['in Python'] < 10


def early_call(path):
    """Return the arguments of bev_heat_early for a plan that it changes, and the arrays that they point to."""
    drawn = draw_limit_trip(drawn_situations.car('reference'), 15, 8)
    trip = make_trip(replace(drawn.vehicle, heat_path=path), drawn.route)
    schedule = plan_merit_order(trip, drawn.state, drawn.goal)
    steps, uncertainty_margin = trip.native.steps, UncertaintyMargin(lead_k=3.0).native
    states, powers_w = states_of(schedule), powers_of(schedule)
    watched = np.full(2 * steps + 64, 3, dtype=np.uint8)
    memory = np.full(room('BEV_HEAT_EARLY_MEMORY', steps) + 64, 7.25)
    end_s = math.nan if schedule.heating_end_s is None else schedule.heating_end_s
    plan, is_changed = MeritPlanStruct(math.nan, end_s), np.zeros(1, dtype=np.int32)
    return [native_vehicle(trip.vehicle).address, trip.native.address, drawn.goal.target_temperature_c,
            addressof(uncertainty_margin), *(array.ctypes.data for array in (states, powers_w, watched, memory)),
            addressof(plan), is_changed.ctypes.data], (
                trip, uncertainty_margin, states, powers_w, watched, memory, plan, is_changed)


@pytest.mark.parametrize('path', [HeatPath(), HeatPath(45.0, 16e3, 280.0)], ids=['at once', 'late'])
def test_it_needs_each_argument_and_no_more_memory_than_it_asks_for(path):
    arguments, kept = early_call(path)
    for missing in range(len(arguments)):
        if missing != 2:
            assert core().bev_heat_early(
                *arguments[:missing], None, *arguments[missing + 1:]) == BAD_ARGUMENT, missing
    assert core().bev_heat_early(*arguments) == 0 and kept[-1][0] == 1
    assert (kept[4][-64:] == 3).all() and (kept[5][-64:] == 7.25).all()


@pytest.mark.parametrize('value', [math.nan, math.inf])
def test_what_is_no_number_is_refused(value):
    for place in range(5):
        arguments, kept = early_call(HeatPath())
        _, uncertainty_margin, states, powers_w, *_, plan, _ = kept
        if place == 0:
            arguments[2] = value
        elif place == 1:
            uncertainty_margin.lead_k = value
        elif place == 2:
            states[1, 3] = value
        elif place == 3:
            powers_w[0, 3] = value
        else:
            # Without an end of its own heating lasts until arrival.
            plan.end_s = value
        assert core().bev_heat_early(*arguments) == (0 if place == 4 and math.isnan(value) else BAD_INPUT), place
