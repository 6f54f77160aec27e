# SPDX-License-Identifier: Apache-2.0
"""The model's equations and integrators compared with hand-written equations, closed forms and scipy."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import ARRAYS, FLOATS, SATURATING_FLOATS
from bev_preheat.vehicle.curves import InverseTemperatureResistance, PolynomialVoltage, Table
from bev_preheat.vehicle.description import Battery, Defaults, Drivetrain, Hvch, Leakage, Vehicle
from bev_preheat.vehicle.model import make_euler, make_rates, make_runge_kutta_4

# One car; all numbers differ, so that a swapped pair shows.
C0_V, C1_V, C2_V, C3_V = 340.0, 70.0, -30.0, 25.0
K_OHM_K, REFERENCE_C = 5.0, 47.0
CAPACITY_AH, HEAT_CAPACITY_J_PER_K = 130.0, 290e3

SOC, TEMPERATURE_C = 0.7, -9.0
POWER_W, VARIANCE_W2, HEAT_W, LEAKAGE_W_PER_K = 26e3, 1.9e8, 2300.0, 53.0
INPUTS = (POWER_W, VARIANCE_W2, HEAT_W, LEAKAGE_W_PER_K)


def car(k_ohm_k=K_OHM_K, resistance=None):
    limit = Table((0.0,), (0.0,), ((1.0,),))
    return Vehicle(
        name='test car',
        battery=Battery(
            capacity_ah=CAPACITY_AH, heat_capacity_j_per_k=HEAT_CAPACITY_J_PER_K,
            open_circuit_voltage=PolynomialVoltage((C0_V, C1_V, C2_V, C3_V)),
            resistance=resistance or InverseTemperatureResistance(k_ohm_k, REFERENCE_C),
            discharge_power_limit=limit, charge_power_limit=limit,
            leakage=Leakage(31.0, 0.7), soc_range=(0.0, 1.0), temperature_range_c=(-40.0, 60.0)),
        drivetrain=Drivetrain(0.91, 0.77, 200e3), hvch=Hvch(6800.0, 0.86),
        defaults=Defaults(1500.0, 400.0, 25.0))


def voltage_v(soc):
    return C0_V + C1_V * soc + C2_V * soc**2 + C3_V * soc**3


def current_a(power_w, soc=SOC, temperature_c=TEMPERATURE_C, k_ohm_k=K_OHM_K):
    """Return the smaller root of U I - R I^2 = P, in the form of Algorithm 1."""
    u, r = voltage_v(soc), k_ohm_k / (temperature_c + REFERENCE_C)
    return (u - np.sqrt(u**2 - 4 * r * power_w)) / (2 * r)


def hand_written_rates(soc, temperature_c, power_w, variance_w2, heat_w, leakage_w_per_k):
    """Eqs. (9b)-(9d) with the correction for varying power, written out."""
    u, r = voltage_v(soc), K_OHM_K / (temperature_c + REFERENCE_C)
    joule_w = r * (current_a(power_w, soc, temperature_c)**2 + variance_w2 / u**2)
    battery_power_w = power_w + joule_w
    return (-battery_power_w / (u * CAPACITY_AH * 3600.0),
            (heat_w - leakage_w_per_k * temperature_c + joule_w) / HEAT_CAPACITY_J_PER_K,
            joule_w)


def rolled(make_integrator, step_s):
    """Return state of charge and temperature after 1200 s of constant inputs, in equal steps."""
    step = make_integrator(make_rates(car(), FLOATS))
    soc, temperature_c = 0.8, -9.0
    for _ in range(round(1200.0 / step_s)):
        soc, temperature_c, _, _ = step(soc, temperature_c, step_s, *INPUTS)
    return np.array([soc, temperature_c])


@pytest.fixture(scope='module')
def accurate_end():
    """Return the hand-written equations, integrated by scipy over the 1200 s of `rolled`."""
    from scipy.integrate import solve_ivp
    solution = solve_ivp(
        lambda _, state: hand_written_rates(*state, *INPUTS)[:2], (0.0, 1200.0), (0.8, -9.0),
        method='DOP853', rtol=1e-13, atol=1e-13)
    return solution.y[:, -1]


@pytest.mark.parametrize('power_w', [26e3, -18e3, 0.0])
@pytest.mark.parametrize('variance_w2', [1.9e8, 0.0])
@pytest.mark.parametrize('part', [0, 1, 2], ids=['soc', 'temperature', 'joule'])
def test_rates_are_the_papers(power_w, variance_w2, part):
    arguments = (SOC, TEMPERATURE_C, power_w, variance_w2, HEAT_W, LEAKAGE_W_PER_K)
    rate = make_rates(car(), FLOATS)(*arguments)[part]
    # The root cancels: its rounding, 1e-16 U/R = 1e-13 A, is about 1e-12 of the currents here.
    assert rate == pytest.approx(hand_written_rates(*arguments)[part], rel=1e-11, abs=1e-15)


@given(power_w=st.floats(-90e3, 60e3), deviation_w=st.floats(0.0, 40e3), soc=st.floats(0.05, 1.0),
       temperature_c=st.floats(-25.0, 50.0))
def test_battery_power_is_terminal_power_and_joule_heat(power_w, deviation_w, soc, temperature_c):
    soc_rate, _, joule_w = make_rates(car(), FLOATS)(
        soc, temperature_c, power_w, deviation_w**2, HEAT_W, LEAKAGE_W_PER_K)
    battery_power_w = -soc_rate * CAPACITY_AH * 3600.0 * voltage_v(soc)
    assert battery_power_w == pytest.approx(power_w + joule_w, rel=1e-11, abs=1e-9)


def brute_force(k_ohm_k):
    """Return mean current and mean Joule heat of a sinusoidal power, and the model's, minus a constant's."""
    power_w, amplitude_w = 24e3, 15e3
    phases = (np.arange(4000) + 0.5) * 2 * math.pi / 4000
    currents = current_a(power_w + amplitude_w * np.sin(phases), k_ohm_k=k_ohm_k)
    r = k_ohm_k / (TEMPERATURE_C + REFERENCE_C)
    soc_rate, _, joule_w = make_rates(car(k_ohm_k), FLOATS)(
        SOC, TEMPERATURE_C, power_w, amplitude_w**2 / 2, 0.0, 0.0)
    steady = current_a(power_w, k_ohm_k=k_ohm_k)
    true = np.array([currents.mean() - steady, r * (currents**2).mean() - r * steady**2])
    model = np.array([-soc_rate * CAPACITY_AH * 3600.0 - steady, joule_w - r * steady**2])
    return true, model


@pytest.mark.parametrize('part', [0, 1], ids=['current', 'joule'])
def test_varying_power_is_right_to_first_order_in_the_resistance(part):
    # The neglected terms are of second order: half the resistance, a quarter of the error; the third
    # order, about R P/U^2 = 0.002 times as large, moves the ratio slightly above 4.
    errors = [true[part] - model[part] for true, model in map(brute_force, (0.4, 0.2))]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_power_that_cannot_be_delivered_is_an_error_for_floats():
    limit_w = voltage_v(SOC)**2 * (TEMPERATURE_C + REFERENCE_C) / (4 * K_OHM_K)
    with pytest.raises(ValueError):
        make_rates(car(), FLOATS)(SOC, TEMPERATURE_C, limit_w * 1.001, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('arithmetic', [
    pytest.param(SATURATING_FLOATS, id='floats'), pytest.param(ARRAYS, id='arrays')])
def test_power_that_cannot_be_delivered_holds_the_largest_current(arithmetic):
    soc_rate, _, _ = make_rates(car(), arithmetic)(SOC, TEMPERATURE_C, 9e5, 0.0, 0.0, 0.0)
    resistance = K_OHM_K / (TEMPERATURE_C + REFERENCE_C)
    assert -soc_rate * CAPACITY_AH * 3600.0 == pytest.approx(voltage_v(SOC) / (2 * resistance), rel=1e-14)


@pytest.mark.parametrize('resistance', [
    pytest.param(None, id='formula'),
    pytest.param(Table((0.1, 0.6, 1.0), (-20.0, 0.0, 30.0),
                       ((0.4, 0.2, 0.1), (0.35, 0.17, 0.08), (0.3, 0.18, 0.07))), id='table')])
@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(-25.0, 50.0), st.floats(-60e3, 60e3),
                          st.floats(0.0, 1e9), st.floats(-5e3, 9e3), st.floats(0.0, 200.0)),
                min_size=1, max_size=8))
def test_arrays_are_floats(resistance, rows):
    vehicle = car(resistance=resistance)
    floats = [make_rates(vehicle, FLOATS)(*row) for row in rows]
    arrays = make_rates(vehicle, ARRAYS)(*np.array(rows).T)
    # The root's rounding, as above; per hour, and per milliwatt of heat.
    for array, column, scale in zip(arrays, zip(*floats), (1e-15, 1e-11, 1e-9)):
        assert array == pytest.approx(np.array(column), rel=1e-11, abs=scale)


@pytest.mark.parametrize('make_integrator, step_s, factor', [
    pytest.param(make_euler, 20.0, 2.0, id='euler'),
    pytest.param(make_runge_kutta_4, 75.0, 16.0, id='rk4')])
@pytest.mark.parametrize('part', [0, 1], ids=['soc', 'temperature'])
def test_halving_the_step_shows_the_order(make_integrator, step_s, factor, part, accurate_end):
    errors = [rolled(make_integrator, step)[part] - accurate_end[part] for step in (step_s, step_s / 2)]
    # The next order has a small effect; one order more or less would be a factor of two.
    assert errors[0] / errors[1] == pytest.approx(factor, rel=0.15)
