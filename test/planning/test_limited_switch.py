# SPDX-License-Identifier: Apache-2.0
"""One heating interval within limits: no plan is worse than the best interval, tried one by one."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.native.library import without_core
from bev_preheat.planning.cheapest_steps import LEAST_SAVING_WH, whole_charge_wh
from bev_preheat.planning.limited_switch import switch_within_limits
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import DIRECT, HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

# Its heating is limited by the power of its cold battery: the warmer, the more.
SMALL_CAR = load_vehicle('small_car')
STRONG_HEATER = replace(SMALL_CAR, hvch=replace(SMALL_CAR.hvch, maximum_power_w=40e3))
STRONG_AND_SLOW = replace(STRONG_HEATER, heat_path=HeatPath(90.0))
REFERENCE = load_vehicle('reference')
# A step of the drive warms or cools this car by tens of kelvin.
SUV = load_vehicle('large_suv')
LIGHT_SUV = replace(SUV, battery=replace(SUV.battery, heat_capacity_j_per_k=35e3))
DIRECTLY_OR_LATE = pytest.mark.parametrize('car', [STRONG_HEATER, STRONG_AND_SLOW])
BOTH_WAYS = pytest.mark.parametrize('is_on', [True, False])
STATE, GOAL = BatteryState(-30.0, 0.5), Goal(15.0)


def standing(minutes=16.0, steps=32, auxiliary_w=500.0):
    return make_route({
        'duration_s': np.full(steps, 60.0 * minutes / steps), 'speed_mps': [0.0], 'propulsion_power_w': [0.0],
        'ambient_temperature_c': [-30.0], 'cabin_heating_power_w': [0.0],
        'auxiliary_power_w': [auxiliary_w]}, STRONG_HEATER.defaults)


def best_switch(trip, state, target_c, off_s):
    """Return the run that heats as late as possible until an instant, by halving; None if that is too cold."""
    def heated_from(on_s):
        heated_s = np.minimum(trip.time_s[1:], off_s) - np.maximum(trip.time_s[:-1], on_s)
        return drive_as_planned(trip, state, np.clip(
            heated_s / trip.route.duration_s, 0.0, 1.0) * trip.heater_limit_w, take_surplus=True)

    early_s, late_s, best = 0.0, off_s, heated_from(0.0)
    if best.temperature_c[-1] < target_c:
        return None
    for _ in range(30):
        middle_s = 0.5 * (early_s + late_s)
        run = heated_from(middle_s)
        if run.temperature_c[-1] >= target_c:
            early_s, best = middle_s, run
        else:
            late_s = middle_s
    return best


def ended(trip, state, goal):
    """Return the end of a single heating interval [s], ignoring limits."""
    end_s = plan_optimal_switch(trip, state, goal).heating_end_s
    return float(trip.time_s[-1]) if end_s is None else end_s


@BOTH_WAYS
@DIRECTLY_OR_LATE
def test_heating_that_the_cold_battery_limits_costs_no_more_than_one_stretch(car, is_on):
    # Thresholds oscillated between passes, and the plan heated in vain before a pause: by 118 and 245 Wh.
    route = standing()
    trip = make_trip(car, route)
    once = best_switch(trip, STATE, GOAL.target_temperature_c, ended(trip, STATE, GOAL))
    assert power_deficit(trip, once).worst_w == 0.0
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(car, route, STATE, GOAL)
    assert plan.arrival_temperature_c == pytest.approx(GOAL.target_temperature_c, abs=1e-5)
    assert (once.soc[-1] - plan.arrival_soc) * whole_charge_wh(trip, once) < LEAST_SAVING_WH


@pytest.mark.parametrize('steps', [16, 96])
@pytest.mark.parametrize('soc', [0.4, 0.7])
@pytest.mark.parametrize('auxiliary_w', [500.0, 5000.0])
@DIRECTLY_OR_LATE
def test_so_it_is_with_other_charge_other_steps_and_other_loads(car, auxiliary_w, soc, steps):
    route, state = standing(steps=steps, auxiliary_w=auxiliary_w), replace(STATE, soc=soc)
    trip = make_trip(car, route)
    once = best_switch(trip, state, GOAL.target_temperature_c, ended(trip, state, GOAL))
    plan = plan_preheating(car, route, state, GOAL)
    assert (once.soc[-1] - plan.arrival_soc) * whole_charge_wh(trip, once) < LEAST_SAVING_WH


@pytest.mark.costly
@pytest.mark.parametrize('path', [
    DIRECT, pytest.param(HeatPath(90.0), marks=pytest.mark.deep), HeatPath(0.0, 15e3, 300.0)])
def test_so_it_is_on_drawn_trips_with_limits(path):
    compared = 0
    for number in range(20):
        drawn = draw_limit_trip(replace(REFERENCE, heat_path=path), 5, number)
        goal = replace(drawn.goal, minimum_arrival_soc=0.0)
        plan = plan_preheating(drawn.vehicle, drawn.route, drawn.state, goal)
        trip = make_trip(drawn.vehicle, drawn.route)
        once = best_switch(trip, drawn.state, goal.target_temperature_c, ended(trip, drawn.state, goal))
        if once is None or power_deficit(trip, once).worst_w > plan.undeliverable_power_w:
            continue
        compared += 1
        assert (once.soc[-1] - plan.arrival_soc) * whole_charge_wh(trip, once) < LEAST_SAVING_WH, number
    assert compared >= 8


@BOTH_WAYS
def test_a_climb_that_cannot_be_delivered_is_no_reason_to_pay_more(is_on):
    # Heating cannot change the deficit at the start: the plan is the same as without the deficit.
    powers_w = np.array([90e3, *[2e3] * 31])
    route = replace(standing(), propulsion_power_w=powers_w, propulsion_power_rms_w=powers_w,
                    propulsion_power_magnitude_w=powers_w)
    trip = make_trip(STRONG_HEATER, route)
    once = best_switch(trip, STATE, 5.0, float(trip.time_s[-1]))
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(STRONG_HEATER, route, STATE, Goal(5.0))
    assert plan.status is Status.POWER_LIMITED
    assert plan.undeliverable_power_w == pytest.approx(power_deficit(trip, once).worst_w, abs=1e-6)
    assert (once.soc[-1] - plan.arrival_soc) * whole_charge_wh(trip, once) < LEAST_SAVING_WH


@DIRECTLY_OR_LATE
def test_one_stretch_is_found_whatever_it_is_guessed_from(car):
    trip, target_c = make_trip(car, standing()), GOAL.target_temperature_c
    off_s = ended(trip, STATE, GOAL)
    once = best_switch(trip, STATE, target_c, off_s)
    for command_w in (trip.heater_limit_w, 0.7 * trip.heater_limit_w, 0.2 * trip.heater_limit_w):
        guessed_from = drive_as_planned(trip, STATE, command_w)
        found = switch_within_limits(trip, STATE, target_c, guessed_from, off_s)
        assert found.temperature_c[-1] == pytest.approx(target_c, abs=5e-6)
        assert found.soc[-1] == pytest.approx(once.soc[-1], abs=1e-6)


def test_where_driving_alone_arrives_at_the_target_nothing_is_heated():
    trip = make_trip(STRONG_HEATER, standing())
    planned = drive_as_planned(trip, STATE, trip.heater_limit_w)
    found = switch_within_limits(trip, STATE, -31.0, planned, float(trip.time_s[-1]))
    assert not found.heater_power_w.any()


@DIRECTLY_OR_LATE
def test_where_heating_all_the_way_is_not_enough_it_is_heated_all_the_way(car):
    trip = make_trip(car, standing(minutes=5.0))
    planned = drive_as_planned(trip, STATE, 0.5 * trip.heater_limit_w)
    found = switch_within_limits(trip, STATE, 15.0, planned, float(trip.time_s[-1]))
    throughout = drive_as_planned(trip, STATE, trip.heater_limit_w)
    assert found.heater_power_w == pytest.approx(throughout.heater_power_w, abs=1e-9)
    assert found.temperature_c[-1] < 15.0


@BOTH_WAYS
@pytest.mark.parametrize('durations_s, powers_w, target_c', [
    ([240.0, 5.0, 240.0, 20.0], [20e3, -60e3, 5e3, 5e3], 5.0),
    ([5.0, 20.0, 180.0, 20.0], [-60e3, 5e3, 20e3, 20e3], 5.0),
    ([240.0, 240.0, 20.0, 180.0, 5.0], [-60e3, -10e3, 20e3, 5e3, 20e3], 5.0),
    ([5.0, 180.0, 5.0, 240.0, 240.0], [-60e3, -10e3, 20e3, -10e3, 20e3], 10.0)])
def test_a_light_battery_arrives_at_a_target_that_heating_all_the_way_reaches(
        durations_s, powers_w, target_c, is_on):
    # The first pass overshot the target by more than the range of thresholds around its run: there were no
    # thresholds to move, and the target was reported as out of reach.
    route = make_route({
        'duration_s': durations_s, 'speed_mps': [7.0], 'propulsion_power_w': powers_w,
        'ambient_temperature_c': [-13.0], 'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [400.0]},
        SUV.defaults)
    state, trip = BatteryState(-13.0, 0.38), make_trip(LIGHT_SUV, route)
    assert drive_as_planned(trip, state, trip.heater_limit_w).temperature_c[-1] > target_c + 1.0
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(LIGHT_SUV, route, state, Goal(target_c))
    assert plan.status in (Status.WAITING, Status.HEATING)
    assert plan.arrival_temperature_c >= target_c - 1e-5
