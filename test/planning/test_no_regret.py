# SPDX-License-Identifier: Apache-2.0
"""No plan is worse than not heating: plans compared with a plant that shares no code with the model."""

from bisect import bisect_left
from dataclasses import fields, replace
from functools import partial
import math

import drives
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
import numpy as np
from own_plant import OwnPlant, STEP_S
import pytest

from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.engine import run_without_heating
from bev_preheat.planning.limits import limits_hold
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.schedule import HeldBack, Reason
from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.planning.status import Status
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath, Leakage

# mid_size_lfp may use its whole charge, with full power down to the last per cent.
CARS = {name: load_vehicle(name) for name in ('reference', 'small_car', 'mid_size_lfp')}
PLANTS = {name: OwnPlant(name) for name in CARS}
REFERENCE = CARS['reference']
route_of = partial(drives.route_of, ambient_c=-8.0, cabin_w=2500.0)
REFERENCE_ROUTE = load_route('reference', REFERENCE.defaults)
COLD = -7.0
# The plant's steps are shorter, and of first order: tolerances of the difference over an hour.
SAME_SOC, SAME_TIME_S, SAME_POWER_W, SAME_POWER_SHARE = 3e-4, 10.0, 150.0, 4e-3
# For a property whose every example takes two plans of a whole trip: more examples only in `make test-deep`.
DEAR = settings(max_examples=12 if settings.default.derandomize else settings.default.max_examples)


def unheated(name, route, state):
    return PLANTS[name].drive(route, state, np.zeros(len(route)))


# The charge is not enough for the trip

@pytest.fixture(scope='module', params=[0.0, 0.05, 0.15, 0.2, 0.25])
def stranded(request):
    """State and plan of the reference trip with too little charge, and a run of its plan in the plant."""
    state = BatteryState(COLD, request.param)
    plan = plan_preheating(REFERENCE, REFERENCE_ROUTE, state, Goal(25.0))
    return state, plan, unheated('reference', REFERENCE_ROUTE, state)


def test_a_trip_that_the_charge_does_not_carry_is_a_result_of_its_own(stranded):
    _, plan, driven = stranded
    assert driven.empty_at_s is not None
    assert (plan.status, plan.heating_start_s, plan.hvch_battery_power_w.any()) == (
        Status.OUT_OF_CHARGE, None, False)
    # A battery is never emptier than empty.
    assert plan.soc.min() == plan.arrival_soc == 0.0
    assert not plan.soc[plan.time_s >= plan.stranding.at_s].any()


def test_it_is_said_where_the_charge_runs_out(stranded):
    _, plan, driven = stranded
    assert plan.stranding.at_s == pytest.approx(driven.empty_at_s, abs=SAME_TIME_S)
    distance_m = np.interp(
        plan.stranding.at_s, np.concatenate(([0.0], np.cumsum(REFERENCE_ROUTE.duration_s))),
        np.concatenate(([0.0], np.cumsum(REFERENCE_ROUTE.duration_s * REFERENCE_ROUTE.speed_mps))))
    assert plan.stranding.at_m == pytest.approx(distance_m, abs=1e-6)


def test_what_lacks_is_what_the_rest_of_the_trip_takes(stranded):
    _, plan, _ = stranded
    asked_w = (REFERENCE_ROUTE.propulsion_power_w + REFERENCE_ROUTE.cabin_heating_power_w
               + REFERENCE_ROUTE.auxiliary_power_w)
    ends_s = np.cumsum(REFERENCE_ROUTE.duration_s)
    left_s = np.clip(ends_s - plan.stranding.at_s, 0.0, REFERENCE_ROUTE.duration_s)
    # The route ends with regeneration, which does not help a car that does not get there.
    rest_wh = np.cumsum(asked_w * left_s).max() / 3600.0
    assert plan.stranding.deficit_wh == pytest.approx(rest_wh, rel=1e-6)


def test_a_car_that_stands_only_cools(stranded):
    _, plan, _ = stranded
    first = int(np.argmax(plan.time_s >= plan.stranding.at_s))
    ambient_c = REFERENCE_ROUTE.ambient_temperature_c[-1]
    # It leaks as at the route's speed, so in each step towards the ambient temperature.
    leakage = 34.8868 + 0.528587 * REFERENCE_ROUTE.speed_mps[first:]
    closed_c = [plan.battery_temperature_c[first]]
    for duration_s, gamma in zip(REFERENCE_ROUTE.duration_s[first:], leakage):
        closed_c.append(ambient_c + (closed_c[-1] - ambient_c) * math.exp(
            -gamma * duration_s / 377376.0))
    assert plan.battery_temperature_c[first:] == pytest.approx(closed_c, abs=1e-9)


def test_a_heater_that_cannot_be_switched_off_heats_until_the_car_stands():
    plan = plan_preheating(REFERENCE, REFERENCE_ROUTE, BatteryState(COLD, 0.2), Goal(25.0), heats_throughout=True)
    trip, energy = make_trip(REFERENCE, REFERENCE_ROUTE), plan.energy_wh
    driven_s = np.clip(plan.stranding.at_s - trip.time_s[:-1], 0.0, trip.route.duration_s)
    assert energy.hvch_electric == pytest.approx(trip.heater_limit_w @ driven_s / 3600.0, rel=1e-9)
    assert energy.hvch_heat == pytest.approx(REFERENCE.hvch.efficiency * energy.hvch_electric, rel=1e-9)
    assert energy.drivetrain_heat == pytest.approx(trip.drivetrain_heat_w @ driven_s / 3600.0, rel=1e-9)
    stored_wh = 377376.0 * (plan.arrival_temperature_c - COLD) / 3600.0
    assert (energy.joule + energy.drivetrain_heat + energy.hvch_heat + energy.leakage
            == pytest.approx(stored_wh, abs=1e-6))


@pytest.mark.parametrize('method, uncertainty', [
    *((method, None) for method in METHODS), ('value_function', Uncertainty(1.5)),
    ('value_function', Uncertainty(1.5, direction=1))])
def test_no_method_heats_where_the_charge_does_not_carry(method, uncertainty):
    plan = plan_preheating(
        REFERENCE, REFERENCE_ROUTE, BatteryState(COLD, 0.2), Goal(25.0), method, uncertainty)
    assert (plan.status, plan.energy_wh.hvch_electric) == (Status.OUT_OF_CHARGE, 0.0)


def test_surplus_may_be_heated_with_though_the_charge_does_not_carry():
    # A cold battery accepts 2 kW of these 40; the heater can have the rest.
    route = route_of((10, -40e3), (60, 15e3), ambient_c=-22.0)
    plan = plan_preheating(REFERENCE, route, BatteryState(-22.0, 0.05), Goal(25.0))
    assert plan.status is Status.OUT_OF_CHARGE
    assert plan.energy_wh.hvch_electric > 100.0
    assert {interval.reason for interval in plan.intervals} == {Reason.SURPLUS}
    assert plan.explanation.endswith('only surplus regeneration heats the battery.')


# A climb that no plan can deliver

CLIMBS = route_of((35, 6e3), (16, 56e3), (22, 7e3), (3, 53e3), (14, 13e3))
CLIMB_STATE = BatteryState(-6.0, 0.54)


@pytest.mark.costly
@pytest.mark.parametrize('method', METHODS)
def test_heating_for_a_climb_that_cannot_be_delivered_does_not_make_it_worse(method):
    plan = plan_preheating(CARS['small_car'], CLIMBS, CLIMB_STATE, Goal(18.0), method)
    cold = unheated('small_car', CLIMBS, CLIMB_STATE)
    warm = PLANTS['small_car'].drive(CLIMBS, CLIMB_STATE, plan.hvch_battery_power_w)
    # At the end of a step of the climb, at the lowest charge.
    asked_for = plan_preheating(CARS['small_car'], CLIMBS, CLIMB_STATE, Goal(18.0, charging_planned=False), method)
    assert cold.deficit_w == pytest.approx(asked_for.undeliverable_power_w, abs=100.0)
    assert cold.deficit_w > 13e3
    assert warm.deficit_w <= cold.deficit_w + 20.0
    # value_function leaves the battery cold: the power of the climb comes before the target.
    assert cold.soc >= warm.soc >= PLANTS['small_car'].lowest_soc - SAME_SOC
    assert plan.status is Status.POWER_LIMITED


def test_a_climb_that_heat_makes_possible_is_still_heated_for():
    route = route_of((60, 12e3), (4, 80e3), (10, 8e3), ambient_c=-12.0)
    state = BatteryState(-12.0, 0.8)
    plan = plan_preheating(CARS['small_car'], route, state, Goal(-10.0))
    cold, warm = (PLANTS['small_car'].drive(route, state, heater_w) for heater_w in (
        np.zeros(len(route)), plan.hvch_battery_power_w))
    assert cold.deficit_w > 5e3 > 500.0 > warm.deficit_w
    assert Reason.CLIMB in {interval.reason for interval in plan.intervals}
    # Also if heating for the arrival does not pay, whatever the target.
    unpaid = plan_preheating(CARS['small_car'], route, state, Goal(25.0, heating_pays=False))
    assert PLANTS['small_car'].drive(route, state, unpaid.hvch_battery_power_w).deficit_w < 500.0
    assert {interval.reason for interval in unpaid.intervals} == {Reason.CLIMB}
    assert unpaid.status is not Status.NOT_WORTH_IT
    # The reserve comes before the climb: with the charge of the unheated arrival as reserve nothing is heated.
    reserve = float(plan_preheating(CARS['small_car'], route, state, Goal(-40.0, charging_planned=False)).soc[-1])
    held = plan_preheating(CARS['small_car'], route, state, Goal(-10.0, reserve))
    assert held.arrival_soc >= reserve - 1e-5 and held.energy_wh.hvch_electric < 1.0
    assert held.status is Status.POWER_LIMITED


@pytest.mark.parametrize('method', METHODS)
def test_where_heating_does_not_pay_the_target_is_what_comes_of_none(method):
    route, state = route_of((60, 12e3)), BatteryState(-6.0, 0.8)
    plan = plan_preheating(REFERENCE, route, state, Goal(25.0, heating_pays=False), method)
    cold = unheated('reference', route, state)
    assert (plan.status, plan.heating_start_s, plan.shortfall_k) == (Status.NOT_WORTH_IT, None, 0.0)
    assert plan.target_temperature_c == plan.arrival_temperature_c == pytest.approx(
        cold.temperature_c, abs=0.1)
    assert plan.explanation == (
        f'The heater stays off: arrival in 30:00 min at {plan.arrival_temperature_c:.1f} degC.')
    # The reserve takes precedence.
    short = plan_preheating(REFERENCE, route, state, Goal(25.0, 0.79, heating_pays=False), method)
    assert short.status is Status.SOC_LIMITED and short.heating_start_s is None


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('uncertainty', [None, Uncertainty(1.5)])
def test_no_heating_for_a_climb_strands_a_car_that_may_use_all_its_charge(method, uncertainty):
    # Heat would help on the climb, but takes more than the 1.4 % left on arrival.
    route = route_of((25, 2258.0), (35, 5128.0), (13, 12580.0), speed_mps=11.0, ambient_c=-5.4,
                     cabin_w=0.0, auxiliary_w=326.0, rms=1.2)
    state = BatteryState(-4.7, 0.0798)
    cold = unheated('mid_size_lfp', route, state)
    plan = plan_preheating(CARS['mid_size_lfp'], route, state, Goal(33.0), method, uncertainty)
    warm = PLANTS['mid_size_lfp'].drive(route, state, plan.hvch_battery_power_w)
    assert cold.deficit_w > 1e3
    assert (cold.empty_at_s, warm.empty_at_s) == (None, None)
    assert plan.status is not Status.OUT_OF_CHARGE
    assert plan.soc.min() > 0.0


# The reserve limits heating

@pytest.mark.parametrize('name, route, soc, reserve, target_c', [
    ('small_car', 'city_stop_and_go', 0.7, 0.52, 25.0),
    ('small_car', 'city_stop_and_go', 0.7, 0.54, 25.0),
    ('small_car', 'winter_commute', 0.5, 0.41, 30.0),
    ('reference', 'winter_commute', 0.6, 0.56, 30.0),
    ('reference', 'reference', 0.9, 0.635, 25.0)])
@pytest.mark.parametrize('method', METHODS)
def test_what_the_reserve_holds_back_is_said(name, route, soc, reserve, target_c, method):
    car = CARS[name]
    plan = plan_preheating(car, load_route(route, car.defaults), BatteryState(-10.0, soc),
                           Goal(target_c, reserve), method)
    assert plan.arrival_soc >= reserve
    assert plan.shortfall_k > 0.5
    assert plan.status is Status.SOC_LIMITED
    assert plan.explanation.startswith(
        f'To keep the {100 * reserve:.1f} % reserve, the target is missed by {plan.shortfall_k:.1f} K: ')


@pytest.mark.costly
@DEAR
@given(name=st.sampled_from(sorted(CARS)), soc=st.floats(0.3, 0.95), share=st.floats(0.0, 1.0),
       ambient_c=st.floats(-20.0, 0.0), target_c=st.floats(10.0, 40.0),
       route_name=st.sampled_from(['city_stop_and_go', 'winter_commute', 'alpine_pass']))
def test_a_target_that_is_missed_is_never_waited_for(
        name, soc, share, ambient_c, target_c, route_name):
    car = CARS[name]
    route = load_route(route_name, car.defaults)
    state = BatteryState(ambient_c, soc)
    without = plan_preheating(car, route, state, Goal(target_c, charging_planned=False))
    reserve = max(0.0, without.arrival_soc - 0.06 * share)
    plan = plan_preheating(car, route, state, Goal(target_c, reserve))
    if plan.shortfall_k > 0.2:
        assert plan.status not in (Status.WAITING, Status.HEATING, Status.NOT_NEEDED)


# Inputs at the edge of the allowed range


def car_with(**battery):
    return replace(REFERENCE, battery=replace(REFERENCE.battery, **battery))


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('car, power_w', [
    pytest.param(REFERENCE, 2e6, id='2 MW'), pytest.param(REFERENCE, -2e6, id='-2 MW'),
    pytest.param(car_with(capacity_ah=1.0), 15e3, id='1 Ah'),
    pytest.param(car_with(capacity_ah=1.0), -15e3, id='1 Ah, regeneration'),
    pytest.param(car_with(capacity_ah=1.0), 2e6, id='1 Ah, 2 MW'),
    pytest.param(car_with(capacity_ah=1.0), -2e6, id='1 Ah, -2 MW')])
def test_no_output_lies_beyond_what_a_battery_can_be(car, power_w, method):
    route = route_of((20, 8e3), (40, power_w), (20, 8e3))
    plan = plan_preheating(car, route, BatteryState(COLD, 0.5), Goal(25.0), method)
    assert 0.0 <= plan.soc.min() <= plan.soc.max() <= 1.0
    # The range of the file ends at 60 degC; no car lets its battery get much hotter.
    assert -8.0 <= plan.battery_temperature_c.min() <= plan.battery_temperature_c.max() <= 80.0
    assert np.isfinite([getattr(plan.energy_wh, field.name)
                        for field in fields(plan.energy_wh)]).all()


def test_what_a_hot_battery_is_cooled_by_is_leakage():
    route = route_of((200, 120e3), ambient_c=40.0)
    car = car_with(capacity_ah=2000.0)
    plan = plan_preheating(car, route, BatteryState(50.0, 0.9), Goal(25.0))
    energy = plan.energy_wh
    assert plan.battery_temperature_c.max() == 80.0
    assert (energy.joule + energy.drivetrain_heat + energy.hvch_heat + energy.leakage
            == pytest.approx(377376.0 * 30.0 / JOULES_PER_WH, rel=1e-9))


def test_a_battery_that_cools_within_seconds_is_integrated_with_steps_that_are_short_enough():
    # 20 kJ/K and 1000 W/K: 20 s. At rest the closed form is an exponential.
    car = car_with(heat_capacity_j_per_k=20e3, leakage=Leakage(1000.0, 0.0))
    route = route_of((1, 0.0), step_s=300.0, speed_mps=0.0, ambient_c=-20.0, cabin_w=0.0, auxiliary_w=0.0)
    plan = plan_preheating(car, route, BatteryState(30.0, 0.5), Goal(0.0, charging_planned=False))
    closed_c = -20.0 + 50.0 * np.exp(-plan.time_s / 20.0)
    assert plan.battery_temperature_c == pytest.approx(closed_c, abs=0.02)


# Properties

@st.composite
def situations(draw, within_limits=False):
    """A car, a route of some kinds of road, a state down to an empty battery, and a goal."""
    name = draw(st.sampled_from(sorted(CARS)))
    size = {'reference': 1.0, 'small_car': 0.5, 'mid_size_lfp': 0.5}[name]
    kinds = [(4e3, 30e3)] if within_limits else [(4e3, 30e3), (30e3, 160e3), (-70e3, -5e3)]
    parts = []
    for _ in range(draw(st.integers(1, 5))):
        low_w, high_w = draw(st.sampled_from(kinds))
        parts.append((draw(st.integers(2, 30)), size * draw(st.floats(low_w, high_w))))
    ambient_c = draw(st.floats(-24.0, 4.0))
    route = route_of(
        *parts, speed_mps=draw(st.floats(0.0, 35.0)), ambient_c=ambient_c,
        cabin_w=draw(st.floats(0.0, 5000.0)), auxiliary_w=draw(st.floats(0.0, 800.0)),
        rms=draw(st.floats(1.0, 1.4)))
    state = BatteryState(ambient_c + draw(st.floats(0.0, 8.0)),
                         draw(st.floats(0.0, 1.0) | st.floats(0.0, 0.2)))
    goal = Goal(draw(st.floats(0.0, 35.0)), draw(st.just(0.0) | st.floats(0.0, 0.6)))
    return name, route, state, goal


UNCERTAINTIES = st.none() | st.builds(
    Uncertainty, deviation_k=st.floats(0.02, 2.0), direction=st.integers(-1, 1))


@pytest.mark.costly
@given(situation=situations(), uncertainty=UNCERTAINTIES)
def test_no_plan_is_worse_than_not_heating(situation, uncertainty):
    name, route, state, goal = situation
    plan = plan_preheating(CARS[name], route, state, goal, uncertainty=uncertainty)
    cold = unheated(name, route, state)
    warm = PLANTS[name].drive(route, state, plan.hvch_battery_power_w)
    reserve = max(goal.minimum_arrival_soc, PLANTS[name].lowest_soc)
    assert 0.0 <= plan.soc.min() and plan.soc.max() <= 1.0
    if cold.empty_at_s is None:
        assert warm.empty_at_s is None
        assert warm.deficit_w <= (
            cold.deficit_w + SAME_POWER_W + SAME_POWER_SHARE * cold.deficit_w)
    if cold.soc > reserve:
        assert warm.soc >= reserve - SAME_SOC
    elif not any(interval.reason is Reason.SURPLUS for interval in plan.intervals):
        assert plan.energy_wh.hvch_electric == 0.0 or warm.soc >= cold.soc - SAME_SOC
    if plan.status is Status.OUT_OF_CHARGE:
        assert {interval.reason for interval in plan.intervals} <= {Reason.SURPLUS}


# Charge of a situation beyond the least sufficient one.
JUST_ENOUGH = st.sampled_from([0.002, 0.005, 0.01, 0.02, 0.03])
# The warmest target is found to 2^-14 of the range that is searched; and some rounding.
TARGET_K = 0.02


def hardly_carried(name, route, state, more_soc):
    """Return the least charge for a trip without heating within the limits, to 1/1024, plus `more_soc`."""
    trip = make_trip(CARS[name], route)
    least = bisect_left(range(1024), True, key=lambda level: limits_hold(
        trip, run_without_heating(trip, replace(state, soc=level / 1024))))
    return replace(state, soc=min(1.0, least / 1024 + more_soc))


def hold_against_lower_targets(name, route, state, goal, method):
    plan = plan_preheating(CARS[name], route, state, goal, method)
    if plan.held_back is None:
        return
    for target_c in np.linspace(-20.0, goal.target_temperature_c, 12):
        other = plan_preheating(CARS[name], route, state, replace(
            goal, target_temperature_c=float(target_c)), method)
        if other.held_back is None:
            assert other.arrival_temperature_c <= plan.arrival_temperature_c + TARGET_K


def test_a_start_that_a_fifth_of_a_kelvin_is_not_worth_is_no_lack_of_charge():
    # The last minute and a half of the reference route, with 62 % and without any limit near.
    car, rest = replace(REFERENCE, heat_path=HeatPath(40.0)), REFERENCE_ROUTE.after(3512.0)
    plan = plan_preheating(car, rest, BatteryState(24.965, 0.62), Goal(25.0), uncertainty=Uncertainty(0.05, 0))
    assert (plan.status, plan.held_back, plan.heating_start_s) == (Status.NOT_NEEDED, HeldBack.START, None)
    assert plan.explanation.startswith('The heater is not switched on for 0.2 K: arrival in 1:28 min at 24.8 degC')


CLIMB_TO_AN_EMPTY_BATTERY = route_of((6, 2e3), (9, 12578.0), (30, 11927.5), speed_mps=15.0, ambient_c=-12.0,
                                     cabin_w=2462.0, auxiliary_w=800.0)


@pytest.mark.parametrize('method', ['value_function', 'optimal_switch'])
@pytest.mark.parametrize('soc', [0.24, 0.241, 0.243])
def test_power_that_lacks_in_the_end_leaves_the_heat_that_there_is_power_for(method, soc):
    state = BatteryState(-12.0, soc)
    hold_against_lower_targets('small_car', CLIMB_TO_AN_EMPTY_BATTERY, state, Goal(0.0), method)
    plan = plan_preheating(CARS['small_car'], CLIMB_TO_AN_EMPTY_BATTERY, state, Goal(0.0), method)
    assert plan.held_back is HeldBack.POWER and plan.undeliverable_power_w == 0.0
    # Unheated it arrives with -7.9 degC; the plant drives the heated plan without a deficit, too.
    assert plan.arrival_temperature_c > -6.0
    driven = PLANTS['small_car'].drive(CLIMB_TO_AN_EMPTY_BATTERY, state, plan.hvch_battery_power_w)
    assert driven.deficit_w <= SAME_POWER_W and driven.empty_at_s is None


@pytest.mark.costly
@pytest.mark.parametrize('method', ['value_function', 'optimal_switch'])
@DEAR
@given(situations(within_limits=True), JUST_ENOUGH)
# A heater that gives way to the drive arrives colder than a lower target's.
@example(('mid_size_lfp', route_of((9, 2e3), (8, 9050.5), speed_mps=0.0, ambient_c=0.0, cabin_w=0.0,
                                   auxiliary_w=164.0), BatteryState(4.0, 0.0), Goal(11.0)), 0.01)
def test_a_wish_that_is_held_back_is_as_warm_as_any_lower_target(method, situation, more_soc):
    name, route, state, goal = situation
    hold_against_lower_targets(name, route, hardly_carried(name, route, state, more_soc), goal, method)


@pytest.mark.costly
@given(situation=situations())
def test_a_trip_strands_where_the_plant_does(situation):
    name, route, state, goal = situation
    assume((route.propulsion_power_w > 0.0).all())
    driven = unheated(name, route, state)
    # Limits are kept at the start of a step of 30 s, and by the plant every two.
    assume(driven.empty_at_s is not None or driven.lowest_soc > 0.01)
    plan = plan_preheating(CARS[name], route, state, replace(goal, charging_planned=False))
    assert (plan.stranding is None) == (driven.empty_at_s is None)
    if plan.stranding is not None:
        assert plan.stranding.at_s == pytest.approx(
            driven.empty_at_s, abs=SAME_TIME_S + STEP_S + 0.01 * driven.empty_at_s)
