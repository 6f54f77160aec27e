# SPDX-License-Identifier: Apache-2.0
"""Outcomes of plans beyond limits, from the native core, compared with Python."""

from dataclasses import astuple, replace

import drawn_situations
import pytest

from bev_preheat.native.library import without_core
from bev_preheat.planning.heating_intervals import Reason
from bev_preheat.planning.limits import run_unheated
from bev_preheat.planning.outcome import find_outcome
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.value_function import plan_by_values
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

PATHS = HeatPath(), HeatPath(40.0), HeatPath(0.0, 15e3, 300.0), HeatPath(45.0, 16e3, 280.0)


def situation(number, soc=None):
    """Return (trip, state, goal) in which limits matter, each second one with a heat path."""
    drawn = draw_limit_trip(drawn_situations.car('reference'), 31, number)
    path = PATHS[number // 2 % len(PATHS)] if number % 2 else HeatPath()
    state = drawn.state if soc is None else replace(drawn.state, soc=soc)
    return make_trip(replace(drawn.vehicle, heat_path=path), drawn.route), state, drawn.goal


def schedule_of(number):
    trip, state, goal = situation(number)
    return trip, plan_by_values(trip, state, goal, plan_without_heating(trip, state))


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
def test_energies_and_intervals_are_the_same():
    reasons = set()
    for number in range(24):
        trip, schedule = schedule_of(number)
        target_c = float(schedule.temperature_c[-1]) - (number % 3)
        found = find_outcome(trip, schedule, target_c)
        with without_core():
            expected = find_outcome(trip, schedule, target_c)
        assert astuple(found.energy_wh) == pytest.approx(astuple(expected.energy_wh), rel=1e-9, abs=1e-6)
        assert len(found.intervals) == len(expected.intervals)
        for interval, other in zip(found.intervals, expected.intervals):
            assert (interval.start_s, interval.end_s, interval.reason) == (
                other.start_s, other.end_s, other.reason)
            assert interval.energy_wh == pytest.approx(other.energy_wh, rel=1e-9)
        reasons |= {interval.reason for interval in found.intervals}
    # They are heated for all that there is.
    assert reasons == set(Reason)


def test_where_the_charge_runs_out_the_outcome_is_the_same():
    trip, state, _ = situation(4, soc=0.05)
    run = run_unheated(trip, state)
    assert run.empty_at_s is not None
    with without_core():
        expected = find_outcome(trip, run)
    assert astuple(find_outcome(trip, run).energy_wh) == pytest.approx(
        astuple(expected.energy_wh), rel=1e-9, abs=1e-6)
