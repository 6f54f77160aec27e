# SPDX-License-Identifier: Apache-2.0
"""Reasons for heating: each on a trip designed for it, and properties of all intervals."""

from drives import route_of
from formula_car import SHIPPED_CAR, with_limits
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.schedule import Reason
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.vehicle.curves import Table
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

# A limit that rises by 3 kW/K for discharging, 2 kW/K for charging, from 60 kW and 0.
CAR = with_limits(Table((0.0,), (-30.0, 30.0), ((60e3, 240e3),)), Table((0.0,), (-20.0, 30.0), ((0.0, -100e3),)))


def plan_of(*parts, target_c=-30.0, start_c=-12.0, ambient_c=-12.0):
    """Plan of a drive of parts (steps of half a minute, propulsion power [W])."""
    return plan_preheating(CAR, route_of(*parts, ambient_c=ambient_c), BatteryState(start_c, 0.85), Goal(target_c))


def reasons(plan):
    return [interval.reason for interval in plan.intervals]


def test_heating_with_what_the_battery_may_not_take_is_surplus():
    # At -11 degC it accepts 18 kW of 28; paid heat is not worth it for 3 min. A kelvin takes 0.44 MJ and lets it
    # accept 2 kW more for 30 s, or a seventh, in the last step but one; in the last one still a little.
    plan = plan_of((10, 15e3), (6, -30e3), (10, 15e3))
    interval, = plan.intervals
    assert (interval.reason, interval.end_s) == (Reason.SURPLUS, 450.0)


def test_heating_before_a_long_descent_is_for_the_descent_and_ends_where_it_starts():
    # At -15 degC it accepts 10 kW of 60 kW, and 2 kW more per kelvin, for half an hour: 3.6 MJ.
    # A kelvin takes 0.44 MJ.
    plan = plan_of((10, 15e3), (60, -60e3), (4, 15e3), start_c=-15.0, ambient_c=-15.0)
    assert reasons(plan)[:2] == [Reason.DESCENT, Reason.SURPLUS]
    assert plan.intervals[0].end_s == 300.0


def test_heating_before_a_climb_and_before_arrival_has_two_reasons_each_with_its_energy():
    plan = plan_of((60, 15e3), (4, 125e3), (60, 15e3), target_c=20.0)
    assert reasons(plan) == [Reason.CLIMB, Reason.ARRIVAL]
    # The climb starts at step 60.
    end = round(plan.intervals[0].end_s / 30.0)
    assert 60 <= end < 64
    assert plan.intervals[0].energy_wh == pytest.approx(
        plan.hvch_battery_power_w[:end].sum() * 30.0 / 3600.0, rel=1e-9)


@pytest.mark.costly
@given(number=st.integers(0, 24 if settings.default.derandomize else 10**6))
def test_intervals_of_drawn_trips_are_all_the_heat_in_order_and_for_a_reason(number):
    trip = draw_limit_trip(SHIPPED_CAR, 29, number)
    plan = plan_preheating(trip.vehicle, trip.route, trip.state, trip.goal)
    # Less than 1e-4 of the heater's power does not count as heating: half a watt, for two hours at most.
    assert sum(interval.energy_wh for interval in plan.intervals) == pytest.approx(
        plan.energy_wh.hvch_electric, rel=1e-9, abs=1.4)
    instants_s = [instant for interval in plan.intervals for instant in (interval.start_s, interval.end_s)]
    assert instants_s == sorted(instants_s)
    within, surplus = np.zeros((2, len(trip.route)), dtype=bool)
    for interval in plan.intervals:
        assert interval.end_s > interval.start_s and interval.energy_wh > 0.0
        steps = (plan.time_s[1:] > interval.start_s) & (plan.time_s[:-1] < interval.end_s)
        within |= steps
        surplus |= steps & (interval.reason is Reason.SURPLUS)
    assert plan.hvch_battery_power_w[~within].max(initial=0.0) <= 0.7
    # Surplus is found in regenerating steps only; where the friction brake acts, heating is surplus.
    assert (trip.route.propulsion_power_w[surplus] < 0.0).all()
    heated = (plan.friction_brake_power_w > 2.0) & (plan.hvch_battery_power_w > 1.0)
    middles_s = 0.5 * (plan.time_s[1:] + plan.time_s[:-1])
    assert {interval.reason for instant in middles_s[heated] for interval in plan.intervals
            if interval.start_s <= instant < interval.end_s} <= {Reason.SURPLUS}
