# SPDX-License-Identifier: Apache-2.0
"""
Plans and runs of vehicles with a heat path.

Plans are compared with a plant that shares no code with the model, runs within limits with the model.
"""

from contextlib import nullcontext
from dataclasses import replace
from functools import cache, reduce

import drives
from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
from own_plant import OwnPlant
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import ARRAYS, FLOATS
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route, Route
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.description import HeatPath, Hvch, Leakage
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat.vehicle.model import make_terminal_limits
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

REFERENCE, PLANT = load_vehicle('reference'), OwnPlant('reference')
ROUTE = load_route('reference', REFERENCE.defaults)
STATE, GOAL = BatteryState(-7.0, 0.9), Goal(25.0)
# Python takes a hundred times longer; test/native compares both daily.
ENGINES = pytest.mark.parametrize('is_on', [True, pytest.param(False, marks=pytest.mark.deep)])
LAG = HeatPath(heater_lag_s=60.0)
COOLANT = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
BOTH = HeatPath(45.0, 15e3, 300.0)
SLOW = (LAG, COOLANT, BOTH)
SLOW_PATHS = st.sampled_from(SLOW)
PATHS = st.sampled_from([*SLOW, HeatPath(5.0, 40e3, 250.0)])
SEGMENTS = drives.segments(
    min_size=10, duration_s=(5.0, 90.0), propulsion_power_w=(-3e3, 30e3), ambient_temperature_c=(-15.0, 6.0),
    cabin_heating_power_w=(0.0, 4e3))


def segments_of(*columns):
    names = ('duration_s', 'speed_mps', 'propulsion_power_w', 'ambient_temperature_c', 'cabin_heating_power_w',
             'auxiliary_power_w')
    return [dict(zip(names, row)) for row in zip(*columns, strict=True)]


# The best plan heats from the first instant on.
FROM_THE_FIRST_INSTANT = segments_of(
    [24.0, 62.375, 65.0, 5.0, 83.5625, 5.0, 21.0, 5.0, 83.125, 45.75],
    [0.0, 0.0, 16.0, 0.0, 7.0, 0.0, 0.0, 0.0, 17.0, 0.0],
    [20912.0, 0.0, 8201.0, 0.0, -2215.0, 0.0, 0.0, 13369.0, 0.0, -2973.0], [0.0] * 10,
    [0.0, 3154.0, 3601.0, 131.0, 196.0, 1011.0, 3841.0, 155.0, 2082.0, 1698.0],
    [0.0, 0.0, 0.0, 0.0, 158.0, 0.0, 1384.0, 0.0, 0.0, 594.0])
# Early heat is not lost here, so the heater is off as early as possible.
OFF_EARLY = segments_of(
    [*[5.0] * 7, 20.0, 10.0, 28.5, 34.5, 5.0, 37.5, 68.5, 34.0, 5.0, 11.0, 78.5, 63.375],
    [*[0.0] * 15, 3.0, 0.0, 0.0, 2.0], [*[0.0] * 9, 9503.0, *[0.0] * 5, 1.0, 0.0, 7332.0, 0.0],
    [*[0.0] * 17, 6.0, 0.0],
    [*[0.0] * 3, 3.0, 1818.0, 3146.0, 201.0, 0.0, 0.0, 337.0, 0.0, 448.0, 0.0, 0.0, 956.0, 0.0, 0.0, 3.0, 139.0],
    [*[0.0] * 5, 2.0, *[0.0] * 9, 4.0, 0.0, 2000.0, 3.0])


def slow(path):
    return replace(REFERENCE, heat_path=path)


@cache
def plan_of(path, method='optimal_switch'):
    return plan_preheating(slow(path), ROUTE, STATE, GOAL, method)


def without_time(plan):
    return {key: value for key, value in plan.as_dictionary().items() if key != 'planning_time_s'}


def driven(path, on_s, off_s, state=STATE, longest_s=0.5):
    """Return the Driven of ROUTE with full power between two instants [s], at which it is cut."""
    parts = [ROUTE.before(on_s), ROUTE.after(on_s).before(min(off_s, ROUTE.total_duration_s) - on_s)]
    parts += [ROUTE.after(off_s)] if off_s < ROUTE.total_duration_s else []
    route = reduce(Route.followed_by, parts)
    is_on = np.repeat((0.0, 1.0, 0.0)[:len(parts)], [len(part) for part in parts])
    limit_w = REFERENCE.hvch.maximum_power_w - route.cabin_heating_power_w
    return PLANT.drive(route, state, is_on * limit_w, path=path, longest_s=longest_s)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('name', ['reference', 'alpine_pass'])
def test_a_path_of_zeros_changes_no_bit(method, name):
    route = load_route(name, REFERENCE.defaults)
    plain, zeros = (plan_preheating(vehicle, route, STATE, GOAL, method) for vehicle in (
        REFERENCE, slow(HeatPath(0.0, 0.0, 250.0, 30.0))))
    assert without_time(plain) == without_time(zeros)
    assert plain.heat is None and 'heat' not in plain.as_dictionary()


# --- One interval, two instants ---


@pytest.mark.parametrize('path', SLOW)
def test_a_fine_drive_of_the_plan_arrives_as_planned(path):
    plan = plan_of(path)
    run = driven(path, plan.heating_start_s, plan.heating_end_s)
    assert plan.arrival_temperature_c == pytest.approx(25.0, abs=1e-5)
    assert run.temperature_c == pytest.approx(25.0, abs=0.02)
    assert run.coolant_excess_k == pytest.approx(plan.heat.coolant_excess_k[-1], abs=0.05)
    assert run.soc == pytest.approx(plan.arrival_soc, abs=1e-5)
    assert run.heater_wh == pytest.approx(plan.energy_wh.hvch_electric, abs=1.0)
    assert run.cells_wh == pytest.approx(plan.energy_wh.battery_total, abs=1.5)


@pytest.mark.parametrize('path', SLOW)
def test_switched_off_sooner_or_later_it_costs_more(path):
    """Each with the switch-on instant that meets the target, both found by fine simulation."""
    from scipy.optimize import brentq
    plan = plan_of(path)

    def cells_wh(off_s):
        def above_k(on_s):
            return driven(path, on_s, off_s, longest_s=5.0).temperature_c - 25.0

        # Steps of 5 s meet the target to a few mK, each worth about 0.1 Wh.
        run = driven(path, brentq(above_k, 600.0, off_s - 1.0, xtol=0.2), off_s, longest_s=5.0)
        return run.cells_wh - (run.temperature_c - 25.0) * 1.15 * REFERENCE.battery.heat_capacity_j_per_k / 3600.0

    best_wh = cells_wh(plan.heating_end_s)
    for sooner_s in (-240.0, 85.0 if path is BOTH else 60.0):
        assert cells_wh(plan.heating_end_s + sooner_s) > best_wh


@given(SEGMENTS, st.floats(-10.0, 10.0), st.floats(0.02, 0.98), PATHS)
@example(FROM_THE_FIRST_INSTANT, 0.0, 1.0 / 3.0, HeatPath(5.0, 40e3, 250.0))
@example(OFF_EARLY, 0.0, 0.75, COOLANT)
def test_on_drawn_trips_it_meets_the_target_and_keeps_its_accounts(segments, start_c, share, path):
    route = make_route(drives.columns_of(segments), REFERENCE.defaults)
    vehicle, state = slow(path), BatteryState(start_c, 0.8)
    cold, hot = (plan_preheating(vehicle, route, state, Goal(target_c), 'optimal_switch',
                                 no_regret=False) for target_c in (-40.0, 60.0))
    target_c = cold.arrival_temperature_c + share * (
        hot.arrival_temperature_c - cold.arrival_temperature_c)
    if hot.arrival_temperature_c - cold.arrival_temperature_c < 0.01:
        return
    plan = plan_preheating(vehicle, route, state, Goal(target_c), 'optimal_switch',
                           no_regret=False)
    assert plan.arrival_temperature_c == pytest.approx(target_c, abs=6e-6)
    if plan.heating_end_s is not None:
        late = plan.time_s[:-1] >= plan.heating_end_s
        assert not plan.hvch_battery_power_w[late].any()
    battery, energy, heat = vehicle.battery, plan.energy_wh, plan.heat
    warmed_k = plan.arrival_temperature_c - start_c
    # Heat absorbed by battery and coolant, and the heater's heat until arrival.
    assert battery.heat_capacity_j_per_k * warmed_k / 3600.0 == pytest.approx(
        energy.joule + energy.drivetrain_heat + energy.hvch_heat + energy.leakage, abs=1e-6)
    coolant_wh = path.coolant_heat_capacity_j_per_k * (
        warmed_k + heat.coolant_excess_k[-1]) / 3600.0
    assert vehicle.hvch.efficiency * (energy.hvch_electric - heat.lost_electric_wh) == pytest.approx(
        energy.hvch_heat + coolant_wh, abs=1e-6)
    # The whole command is drawn, sooner or later.
    hours = np.diff(plan.time_s) / 3600.0
    assert energy.hvch_electric == pytest.approx(float(hours @ plan.hvch_battery_power_w), abs=1e-6)
    assert energy.battery_total == pytest.approx(
        float(hours @ (make_trip(vehicle, route).idle_power_w + heat.drawn_power_w))
        + energy.joule + heat.lost_electric_wh, abs=1e-6)


# --- The ends ---


def test_heat_under_way_at_the_start_is_heat_that_need_not_be_made():
    warm = replace(STATE, heater_power_w=5e3, coolant_excess_k=12.0)
    plan = plan_preheating(slow(BOTH), ROUTE, warm, GOAL)
    cold = plan_of(BOTH, 'value_function')
    assert plan.heat.heater_power_w[0] == 5e3 and plan.heat.coolant_excess_k[0] == 12.0
    assert plan.heating_start_s > cold.heating_start_s + 10.0
    run = driven(BOTH, plan.heating_start_s, plan.heating_end_s, warm)
    assert run.temperature_c == pytest.approx(25.0, abs=0.02)


def test_the_method_of_the_paper_knows_no_path_and_arrives_colder():
    plain = plan_preheating(REFERENCE, ROUTE, STATE, GOAL, 'paper')
    plan = plan_preheating(slow(COOLANT), ROUTE, STATE, GOAL, 'paper')
    assert plan.heating_start_s == plain.heating_start_s
    assert (plan.hvch_battery_power_w == plain.hvch_battery_power_w).all()
    assert driven(COOLANT, plan.heating_start_s, 1e9).temperature_c == pytest.approx(
        plan.arrival_temperature_c, abs=0.02)
    assert plan.arrival_temperature_c < plain.arrival_temperature_c - 1.0


@ENGINES
@pytest.mark.parametrize('start_soc, heater_w', [(0.95, 6e3), (1.0, 15e3)])
def test_late_heat_for_a_descent_costs_no_more_than_it_brings(is_on, start_soc, heater_w):
    # A full battery accepts no more of the descent when warm; the power that a heater with lag draws later is paid
    # for.
    car = load_vehicle('mid_size_lfp')
    car = replace(car, heat_path=HeatPath(90.0), hvch=Hvch(heater_w, 0.87))
    route = load_route('alpine_pass', car.defaults)
    route = replace(route, **{name: 1.5 * getattr(route, name) for name in (
        'propulsion_power_w', 'propulsion_power_rms_w', 'propulsion_power_magnitude_w')})
    trip, state, goal = make_trip(car, route), BatteryState(15.0, start_soc), Goal(20.0)
    unheated = drive_as_planned(trip, state, np.zeros(len(trip.route)))
    assert unheated.temperature_c[-1] > goal.target_temperature_c
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(car, route, state, goal)
    assert plan.arrival_soc >= unheated.soc[-1] - 1e-6
    assert plan.status in (Status.NOT_NEEDED, Status.WAITING)
    assert plan.undeliverable_power_w == 0.0


@ENGINES
def test_coolant_that_takes_more_heat_than_it_gives_leaves_a_plan(is_on):
    # The drive warms battery and coolant by 50 K: the coolant's share used to count as if the run were warmer
    # without it.
    car = load_vehicle('mid_size_lfp')
    car = replace(car, heat_path=HeatPath(0.0, 20e3, 1000.0),
                  battery=replace(car.battery, heat_capacity_j_per_k=22280.0, leakage=Leakage(37.0, 0.581)))
    route = load_route('alpine_pass', car.defaults)
    with nullcontext() if is_on else without_core():
        plan = plan_preheating(car, route, BatteryState(-20.0, 0.9), Goal(50.0))
    assert np.isfinite(plan.battery_temperature_c).all()
    assert plan.arrival_temperature_c == pytest.approx(50.0, abs=0.01)


@pytest.mark.parametrize('field, value', [('heater_power_w', 7001.0), ('heater_power_w', -1.0),
                                          ('coolant_excess_k', 200.0)])
def test_impossible_states_of_heater_and_coolant_are_refused(field, value):
    with pytest.raises(InvalidInput, match=f'{value:g} is not allowed'):
        plan_preheating(slow(BOTH), ROUTE, replace(STATE, **{field: value}), GOAL)


# --- Runs within limits: they hold, as far as a heater with lag allows ---


LIMITED_SEGMENTS = drives.segments(
    max_size=25, duration_s=(5.0, 60.0), propulsion_power_w=(-60e3, 120e3), ambient_temperature_c=(-20.0, 5.0),
    cabin_heating_power_w=(0.0, 7e3), wanted_share=(0.0, 1.0))
STATES = st.builds(BatteryState, st.floats(-20.0, 30.0), st.floats(0.3, 0.99),
                   st.floats(0.0, 7e3), st.floats(-2.0, 15.0))


def driven_within_limits(segments, state, path):
    columns = drives.columns_of(segments)
    share = columns.pop('wanted_share')
    trip = make_trip(slow(path), make_route(columns, REFERENCE.defaults))
    return trip, drive_as_planned(trip, state, share * trip.heater_limit_w, take_surplus=True)


@given(LIMITED_SEGMENTS, STATES, SLOW_PATHS)
def test_the_run_is_that_of_the_model_under_its_commands(segments, state, path):
    trip, schedule = driven_within_limits(segments, state, path)
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


@given(LIMITED_SEGMENTS, STATES, SLOW_PATHS)
def test_a_command_never_asks_for_more_than_the_battery_can_give(segments, state, path):
    trip, schedule = driven_within_limits(segments, state, path)
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
@pytest.mark.parametrize('path', SLOW)
@pytest.mark.parametrize('number', [3, 10, 20, 35])
def test_climbs_that_heat_helps_with_are_delivered(path, number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    at_once, late = (plan_preheating(slow(each), trip.route, trip.state, trip.goal) for each in (HeatPath(), path))
    assert at_once.undeliverable_power_w == late.undeliverable_power_w == 0.0
    assert at_once.heating_start_s is not None
    assert late.heating_start_s <= at_once.heating_start_s


@pytest.mark.costly
@pytest.mark.parametrize('number', [25, 39])
def test_before_a_descent_heat_comes_in_time_and_the_target_is_met(number):
    trip = draw_limit_trip(REFERENCE, 1, number)
    plan = plan_preheating(slow(BOTH), trip.route, trip.state, trip.goal)
    assert plan.shortfall_k < 1e-4
    descent_s = float(plan.time_s[np.argmax(trip.route.propulsion_power_w < 0.0)])
    assert plan.heating_start_s < descent_s - BOTH.heat_lag_s


@pytest.mark.parametrize('reference', [nullcontext, without_core])
def test_surplus_is_used_until_it_lasts_no_longer_than_the_heater_needs_to_switch_off(reference):
    segment = {'duration_s': 10.0, 'speed_mps': 20.0, 'ambient_temperature_c': -10.0, 'cabin_heating_power_w': 0.0,
               'wanted_share': 0.0}
    segments = [{**segment, 'propulsion_power_w': -60e3}] * 15 + [{**segment, 'propulsion_power_w': 10e3}] * 15
    with reference():
        _, run = driven_within_limits(segments, BatteryState(-10.0, 0.9), LAG)
    # 0.7 lags of 60 s, from the middle of a step on: the surplus must last for another 37 s, four steps.
    assert (run.heater_power_w > 0.0).tolist() == [True] * 11 + [False] * 19


def test_a_stranded_vehicle_only_loses_the_heat_of_battery_and_coolant():
    # With half of the heater's power the charge runs out in the middle of a step.
    segment = {'duration_s': 30.0, 'speed_mps': 20.0, 'propulsion_power_w': 40e3, 'ambient_temperature_c': -10.0,
               'cabin_heating_power_w': 0.0, 'wanted_share': 0.5}
    with without_core():
        trip, run = driven_within_limits([segment] * 40, BatteryState(-5.0, 0.1, 3e3, 10.0), BOTH)
    standing, coolant_c = trip.time_s[:-1] >= run.empty_at_s, run.temperature_c + run.heat.coolant_excess_k
    heat_j = (REFERENCE.battery.heat_capacity_j_per_k * run.temperature_c
              + BOTH.coolant_heat_capacity_j_per_k * coolant_c)
    mean_c = 0.5 * (run.temperature_c[1:] + run.temperature_c[:-1])
    lost_j = trip.leakage_w_per_k * (mean_c - trip.route.ambient_temperature_c) * trip.route.duration_s
    np.testing.assert_allclose(-np.diff(heat_j)[standing], lost_j[standing], rtol=1e-3)
    assert standing.sum() > 5 and (run.heat.drawn_power_w[standing] == 0.0).all()
