# SPDX-License-Identifier: Apache-2.0
"""Runs within limits of a vehicle with a heat path: the limits hold, as far as a heater with lag allows."""

from contextlib import nullcontext
from dataclasses import replace

import drives
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat.vehicle.model import make_terminal_limits
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

REFERENCE = load_vehicle('reference')
LAG = HeatPath(heater_lag_s=60.0)
COOLANT = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
BOTH = HeatPath(45.0, 15e3, 300.0)
PATHS = st.sampled_from([LAG, COOLANT, BOTH])
SEGMENTS = drives.segments(
    max_size=25, duration_s=(5.0, 60.0), propulsion_power_w=(-60e3, 120e3), ambient_temperature_c=(-20.0, 5.0),
    cabin_heating_power_w=(0.0, 7e3), wanted_share=(0.0, 1.0))
STATES = st.builds(BatteryState, st.floats(-20.0, 30.0), st.floats(0.3, 0.99),
                   st.floats(0.0, 7e3), st.floats(-2.0, 15.0))


def driven(segments, state, path, take_surplus=True):
    columns = drives.columns_of(segments)
    share = columns.pop('wanted_share')
    trip = make_trip(replace(REFERENCE, heat_path=path), make_route(columns, REFERENCE.defaults))
    return trip, drive_as_planned(trip, state, share * trip.heater_limit_w, take_surplus)


@given(SEGMENTS, STATES, PATHS)
def test_the_run_is_that_of_the_model_under_its_commands(segments, state, path):
    trip, schedule = driven(segments, state, path)
    if schedule.empty_at_s is not None:
        return
    step = make_heated_step(trip.vehicle, replace(FLOATS, root=lambda value: max(value, 0.0)**0.5))
    states = state.soc, state.temperature_c, state.heater_power_w, state.coolant_excess_k
    columns = (*trip.inputs(None, schedule.brake_power_w), schedule.heater_power_w)
    heat = schedule.heat
    for k, row in enumerate(zip(*(column.tolist() for column in columns))):
        *states, _, _, drawn_w, arriving_w = step(*states, *row)
        assert (min(states[0], 1.0), *states[1:]) == pytest.approx((
            schedule.soc[k + 1], schedule.temperature_c[k + 1], heat.heater_power_w[k + 1],
            heat.coolant_excess_k[k + 1]), rel=1e-9, abs=1e-9)
        assert (drawn_w, arriving_w) == pytest.approx(
            (heat.drawn_power_w[k], heat.arriving_heat_w[k]), rel=1e-9, abs=1e-6)
        states[0] = min(states[0], 1.0)


@given(SEGMENTS, STATES, PATHS)
def test_a_command_never_asks_for_more_than_the_battery_can_give(segments, state, path):
    trip, schedule = driven(segments, state, path)
    if schedule.empty_at_s is not None:
        return
    most_w = np.min([make_terminal_limits(trip.vehicle, ARRAYS)(
        schedule.soc[ends], schedule.temperature_c[ends], trip.power_variance_w2)[1]
        for ends in (slice(-1), slice(1, None))], axis=0)
    # With a command of 0, the heater's power is the remainder of earlier commands.
    beyond_w = (trip.idle_power_w + schedule.drawn_power_w - most_w)[schedule.heater_power_w > 0.0]
    surplus = (trip.route.propulsion_power_w < 0.0)[schedule.heater_power_w > 0.0]
    assert (beyond_w <= 1e-6 * np.abs(most_w).max())[~surplus].all()


@pytest.mark.costly
@pytest.mark.parametrize('path', [LAG, COOLANT, BOTH])
@pytest.mark.parametrize('number', [3, 10, 20, 35])
def test_climbs_that_heat_helps_with_are_delivered(path, number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    at_once, late = (plan_preheating(
        replace(REFERENCE, heat_path=each), trip.route, trip.state, trip.goal)
        for each in (HeatPath(), path))
    assert at_once.undeliverable_power_w == late.undeliverable_power_w == 0.0
    assert at_once.heating_start_s is not None
    assert late.heating_start_s <= at_once.heating_start_s


@pytest.mark.costly
@pytest.mark.parametrize('number', [25, 39])
def test_before_a_descent_heat_comes_in_time_and_the_target_is_met(number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    plan = plan_preheating(replace(REFERENCE, heat_path=BOTH), trip.route, trip.state, trip.goal)
    assert plan.shortfall_k < 1e-4
    descent_s = float(plan.time_s[np.argmax(trip.route.propulsion_power_w < 0.0)])
    assert plan.heating_start_s < descent_s - BOTH.heat_lag_s


@pytest.mark.parametrize('reference', [nullcontext, without_core])
def test_surplus_is_used_until_it_lasts_no_longer_than_the_heater_needs_to_switch_off(reference):
    segment = {'duration_s': 10.0, 'speed_mps': 20.0, 'ambient_temperature_c': -10.0, 'cabin_heating_power_w': 0.0,
               'wanted_share': 0.0}
    segments = [{**segment, 'propulsion_power_w': -60e3}] * 15 + [{**segment, 'propulsion_power_w': 10e3}] * 15
    with reference():
        _, run = driven(segments, BatteryState(-10.0, 0.9), LAG)
    # 0.7 lags of 60 s, from the middle of a step on: the surplus must last for another 37 s, four steps.
    assert (run.heater_power_w > 0.0).tolist() == [True] * 11 + [False] * 19


def test_a_stranded_vehicle_only_loses_the_heat_of_battery_and_coolant():
    # With half of the heater's power the charge runs out in the middle of a step.
    segment = {'duration_s': 30.0, 'speed_mps': 20.0, 'propulsion_power_w': 40e3, 'ambient_temperature_c': -10.0,
               'cabin_heating_power_w': 0.0, 'wanted_share': 0.5}
    with without_core():
        trip, run = driven([segment] * 40, BatteryState(-5.0, 0.1, 3e3, 10.0), BOTH)
    standing, coolant_c = trip.time_s[:-1] >= run.empty_at_s, run.temperature_c + run.heat.coolant_excess_k
    heat_j = (REFERENCE.battery.heat_capacity_j_per_k * run.temperature_c
              + BOTH.coolant_heat_capacity_j_per_k * coolant_c)
    mean_c = 0.5 * (run.temperature_c[1:] + run.temperature_c[:-1])
    lost_j = trip.leakage_w_per_k * (mean_c - trip.route.ambient_temperature_c) * trip.route.duration_s
    np.testing.assert_allclose(-np.diff(heat_j)[standing], lost_j[standing], rtol=1e-3)
    assert standing.sum() > 5 and (run.heat.drawn_power_w[standing] == 0.0).all()
