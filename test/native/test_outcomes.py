# SPDX-License-Identifier: Apache-2.0
"""Outcomes of plans beyond limits, from the native core, compared with Python."""

from ctypes import addressof, byref, c_double
from dataclasses import astuple, replace

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native import searches
from bev_preheat.native.library import core, without_core
from bev_preheat.native.runs import place
from bev_preheat.native.structs import address_of, StrandingStruct
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.heating_intervals import Reason
from bev_preheat.planning.limits import run_unheated
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.outcome import find_outcome, power_deficit
from bev_preheat.planning.planner import plan_without_heating
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

BAD_ARGUMENT = -1
PATHS = HeatPath(), HeatPath(40.0), HeatPath(0.0, 15e3, 300.0), HeatPath(45.0, 16e3, 280.0)


def situation(number, soc=None):
    """Return (trip, state, goal) in which limits matter, each second one with a heat path."""
    drawn = draw_limit_trip(drawn_situations.car('reference'), 31, number)
    path = PATHS[number // 2 % len(PATHS)] if number % 2 else HeatPath()
    state = drawn.state if soc is None else replace(drawn.state, soc=soc)
    return make_trip(replace(drawn.vehicle, heat_path=path), drawn.route), state, drawn.goal


def schedule_of(number):
    trip, state, goal = situation(number)
    return trip, plan_merit_order(trip, state, goal, plan_without_heating(trip, state))


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


# Leaf by leaf; test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('soc', [None, 0.12])
def test_what_the_unheated_trip_lacks_is_the_same(soc):
    deficit, stranded = 0, 0
    for number in range(16):
        trip, state, _ = situation(number, soc)
        start = initial_states(state)[:2 if trip.vehicle.heat_path.is_direct else 4]
        deficit_w, where = searches.unheated_deficit(native_vehicle(trip.vehicle), trip.native, start)
        with without_core():
            run = run_unheated(trip, state)
            expected_w = power_deficit(trip, run).worst_w
        assert deficit_w == pytest.approx(expected_w, rel=1e-9, abs=1e-6)
        assert (where is None) == (run.empty_at_s is None)
        deficit, stranded = deficit + (deficit_w > 0.0), stranded + (where is not None)
    assert deficit > 0 if soc is None else stranded > 0


def test_the_unheated_trip_without_an_argument_is_refused():
    trip, state, _ = situation(0)
    memory, flags = np.empty(9 * len(trip.route) + 4), np.empty(2 * len(trip.route), np.uint8)
    start, deficit_w, stranding = (c_double * 2)(state.soc, state.temperature_c), c_double(), StrandingStruct()
    arguments = [native_vehicle(trip.vehicle).address, trip.native.address, addressof(start),
                 place(memory), address_of(flags), byref(deficit_w), byref(stranding)]
    assert core().bev_unheated_deficit(*arguments) == 0
    for missing in range(len(arguments)):
        assert core().bev_unheated_deficit(*(
            None if at == missing else each for at, each in enumerate(arguments))) == BAD_ARGUMENT
