# SPDX-License-Identifier: Apache-2.0
"""Limits (9i) on random trips: terminal power, heating, braking, cuts, and the accounts."""

from dataclasses import replace

import drives
from formula_car import current_a, resistance_ohm, voltage_v, with_limits
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import FLOATS
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.methods import plan_by_values
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.model import make_terminal_limits

# Corners of the limits [W] at states of charge 0 and 1 (rows), -30 and 30 degC.
DISCHARGE_W = ((10e3, 90e3), (70e3, 310e3))
CHARGE_W = ((-12e3, -130e3), (0.0, -20e3))
CAR = with_limits(*(Table((0.0, 1.0), (-30.0, 30.0), corners_w) for corners_w in (DISCHARGE_W, CHARGE_W)))

# Strong regeneration and strong climbs, for a cold battery.
SEGMENTS = drives.segments(
    max_size=30, propulsion_power_w=(-80e3, 150e3), deviation_w=(0.0, 20e3), wanted_share=(0.0, 1.0))
STATES = st.builds(BatteryState, st.floats(-25.0, 25.0), st.floats(0.4, 1.0))


def bilinear(corners_w, soc, temperature_c):
    warm = np.clip((temperature_c + 30.0) / 60.0, 0.0, 1.0)
    (empty_cold, empty_warm), (full_cold, full_warm) = corners_w
    soc = np.clip(soc, 0.0, 1.0)
    return ((1 - soc) * ((1 - warm) * empty_cold + warm * empty_warm)
            + soc * ((1 - warm) * full_cold + warm * full_warm))


def battery_power_w(soc, temperature_c, terminal_w, variance_w2):
    """P_b = U I + R var/U^2, where I is the smaller root of U I - R I^2 = P_t."""
    u = voltage_v(soc)
    return u * current_a(soc, temperature_c, terminal_w) + resistance_ohm(temperature_c) * variance_w2 / u**2


def trip_of(segments):
    """Trip of random segments, and the heater power wanted in each."""
    columns = drives.columns_of(segments)
    share = columns.pop('wanted_share')
    trip = make_trip(CAR, make_route(columns, CAR.defaults))
    return trip, share * trip.heater_limit_w


def run(trip, state, wanted_w, take_surplus=True):
    return drive_as_planned(trip, state, np.asarray(wanted_w, dtype=float), take_surplus)


def drawn_run(segments, state, take_surplus=True):
    trip, wanted_w = trip_of(segments)
    return trip, wanted_w, run(trip, state, wanted_w, take_surplus)


def power_in_steps_w(trip, schedule):
    """P_b at start and end (rows) of each step, and the charge and discharge limits there."""
    soc, temperature_c = (np.array([values[:-1], values[1:]])
                          for values in (schedule.soc, schedule.temperature_c))
    terminal_w = (trip.route.propulsion_power_w + trip.route.cabin_heating_power_w
                  + trip.route.auxiliary_power_w + schedule.heater_power_w
                  + schedule.brake_power_w)
    return (battery_power_w(soc, temperature_c, terminal_w,
                            trip.route.propulsion_power_variance_w2),
            bilinear(CHARGE_W, soc, temperature_c), bilinear(DISCHARGE_W, soc, temperature_c))


@pytest.mark.parametrize('which, corners_w', [(0, CHARGE_W), (1, DISCHARGE_W)],
                         ids=['charge', 'discharge'])
@given(soc=st.floats(0.05, 1.0), temperature_c=st.floats(-30.0, 30.0),
       deviation_w=st.floats(0.0, 30e3))
def test_battery_power_is_at_its_limit_where_terminal_power_is(
        which, corners_w, soc, temperature_c, deviation_w):
    terminal_w = make_terminal_limits(CAR, FLOATS)(soc, temperature_c, deviation_w**2)[which]
    # 1e-6 W: rounding of the roots of about 1e5 V^2.
    assert battery_power_w(soc, temperature_c, terminal_w, deviation_w**2) == pytest.approx(
        bilinear(corners_w, soc, temperature_c), rel=1e-9, abs=1e-6)


# Runs within limits

MORE = settings(max_examples=4 * settings.default.max_examples)


@pytest.mark.costly
@pytest.mark.parametrize('take_surplus', [True, False])
@MORE
@given(segments=SEGMENTS, state=STATES)
def test_battery_heater_and_brake_stay_within_their_limits(take_surplus, segments, state):
    trip, _, schedule = drawn_run(segments, state, take_surplus)
    heater_w, brake_w = schedule.heater_power_w, schedule.brake_power_w
    power_w, charge_w, discharge_w = power_in_steps_w(trip, schedule)
    all_braked = brake_w >= -trip.route.propulsion_power_w * (1.0 - 1e-12)
    # 1e-6 W: rounding, if the limit is 0.
    assert (all_braked | (power_w >= charge_w * (1.0 + 1e-6) - 1e-6)).all()
    assert (power_w <= discharge_w * (1.0 + 1e-6))[:, heater_w > 0.0].all()
    left_w = np.maximum(7000.0 - trip.route.cabin_heating_power_w, 0.0)
    assert ((heater_w >= 0.0) & (heater_w <= left_w)).all()
    assert ((brake_w >= 0.0) & (brake_w <= np.maximum(-trip.route.propulsion_power_w, 0.0))).all()


# A full battery whose limit still allows 10 kW: 1 W of regeneration for 1 s.
@example(segments=[{
    'duration_s': 1.0, 'speed_mps': 0.0, 'propulsion_power_w': -1.0, 'deviation_w': 0.0,
    'ambient_temperature_c': 0.0, 'cabin_heating_power_w': 0.0, 'auxiliary_power_w': 0.0,
    'wanted_share': 0.0}], state=BatteryState(0.0, 1.0))
@given(segments=SEGMENTS, state=STATES)
def test_surplus_goes_to_the_heater_before_the_brake(segments, state):
    trip, _, schedule = drawn_run(segments, state)
    power_w, charge_w, _ = power_in_steps_w(trip, schedule)
    # Surplus is the power that the limit refuses. Power that the limit allows, but that would overfill the
    # battery, goes to the brake.
    filled = (schedule.soc[1:] >= 1.0 - 1e-9) & (power_w > charge_w + 1e-6).all(axis=0)
    braked = ~filled & (schedule.brake_power_w > 0.0)
    left_w = np.maximum(7000.0 - trip.route.cabin_heating_power_w, 0.0)
    assert schedule.heater_power_w[braked].tolist() == left_w[braked].tolist()


def test_brake_keeps_a_battery_from_being_overfilled():
    # This battery's limits allow 18 kW at 25 degC although it is full.
    schedule = run(make_trip(CAR, drives.route_of((4, -19e3))), BatteryState(25.0, 0.9995), [0.0] * 4)
    assert schedule.soc.max() == 1.0
    # Cabin and auxiliaries use 1.9 kW; the rest has to go somewhere.
    assert schedule.brake_power_w[-1] == pytest.approx(19e3 - 1.9e3, rel=1e-6)


# Whether a limit is near


@pytest.mark.needs('casadi')
@given(segments=SEGMENTS, state=STATES, colder_k=st.floats(0.0, 3.0))
def test_where_no_limit_is_near_none_acts(segments, state, colder_k):
    from bev_preheat_studies.optimality.charging_program import limit_is_near
    gentle = [dict(segment, propulsion_power_w=0.2 * segment['propulsion_power_w']) for segment in segments]
    trip, wanted_w, seen = drawn_run(gentle, state)
    assume(not limit_is_near(trip, seen.soc, seen.temperature_c))
    driven = run(trip, replace(state, temperature_c=state.temperature_c - colder_k), wanted_w)
    # It is found for runs up to 5 K colder than the run seen.
    assume((seen.temperature_c - driven.temperature_c).max() < 5.0)
    assert driven.heater_power_w.tolist() == wanted_w.tolist() and not driven.brake_power_w.any()


@pytest.mark.costly
@given(segments=SEGMENTS, state=STATES, target_c=st.floats(-10.0, 40.0))
def test_plan_is_what_is_driven_within_limits(segments, state, target_c):
    trip, _ = trip_of(segments)
    plan = plan_by_values(trip, state, Goal(target_c))
    driven = drive_as_planned(trip, state, plan.heater_power_w)
    # A milliwatt does not count as a limit; over an hour it changes the temperature by 1e-5 K.
    assert driven.temperature_c == pytest.approx(plan.temperature_c, rel=0.0, abs=1e-5)


# Driven as planned


def test_most_terminal_power_is_that_of_the_circuit_where_the_battery_has_no_limit():
    car = replace(CAR, battery=replace(
        CAR.battery, discharge_power_limit=Table((0.0,), (0.0,), ((2e6,),))))
    u, r = 365.0 + 75.0 * 0.7 + 15.0 * 0.7**3, 4.2 / 28.0
    _, most_w = make_terminal_limits(car, FLOATS)(0.7, -17.0, 9e6)
    assert most_w == pytest.approx(u**2 / (4 * r), rel=1e-12)


def test_heater_is_off_at_the_highest_temperature():
    # The brake takes the power that the battery cannot accept.
    trip = make_trip(CAR, drives.route_of((3, -50e3), ambient_c=60.0))
    schedule = run(trip, BatteryState(60.0, 1.0), [5500.0] * 3)
    assert schedule.heater_power_w.tolist() == [0.0] * 3
