# SPDX-License-Identifier: Apache-2.0
"""Method `optimal_switch`: properties on drawn trips, against forward runs written here."""

from dataclasses import replace
import math

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from varying_power import spread_magnitude_w

from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.status import Status
from bev_preheat.planning.switch_methods import plan_optimal_switch
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage
from bev_preheat.vehicle.description import Drivetrain, Hvch, Leakage

# The numbers below are written out; the shipped car's are fitted and may change.
VEHICLE = load_vehicle('reference')
VEHICLE = replace(
    VEHICLE,
    battery=replace(
        VEHICLE.battery, capacity_ah=190.0, heat_capacity_j_per_k=371000.0,
        open_circuit_voltage=PolynomialVoltage((361.0, 72.0, 0.0, 13.0)),
        resistance=InverseTemperatureResistance(4.4, 46.0), leakage=Leakage(31.0, 0.6)),
    drivetrain=Drivetrain(0.91, 0.7, 340e3), hvch=Hvch(6800.0, 0.86))

# The power left by the cabin changes from segment to segment, sometimes to 0. The coldest battery delivers all of
# this power, and stays within the model's range of charge.
SEGMENT = st.fixed_dictionaries({
    'duration_s': st.floats(1.0, 90.0), 'speed_mps': st.floats(0.0, 35.0),
    'propulsion_power_w': st.floats(-5e3, 35e3), 'spread_w': st.floats(0.0, 15e3),
    'ambient_temperature_c': st.floats(-15.0, 6.0), 'cabin_heating_power_w': st.floats(0.0, 7e3),
    'auxiliary_power_w': st.floats(0.0, 2e3)})
SEGMENTS = st.lists(SEGMENT, min_size=1, max_size=40)
START_C = st.floats(-10.0, 12.0)
SOC = st.floats(0.6, 0.97)
# Position of the target between the unheated and the fully heated arrival.
SHARE = st.floats(0.01, 0.99)


def change(segment, soc, t, heater_w):
    """Rates of (soc, temperature), eqs. (1)-(5)."""
    power_w = segment['propulsion_power_w']
    terminal_w = (power_w + segment['cabin_heating_power_w'] + segment['auxiliary_power_w']
                  + heater_w)
    u, r = 361.0 + 72.0 * soc + 13.0 * soc**3, 4.4 / (t + 46.0)
    ripple_w = r * segment['spread_w']**2 / u**2
    current_a = (u - math.sqrt(u**2 - 4.0 * r * terminal_w)) / (2.0 * r)
    heat_w = (0.86 * heater_w + 0.7 * (1.0 - 0.91) * spread_magnitude_w(power_w, segment['spread_w'])
              + r * current_a**2 + ripple_w
              + (31.0 + 0.6 * segment['speed_mps']) * (segment['ambient_temperature_c'] - t))
    return np.array([-(current_a + ripple_w / u) / (3600.0 * 190.0), heat_w / 371000.0])


def heater_limit_w(segment):
    return max(6800.0 - segment['cabin_heating_power_w'], 0.0)


def arrival_c(segments, state, heater_w):
    """Arrival temperature of a Runge-Kutta run under heater powers, one per segment."""
    y = np.array([state.soc, state.temperature_c])
    for segment, heater in zip(segments, heater_w):
        h = segment['duration_s']
        k1 = change(segment, *y, heater)
        k2 = change(segment, *(y + h / 2 * k1), heater)
        k3 = change(segment, *(y + h / 2 * k2), heater)
        k4 = change(segment, *(y + h * k3), heater)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return float(y[1])


def span_c(segments, state):
    """Arrival temperatures without heating and with all the power that the cabin leaves."""
    return (arrival_c(segments, state, [0.0] * len(segments)),
            arrival_c(segments, state, map(heater_limit_w, segments)))


def target_within(segments, state, share):
    """A target that partial heating reaches."""
    idle_c, full_c = span_c(segments, state)
    return idle_c + share * (full_c - idle_c)


def drawn_target(segments, state, share):
    """The same for drawn trips, on which the cabin may leave the heater next to no power."""
    idle_c, full_c = span_c(segments, state)
    assume(full_c - idle_c > 0.01)
    return target_within(segments, state, share)


def route_of(segments):
    columns = {name: [segment[name] for segment in segments]
               for name in segments[0] if name != 'spread_w'}
    columns['propulsion_power_rms_w'] = [
        math.hypot(segment['propulsion_power_w'], segment['spread_w']) for segment in segments]
    return make_route(columns, VEHICLE.defaults)


def plan_of(segments, state, target_c):
    return plan_preheating(VEHICLE, route_of(segments), state, Goal(target_c), 'optimal_switch')


def steady(count=80, duration_s=30.0, **changed):
    return [{'duration_s': duration_s, 'speed_mps': 23.0, 'propulsion_power_w': 17e3,
             'spread_w': 6e3, 'ambient_temperature_c': -5.0, 'cabin_heating_power_w': 1600.0,
             'auxiliary_power_w': 400.0, **changed}] * count


START = BatteryState(temperature_c=-3.0, soc=0.86)


@settings(max_examples=3 * settings.default.max_examples)
@given(segments=SEGMENTS, start_c=START_C, soc=SOC, share=SHARE)
def test_reachable_target_is_met_by_all_the_power_that_the_cabin_leaves_from_one_instant_on(
        segments, start_c, soc, share):
    state = BatteryState(start_c, soc)
    target_c = drawn_target(segments, state, share)
    plan = plan_of(segments, state, target_c)
    # A hundred times better than measurable; the search ends at half of this.
    assert plan.arrival_temperature_c == pytest.approx(target_c, abs=1e-5)
    # The same integrator written twice differs by rounding.
    assert plan.arrival_temperature_c == pytest.approx(
        arrival_c(segments, state, plan.hvch_battery_power_w), abs=1e-9)
    limit_w = np.array([heater_limit_w(segment) for segment in segments])
    after = int(np.searchsorted(plan.time_s, plan.heating_start_s, side='right'))
    part = (plan.time_s[after] - plan.heating_start_s) / segments[after - 1]['duration_s']
    expected_w = np.concatenate((
        np.zeros(after - 1), [part * limit_w[after - 1]], limit_w[after:]))
    assert plan.hvch_battery_power_w == pytest.approx(expected_w, rel=1e-12, abs=1e-9)


@given(segments=SEGMENTS, start_c=START_C, soc=SOC, warmer_k=st.floats(-5.0, -0.001))
def test_target_below_the_unheated_arrival_needs_no_heating(segments, start_c, soc, warmer_k):
    state = BatteryState(start_c, soc)
    idle_c, _ = span_c(segments, state)
    plan = plan_of(segments, state, idle_c + warmer_k)
    assert (plan.status, plan.hvch_battery_power_w.any()) == (Status.NOT_NEEDED, False)


# Nearer than a fifth of a kelvin counts as reached.
@given(segments=SEGMENTS, start_c=START_C, soc=SOC, colder_k=st.floats(0.201, 30.0))
def test_target_above_the_fully_heated_arrival_is_unreachable(segments, start_c, soc, colder_k):
    state = BatteryState(start_c, soc)
    _, full_c = span_c(segments, state)
    plan = plan_of(segments, state, full_c + colder_k)
    assert plan.status is Status.TARGET_UNREACHABLE
    assert plan.shortfall_k == pytest.approx(colder_k, abs=1e-9)


@pytest.mark.costly
@given(segments=SEGMENTS, start_c=START_C, soc=SOC, share=SHARE, higher_k=st.floats(0.0, 9.0))
def test_higher_target_never_starts_later(segments, start_c, soc, share, higher_k):
    state = BatteryState(start_c, soc)
    target_c = drawn_target(segments, state, share)
    lower, higher = (plan_of(segments, state, target_c + more_k) for more_k in (0.0, higher_k))
    # Arrival is met to 5e-6 K, which even a weak heater provides in some milliseconds.
    assert higher.heating_start_s <= lower.heating_start_s + 0.1


@given(segments=SEGMENTS, start_c=START_C, soc=SOC, share=SHARE, warmer_k=st.floats(0.0, 9.0))
def test_warmer_start_never_costs_more(segments, start_c, soc, share, warmer_k):
    cold, warm = BatteryState(start_c, soc), BatteryState(start_c + warmer_k, soc)
    target_c = drawn_target(segments, cold, share)
    cold_wh, warm_wh = (plan_of(segments, state, target_c).energy_wh.battery_total
                        for state in (cold, warm))
    # 5e-6 K of arrival is 0.6 mWh, on either side.
    assert warm_wh <= cold_wh + 2e-3


@pytest.mark.parametrize('target_c', [4.0, 11.0, 19.0])
def test_shorter_segments_keep_the_switching_instant(target_c):
    coarse = plan_of(steady(80, 30.0), START, target_c)
    fine = plan_of(steady(240, 10.0), START, target_c)
    # In the step of switching on, the heater has its mean power.
    assert fine.heating_start_s == pytest.approx(coarse.heating_start_s, abs=1.0)


def test_target_a_little_above_the_unheated_arrival_is_heated_for_just_before_it():
    trip = make_trip(VEHICLE, route_of(steady()))
    idle_c = float(plan_optimal_switch(trip, START, Goal(-30.0)).temperature_c[-1])
    assert plan_of(steady(), START, idle_c).status is Status.NOT_NEEDED
    plan = plan_of(steady(), START, idle_c + 1e-3)
    # 0.86 * 5200 W warm 371 kJ/K by a millikelvin in 83 ms.
    assert plan.arrival_time_s - plan.heating_start_s == pytest.approx(0.083, abs=0.002)


def test_target_at_the_fully_heated_arrival_is_heated_for_all_the_way():
    _, full_c = span_c(steady(), START)
    plan = plan_of(steady(), START, full_c)
    assert plan.status in (Status.HEATING, Status.WAITING)
    assert plan.heating_start_s == pytest.approx(0.0, abs=0.01)


def test_segment_that_is_longer_than_a_step_may_be():
    state, target_c = BatteryState(1.0, 0.93), 13.0
    one, many = plan_of(steady(1, 2400.0), state, target_c), plan_of(steady(), state, target_c)
    # Steps of 300 s against 30 s: the mean power represents the heater in a longer step.
    assert one.arrival_temperature_c == pytest.approx(target_c, abs=1e-3)
    assert one.heating_start_s == pytest.approx(many.heating_start_s, abs=10.0)
