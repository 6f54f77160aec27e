# SPDX-License-Identifier: Apache-2.0
"""Heater, coolant and sensor compared with closed forms, a fine integration, and half steps."""

from dataclasses import replace
from math import exp

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics.arithmetic import ARRAYS, FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.heat_path import DIRECT, HeatPath
from bev_preheat.vehicle.heated_step import make_heat_step, sensor_reading_c

REFERENCE = load_vehicle('reference')
BATTERY_J_PER_K = REFERENCE.battery.heat_capacity_j_per_k
EFFICIENCY = REFERENCE.hvch.efficiency
PATHS = st.builds(
    HeatPath, heater_lag_s=st.sampled_from([0.0, 3.0, 20.0, 47.0, 90.0]),
    coolant_heat_capacity_j_per_k=st.sampled_from([0.0, 5e3, 18e3, 40e3]),
    coolant_conductance_w_per_k=st.sampled_from([200.0, 430.0, 1000.0]))
POWERS_W = st.floats(0.0, 7e3)
STARTS_C = st.floats(-20.0, 30.0)
DURATIONS_S = st.floats(0.05, 300.0)
OTHERS_W = st.floats(-3e3, 5e3)


def stepper(path, arithmetic=FLOATS):
    return make_heat_step(replace(REFERENCE, heat_path=path), arithmetic)


def advance(path, state, duration_s, command_w, other_heat_w):
    """Return the state (power, coolant, battery) after a step, and the mean powers."""
    power_w, coolant_c, battery_c = state
    mean_w, heat_w, power_w, coolant_c = stepper(path)(
        power_w, coolant_c, battery_c, duration_s, command_w, other_heat_w, 0.0, 0.0)
    battery_c += (heat_w + other_heat_w) * duration_s / BATTERY_J_PER_K
    return (power_w, coolant_c if path.has_coolant else battery_c, battery_c), mean_w, heat_w


def test_left_out_heat_arrives_when_it_is_commanded():
    assert DIRECT.is_direct
    assert advance(DIRECT, (0.0, 5.0, 5.0), 30.0, 5e3, 1e3)[1:] == (5e3, EFFICIENCY * 5e3)


def test_a_lagging_heater_rises_as_an_exponential():
    path = HeatPath(heater_lag_s=60.0)
    (power_w, _, _), mean_w, heat_w = advance(path, (0.0, 5.0, 5.0), 90.0, 5e3, 0.0)
    assert power_w == pytest.approx(5e3 * (1.0 - exp(-1.5)), rel=1e-13)
    assert mean_w == pytest.approx(5e3 * (1.0 - (1.0 - exp(-1.5)) / 1.5), rel=1e-13)
    assert heat_w == EFFICIENCY * mean_w
    # The heat still under way at switch-off arrives later: 60 s of the power then.
    late_j = advance(path, (power_w, 5.0, 5.0), 5000.0, 0.0, 0.0)[1] * 5000.0
    assert late_j == pytest.approx(60.0 * power_w, rel=1e-12)


def test_two_masses_meet_where_their_heat_says():
    path = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
    rate_per_s = 400.0 / 20e3 + 400.0 / BATTERY_J_PER_K
    (_, coolant_c, battery_c), _, _ = advance(path, (0.0, 40.0, 0.0), 70.0, 0.0, 0.0)
    assert coolant_c - battery_c == pytest.approx(40.0 * exp(-rate_per_s * 70.0), rel=1e-9)
    assert 20e3 * coolant_c + BATTERY_J_PER_K * battery_c == pytest.approx(20e3 * 40.0, rel=1e-12)


def test_under_steady_power_the_coolant_is_as_much_warmer_as_the_flow_asks():
    path = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
    state = (5e3, 0.0, 0.0)
    for _ in range(100):
        state, _, heat_w = advance(path, state, 30.0, 5e3, 0.0)
    # Both warm at the same rate: the battery gets its share of the heat.
    assert heat_w == pytest.approx(
        EFFICIENCY * 5e3 * BATTERY_J_PER_K / (BATTERY_J_PER_K + 20e3), rel=1e-9)
    assert state[1] - state[2] == pytest.approx(heat_w / 400.0, rel=1e-9)


@given(PATHS, POWERS_W, STARTS_C, STARTS_C, DURATIONS_S, POWERS_W, OTHERS_W)
def test_no_heat_is_lost(path, power_w, coolant_c, battery_c, duration_s, command_w, other_w):
    if not path.has_coolant:
        coolant_c = battery_c
    start = (power_w, coolant_c, battery_c)
    (_, end_coolant_c, end_battery_c), mean_w, _ = advance(
        path, start, duration_s, command_w, other_w)
    stored_j = (path.coolant_heat_capacity_j_per_k * (end_coolant_c - coolant_c)
                + BATTERY_J_PER_K * (end_battery_c - battery_c))
    assert stored_j == pytest.approx(
        (EFFICIENCY * mean_w + other_w) * duration_s, rel=1e-9, abs=1e-3)


@given(PATHS, POWERS_W, STARTS_C, STARTS_C, DURATIONS_S, POWERS_W, OTHERS_W)
def test_two_halves_are_the_whole(path, power_w, coolant_c, battery_c, duration_s, command_w,
                                  other_w):
    if not path.has_coolant:
        coolant_c = battery_c
    start = (power_w, coolant_c, battery_c)
    whole, _, _ = advance(path, start, duration_s, command_w, other_w)
    half, _, _ = advance(path, start, 0.5 * duration_s, command_w, other_w)
    halves, _, _ = advance(path, half, 0.5 * duration_s, command_w, other_w)
    assert halves == pytest.approx(whole, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize('path', [
    HeatPath(60.0, 20e3, 400.0), HeatPath(5.0, 40e3, 200.0), HeatPath(0.0, 5e3, 1000.0),
    HeatPath(90.0)])
def test_it_is_what_a_fine_integration_gives(path):
    from scipy.integrate import solve_ivp
    capacity, conductance = path.coolant_heat_capacity_j_per_k, path.coolant_conductance_w_per_k

    def rates(_, state):
        power_w, coolant_c, battery_c = state
        if path.heater_lag_s == 0.0:
            power_w, rise = 4e3, 0.0
        else:
            rise = (4e3 - power_w) / path.heater_lag_s
        if capacity == 0.0:
            warming = (EFFICIENCY * power_w + 1.2e3) / BATTERY_J_PER_K
            return rise, warming, warming
        flow_w = conductance * (coolant_c - battery_c)
        return (rise, (EFFICIENCY * power_w - flow_w) / capacity,
                (flow_w + 1.2e3) / BATTERY_J_PER_K)

    start = (700.0 if path.heater_lag_s else 4e3, *((9.0, 3.0) if capacity else (3.0, 3.0)))
    fine = solve_ivp(rates, (0.0, 37.0), start, rtol=1e-11, atol=1e-9).y[:, -1]
    assert advance(path, start, 37.0, 4e3, 1.2e3)[0] == pytest.approx(tuple(fine), rel=1e-7)


def test_equal_time_constants_are_no_special_case():
    time_constant_s = 1.0 / (400.0 / 20e3 + 400.0 / BATTERY_J_PER_K)
    ends = [advance(HeatPath(lag_s, 20e3, 400.0), (0.0, 0.0, 0.0), 40.0, 5e3, 0.0)[0]
            for lag_s in (0.999 * time_constant_s, time_constant_s, 1.001 * time_constant_s)]
    assert ends[1] == pytest.approx(0.5 * (np.array(ends[0]) + ends[2]), rel=1e-4)


def test_arrays_are_the_same_as_floats():
    path = HeatPath(30.0, 15e3, 300.0)
    random = np.random.default_rng(3)
    columns = [random.uniform(low, high, 20) for low, high in (
        (0.0, 7e3), (-5.0, 40.0), (-5.0, 30.0), (1.0, 60.0), (0.0, 7e3), (-1e3, 3e3), (-1e3, 3e3), (5.0, 60.0))]
    together = stepper(path, ARRAYS)(*columns)
    one_by_one = [stepper(path)(*row) for row in zip(*(column.tolist() for column in columns))]
    assert np.array(together).T == pytest.approx(np.array(one_by_one), rel=1e-12)


def test_a_sensor_follows_late_and_shows_the_battery_in_the_end():
    path = HeatPath(sensor_lag_s=120.0)
    assert sensor_reading_c(path, 0.0, 10.0, 10.0, 120.0, FLOATS) == pytest.approx(
        10.0 * (1.0 - exp(-1.0)))
    assert sensor_reading_c(path, 0.0, 10.0, 10.0, 1e5, FLOATS) == 10.0
    assert sensor_reading_c(DIRECT, 0.0, 9.0, 10.0, 1.0, FLOATS) == 10.0


def test_a_battery_that_warms_steadily_is_seen_a_lag_late():
    path = HeatPath(sensor_lag_s=120.0)
    reading_c = 0.0
    for second in range(2000):
        reading_c = sensor_reading_c(path, reading_c, 0.01 * second, 0.01 * (second + 1), 1.0, FLOATS)
    assert reading_c == pytest.approx(20.0 - 0.01 * 120.0, abs=1e-5)
    # One step or many: a ramp stays a ramp.
    assert sensor_reading_c(path, 0.0, 0.0, 20.0, 2000.0, FLOATS) == pytest.approx(
        reading_c, abs=1e-9)
