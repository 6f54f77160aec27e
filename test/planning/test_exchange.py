# SPDX-License-Identifier: Apache-2.0
"""Heat moved within limits: prices against runs, plans against the program, the core against Python."""

from contextlib import contextmanager
from ctypes import addressof, byref, c_int32
from dataclasses import replace
from functools import lru_cache
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from own_plant import OwnPlant
import pytest

from bev_preheat.native.library import core, without_core
from bev_preheat.native.runs import place
from bev_preheat.native.structs import address_of, room, SettlingStruct
from bev_preheat.planning import merit_order
from bev_preheat.planning.cheapest_steps import LEAST_SAVING_WH, whole_charge_wh
from bev_preheat.planning.dynamics import limits_along, native_vehicle, terminal_limits_w
from bev_preheat.planning.exchange import exchange_heat
from bev_preheat.planning.limited_prices import find_changes, find_needs
from bev_preheat.planning.limits import drive_as_planned, limits_hold
from bev_preheat.planning.merit_order import plan_merit_order
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.trip import make_trip
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import HeatPath
from bev_preheat_studies.optimality.drawn_trips import draw_limit_trip

BAD_ARGUMENT, BAD_INPUT = -1, -3
CAR = load_vehicle('reference')
# Drawn trips with an active limit: a descent, a climb, a climb and a tight cabin, a binding target.
DESCENT, CLIMB, TIGHT, TARGET = 205, 337, 288, 88
# Trips that charge again on a descent.
RECHARGED = (0, 9, 51, 154, 214, 272)


@lru_cache
def planned(number, seed=1, above=None):
    """
    Return (trip, state, target [deg C], its Schedule by thresholds alone); None without an active limit.

    With `above` it starts with so little charge that this much is left above the battery's range on the way.
    """
    drawn = drawn_with_charge(number, seed, above)
    trip = make_trip(drawn.vehicle, drawn.route)
    if limits_hold(trip, plan_optimal_switch(trip, drawn.state, drawn.goal)):
        return None
    with thresholds_alone():
        schedule = plan_merit_order(trip, drawn.state, drawn.goal)
    return trip, drawn.state, drawn.goal.target_temperature_c, schedule


def drawn_with_charge(number, seed=1, above=None):
    """Return a drawn trip; `above` as in `planned`, for the plan of the trip as drawn."""
    drawn = draw_limit_trip(CAR, seed, number)
    if above is None:
        return drawn
    plan = plan_preheating(drawn.vehicle, drawn.route, drawn.state, drawn.goal)
    lowest_soc = drawn.vehicle.battery.soc_range[0] + above
    return replace(drawn, state=replace(
        drawn.state, soc=float(drawn.state.soc - plan.soc.min() + lowest_soc)))


@contextmanager
def thresholds_alone():
    """Plan for a while without exchanges of heat, and without the alternative of one interval."""
    with without_core(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(merit_order, 'exchange_heat', lambda trip, state, schedule, target_c: schedule)
        patch.setattr(merit_order, 'switch_within_limits', lambda trip, state, target_c, planned, off_s: planned)
        yield


def saved_wh(trip, schedule, other):
    return float(other.soc[-1] - schedule.soc[-1]) * whole_charge_wh(trip, schedule)


@pytest.mark.costly
@pytest.mark.parametrize('number, above', [
    (DESCENT, None), (CLIMB, None), (TARGET, None), (51, 1e-3), (272, 1e-3)])
def test_effects_are_what_a_run_says_that_is_heated_a_little_more_or_less(number, above):
    trip, state, target_c, schedule = planned(number, above=above)
    needs = find_needs(trip, schedule, target_c)
    changes = find_changes(trip, schedule, needs)
    assert len(changes.needs_per_j) == 1 + len(changes.worst) + (above is not None)
    free_w = limits_along(trip, schedule)[0] - trip.idle_power_w
    is_surplus = (trip.route.propulsion_power_w < 0.0) & (schedule.heater_power_w <= free_w + 1.0)
    command_w = np.where(is_surplus, 0.0, schedule.heater_power_w)
    before = drive_as_planned(trip, state, command_w, take_surplus=True)
    compared = 0
    for n in range(0, len(changes.step), 5):
        k, sign = int(changes.step[n]), float(changes.sign[n])
        duration_s = trip.route.duration_s[k]
        moved_j = min(100.0 * duration_s, changes.most_j[n])
        changed_w = command_w.copy()
        changed_w[k] = schedule.heater_power_w[k] + sign * moved_j / duration_s
        after = drive_as_planned(trip, state, changed_w, take_surplus=True)
        # To 0.5 % of the joule's own effect.
        scale_soc = moved_j / (3600.0 * whole_charge_wh(trip, schedule))
        scale_k = moved_j / trip.vehicle.battery.heat_capacity_j_per_k
        assert changes.charge_per_j[n] * moved_j == pytest.approx(
            float(after.soc[-1] - before.soc[-1]), abs=0.005 * scale_soc), (k, sign)
        assert changes.needs_per_j[0, n] * moved_j == pytest.approx(
            float(after.temperature_c[-1] - before.temperature_c[-1]), abs=0.005 * scale_k), (k, sign)
        for row, worst in enumerate(changes.worst, start=1):
            spare_w = [needs.spare_w(trip, run)[worst] for run in (before, after)]
            greatest = np.abs(changes.needs_per_j[row]).max() * moved_j
            assert changes.needs_per_j[row, n] * moved_j == pytest.approx(
                float(spare_w[1] - spare_w[0]), abs=0.01 * greatest), (k, sign)
        if above is not None:
            assert changes.lowest == schedule.soc[:-1].argmin()
            assert changes.needs_per_j[-1, n] * moved_j == pytest.approx(
                float(after.soc[changes.lowest] - before.soc[changes.lowest]), abs=0.005 * scale_soc), (k, sign)
        compared += 1
    assert compared >= 10


@given(number=st.integers(0, 250), seed=st.integers(1, 4))
def test_less_is_taken_from_the_battery_and_nothing_falls_short(number, seed):
    situation = planned(number, seed)
    if situation is None or situation[-1].empty_at_s is not None:
        return
    trip, state, target_c, schedule = situation
    best = exchange_heat(trip, state, schedule, target_c)
    saving_wh = saved_wh(trip, schedule, best)
    assert best is schedule or saving_wh >= LEAST_SAVING_WH
    assert best.temperature_c[-1] >= min(target_c, schedule.temperature_c[-1]) - 5e-6
    assert power_deficit(trip, best).worst_w <= power_deficit(trip, schedule).worst_w + 1e-6 * abs(
        trip.idle_power_w).max()
    highest_c = trip.vehicle.battery.temperature_range_c[1]
    heated = best.heater_power_w > 0.0
    assert (best.temperature_c[1:][heated] <= highest_c + 1e-5).all()
    assert ((best.heater_power_w >= 0.0) & (best.heater_power_w <= trip.heater_limit_w + 1e-9)).all()
    # No limit is violated at either end of a step, as far as heater and brake can prevent it.
    terminal_w = trip.idle_power_w + best.heater_power_w + best.brake_power_w
    for ends in (slice(-1), slice(1, None)):
        least_w, most_w = terminal_limits_w(
            trip.vehicle, best.soc[ends], best.temperature_c[ends], trip.power_variance_w2)
        can_brake = best.brake_power_w < -trip.route.propulsion_power_w
        assert (terminal_w >= least_w - 2e-3)[can_brake & (trip.route.propulsion_power_w < 0.0)].all()
        assert (terminal_w <= most_w + 2e-3)[heated].all()


@settings(max_examples=settings.default.max_examples // 2)
@given(number=st.sampled_from(RECHARGED), above=st.floats(-2e-3, 1e-2))
def test_the_charge_on_the_way_does_not_leave_its_range(number, above):
    situation = planned(number, above=above)
    if situation is None or situation[-1].empty_at_s is not None:
        return
    trip, state, target_c, schedule = situation
    best = exchange_heat(trip, state, schedule, target_c)
    assert best.soc.min() >= min(CAR.battery.soc_range[0], schedule.soc.min())


@pytest.mark.costly
@pytest.mark.parametrize('number, above', [(51, 6e-4), (60, 3.2e-3), (120, 2.5e-3)])
def test_where_the_charge_on_the_way_binds_less_is_saved(number, above):
    trip, state, target_c, schedule = planned(number, above=above)
    lowest_soc = CAR.battery.soc_range[0]
    assert lowest_soc + 5e-5 < schedule.soc.min() < lowest_soc + 2e-4
    best = exchange_heat(trip, state, schedule, target_c)
    to_nothing = replace(trip.vehicle, battery=replace(trip.vehicle.battery, soc_range=(0.0, 1.0)))
    free = exchange_heat(make_trip(to_nothing, trip.route), state, schedule, target_c)
    assert free.soc.min() < lowest_soc <= best.soc.min() < lowest_soc + 5e-5
    assert LEAST_SAVING_WH < saved_wh(trip, schedule, best) < saved_wh(trip, schedule, free)


@pytest.mark.costly
@pytest.mark.parametrize('number', [
    pytest.param(number, marks=[pytest.mark.deep] * (number not in (51, 272))) for number in RECHARGED])
@pytest.mark.parametrize('above', [2e-4, pytest.param(3e-3, marks=pytest.mark.deep)])
def test_no_plan_with_little_charge_is_worse_than_without_exchanges(number, above):
    drawn = drawn_with_charge(number, above=above)
    situation = drawn.vehicle, drawn.route, drawn.state, drawn.goal
    plan = plan_preheating(*situation)
    with thresholds_alone():
        other = plan_preheating(*situation)
    less_k = other.arrival_temperature_c - plan.arrival_temperature_c
    more_wh = plan.energy_wh.battery_total - other.energy_wh.battery_total
    # A kelvin takes about 120 Wh: heat capacity and the heater's efficiency.
    assert more_wh <= (0.05 - 200.0 * less_k if less_k < 0.0 else 0.05 - 80.0 * less_k)
    driven = OwnPlant('reference').drive(drawn.route, drawn.state, plan.hvch_battery_power_w)
    assert driven.temperature_c == pytest.approx(plan.arrival_temperature_c, abs=0.1)
    assert driven.lowest_soc >= min(CAR.battery.soc_range[0], other.soc.min()) - 5e-4


@given(number=st.integers(0, 250))
def test_the_states_of_the_plan_are_those_of_a_drive_under_its_commands(number):
    situation = planned(number)
    if situation is None or situation[-1].empty_at_s is not None:
        return
    trip, state, target_c, schedule = situation
    best = exchange_heat(trip, state, schedule, target_c)
    driven = drive_as_planned(trip, state, best.heater_power_w, take_surplus=True)
    np.testing.assert_allclose(driven.temperature_c, best.temperature_c, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(driven.soc, best.soc, rtol=0.0, atol=1e-9)


@pytest.mark.costly
@pytest.mark.needs('casadi')
@pytest.mark.parametrize('number, before_wh, after_wh', [
    (TIGHT, 20.0, 0.3), (DESCENT, 6.0, 1.5), *(pytest.param(*case, marks=pytest.mark.deep) for case in (
        (CLIMB, 6.0, 0.3), (401, 1.0, 0.3), (TARGET, 2.0, 1.5)))])
def test_the_plan_is_close_to_the_program_where_thresholds_alone_were_not(number, before_wh, after_wh):
    from bev_preheat.nonlinear_program.solve import solve_optimum
    drawn = draw_limit_trip(CAR, 1, number)
    optimum = solve_optimum(drawn.vehicle, drawn.route, drawn.state, drawn.goal).plan
    trip, _, _, schedule = planned(number)
    plan = plan_preheating(drawn.vehicle, drawn.route, drawn.state, drawn.goal)
    gap_wh = plan.energy_wh.battery_total - optimum.energy_wh.battery_total
    assert -0.05 < gap_wh < after_wh
    assert gap_wh + saved_wh(trip, schedule, plan) > before_wh


def test_what_saves_nothing_and_what_strands_stays_as_it_is():
    trip, state, target_c, schedule = planned(CLIMB)
    best = exchange_heat(trip, state, schedule, target_c)
    assert best is not schedule
    assert exchange_heat(trip, state, best, target_c) is best
    empty = drive_as_planned(trip, BatteryState(state.temperature_c, 0.05), trip.heater_limit_w)
    assert empty.empty_at_s is not None
    assert exchange_heat(trip, state, empty, target_c) is empty


@pytest.mark.costly
# Leaf by leaf; test/native/test_same_plans.py compares whole plans daily.
@pytest.mark.deep
@pytest.mark.parametrize('trips, above', [(400, None), (400, 1e-3)])
def test_core_and_python_agree_to_the_last_bit(trips, above):
    changed = 0
    for number in range(trips):
        situation = planned(number, above=above)
        if situation is None:
            continue
        trip, state, target_c, schedule = situation
        found = exchange_heat(trip, state, schedule, target_c)
        with without_core():
            expected = exchange_heat(trip, state, schedule, target_c)
        assert (found is schedule) == (expected is schedule), number
        for name in ('heater_power_w', 'brake_power_w', 'soc', 'temperature_c'):
            assert getattr(found, name).tolist() == getattr(expected, name).tolist(), (number, name)
        assert found.heating_start_s == expected.heating_start_s
        changed += found is not schedule
    assert changed >= trips // 8


def test_merit_order_exchanges_heat():
    drawn = draw_limit_trip(CAR, 1, CLIMB)
    trip, state, target_c, schedule = planned(CLIMB)
    best = exchange_heat(trip, state, schedule, target_c)
    plan = plan_merit_order(trip, drawn.state, drawn.goal)
    assert plan.heater_power_w.tolist() == best.heater_power_w.tolist()
    assert plan.heating_start_s == best.heating_start_s


def call_exchange_heat(trip, schedule, target_c, null=None, changed=None, lowest_soc=0.05):
    """Return the status of bev_exchange_heat; `null` is the argument to pass as a null pointer."""
    steps, goal = trip.native.steps, SettlingStruct(True, target_c, lowest_soc)
    arrays = {'states': np.array((schedule.soc, schedule.temperature_c)),
              'powers_w': np.array((schedule.heater_power_w, schedule.brake_power_w)),
              'memory': np.full(room('BEV_EXCHANGE_MEMORY', steps) + 8, 7.25)}
    for name, value in (changed or {}).items():
        arrays[name][0, 0] = value
    watched, exchanges = np.full(2 * steps + 8, 3, dtype=np.uint8), c_int32()
    at = {name: place(array) for name, array in arrays.items()}
    at['watched'] = address_of(watched)
    status = core().bev_exchange_heat(
        None if null == 'vehicle' else native_vehicle(trip.vehicle).address,
        None if null == 'trip' else trip.native.address, None if null == 'goal' else addressof(goal),
        *(None if name == null else at[name] for name in ('states', 'powers_w', 'watched', 'memory')),
        None if null == 'exchanges' else byref(exchanges))
    assert (arrays['memory'][-8:] == 7.25).all() and (watched[-8:] == 3).all()
    return status


@pytest.mark.parametrize('null', [
    'vehicle', 'trip', 'goal', 'states', 'powers_w', 'watched', 'memory', 'exchanges'])
def test_a_null_pointer_is_refused(null):
    trip, _, target_c, schedule = planned(CLIMB)
    assert call_exchange_heat(trip, schedule, target_c) == 0
    assert call_exchange_heat(trip, schedule, target_c, null) == BAD_ARGUMENT


@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf])
def test_a_number_that_is_none_is_refused(number):
    trip, _, target_c, schedule = planned(CLIMB)
    assert call_exchange_heat(trip, schedule, number) == BAD_INPUT
    assert call_exchange_heat(trip, schedule, target_c, lowest_soc=number) == BAD_INPUT
    for name in ('states', 'powers_w'):
        assert call_exchange_heat(trip, schedule, target_c, changed={name: number}) == BAD_INPUT, name


def test_heat_that_arrives_late_is_refused():
    trip, _, target_c, schedule = planned(CLIMB)
    late = make_trip(replace(trip.vehicle, heat_path=HeatPath(30.0)), trip.route)
    assert call_exchange_heat(late, schedule, target_c) == BAD_ARGUMENT
