# SPDX-License-Identifier: Apache-2.0
"""The model's step with heater, coolant, shell and core: closed forms, a fine integration and half steps."""

from dataclasses import replace
from math import exp, sqrt

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.heat_path import make_heated_step, sensed_c
from bev_preheat.vehicle.model import make_rates, make_runge_kutta_4
from bev_preheat.vehicle.variants import with_shell

REFERENCE = load_vehicle('reference')
BATTERY_J_PER_K = REFERENCE.battery.heat_capacity_j_per_k
EFFICIENCY = REFERENCE.hvch.efficiency
LAG = HeatPath(heater_lag_s=60.0)
COOLANT = HeatPath(coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0)
BOTH = HeatPath(45.0, 15e3, 300.0)
PATHS = st.builds(
    HeatPath, heater_lag_s=st.sampled_from([0.0, 3.0, 20.0, 47.0, 90.0]),
    coolant_heat_capacity_j_per_k=st.sampled_from([0.0, 5e3, 18e3, 40e3]),
    coolant_conductance_w_per_k=st.sampled_from([200.0, 430.0, 1000.0]))
# Duration, terminal power, its variance, heat, leakage; the command.
INPUTS = st.tuples(st.floats(1.0, 60.0), st.floats(-10e3, 40e3), st.floats(0.0, 1e8),
                   st.floats(-2e3, 3e3), st.floats(0.0, 150.0), st.floats(0.0, 7e3))
STATES = st.tuples(st.floats(0.3, 0.95), st.floats(-20.0, 30.0), st.floats(0.0, 7e3), st.floats(-5.0, 20.0))


def stepper(path):
    return make_heated_step(replace(REFERENCE, heat_path=path), FLOATS)


@given(STATES, INPUTS)
def test_without_a_path_it_is_the_models_own_step(states, inputs):
    soc, temperature_c, _, _ = states
    duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, command_w = inputs
    plain = make_runge_kutta_4(make_rates(REFERENCE, FLOATS))(
        soc, temperature_c, duration_s, power_w + command_w, variance_w2,
        heat_w + EFFICIENCY * command_w, leakage_w_per_k)
    found = stepper(HeatPath())(*states[:2], 0.0, 0.0, *inputs)
    assert found == (*plain[:2], command_w, 0.0, *plain[2:], command_w, EFFICIENCY * command_w)


def test_battery_behind_a_lagging_heater_warms_as_the_closed_form_says():
    # At a steady current of 0 A: the heater's mean power is regenerated.
    duration_s, command_w = 90.0, 5e3
    mean_w = command_w * (1.0 - 60.0 * (1.0 - exp(-1.5)) / duration_s)
    soc, end_c, heater_w, excess_k, _, joule_w, drawn_w, arriving_w = stepper(LAG)(
        0.8, 5.0, 0.0, 0.0, duration_s, -mean_w, 0.0, 0.0, 0.0, command_w)
    assert (soc, joule_w, excess_k) == (pytest.approx(0.8, abs=1e-12), pytest.approx(0.0, abs=1e-6), 0.0)
    assert heater_w == pytest.approx(command_w * (1.0 - exp(-1.5)), rel=1e-13)
    assert (drawn_w, arriving_w) == (pytest.approx(mean_w), pytest.approx(EFFICIENCY * mean_w))
    assert end_c == pytest.approx(5.0 + EFFICIENCY * command_w / BATTERY_J_PER_K * (
        duration_s - 60.0 * (1.0 - exp(-1.5))), abs=1e-9)


def test_two_masses_approach_each_other_as_the_closed_form_says():
    states = (0.8, 0.0, 0.0, 40.0)
    rate_per_s = 400.0 / 20e3 + 400.0 / BATTERY_J_PER_K
    for _ in range(7):
        states = stepper(COOLANT)(*states, 10.0, 0.0, 0.0, 0.0, 0.0, 0.0)[:4]
    assert states[3] == pytest.approx(40.0 * exp(-rate_per_s * 70.0), rel=1e-9)
    both_j_per_k = BATTERY_J_PER_K + 20e3
    assert states[1] == pytest.approx(20e3 * 40.0 / both_j_per_k * (1.0 - exp(-rate_per_s * 70.0)), rel=1e-9)


@given(PATHS, STATES, INPUTS)
def test_all_heat_goes_into_battery_and_coolant(path, states, inputs):
    soc, temperature_c, heater_w, excess_k = states
    excess_k = excess_k if path.has_coolant else 0.0
    duration_s, _, _, heat_w, leakage_w_per_k, _ = inputs
    _, end_c, _, excess_end_k, mean_c, joule_w, drawn_w, arriving_w = stepper(path)(
        soc, temperature_c, heater_w, excess_k, *inputs)
    warmed_j = BATTERY_J_PER_K * (end_c - temperature_c)
    coolant_j = path.coolant_heat_capacity_j_per_k * (end_c + excess_end_k - temperature_c - excess_k)
    made_j = EFFICIENCY * drawn_w * duration_s
    other_j = duration_s * (heat_w - leakage_w_per_k * mean_c + joule_w)
    assert warmed_j + coolant_j == pytest.approx(made_j + other_j, rel=1e-9, abs=0.01)
    assert warmed_j == pytest.approx(arriving_w * duration_s + other_j, rel=1e-9, abs=0.01)


def fine(path, states, inputs, battery_j_per_k=BATTERY_J_PER_K):
    """Return the states after a step by integrating the equations of the docstring."""
    from scipy.integrate import solve_ivp
    duration_s, power_w, variance_w2, heat_w, leakage_w_per_k, command_w = inputs
    battery = REFERENCE.battery
    voltage = battery.open_circuit_voltage.function(FLOATS)

    def rates(_, y):
        soc, temperature_c, heater_w, excess_k = y
        if path.heater_lag_s == 0.0:
            heater_w = command_w
        u = voltage(soc, temperature_c)
        r = battery.resistance.k_ohm_k / (temperature_c + battery.resistance.reference_temperature_c)
        current_a = (u - sqrt(u * u - 4.0 * r * (power_w + heater_w))) / (2.0 * r)
        ripple_w = r * variance_w2 / u**2
        made_w = EFFICIENCY * heater_w
        flow_w = path.coolant_conductance_w_per_k * excess_k if path.has_coolant else made_w
        # A shell lies between the core and all that is outside of the battery.
        outer_w = heat_w - leakage_w_per_k * (temperature_c + excess_k * path.is_shell)
        to_shell_w, to_battery_w = (outer_w, 0.0) if path.is_shell else (0.0, outer_w)
        warming = (flow_w + to_battery_w + r * current_a**2 + ripple_w) / battery_j_per_k
        return (-(current_a + ripple_w / u) / battery.capacity_as, warming,
                0.0 if path.heater_lag_s == 0.0 else (command_w - heater_w) / path.heater_lag_s,
                (made_w + to_shell_w - flow_w) / path.coolant_heat_capacity_j_per_k - warming
                if path.has_coolant else 0.0)

    end = solve_ivp(rates, (0.0, duration_s), states, rtol=1e-11, atol=1e-11).y[:, -1]
    if path.heater_lag_s == 0.0:
        end[2] = command_w
    return end


START = (0.7, -6.0, 700.0, 3.0)
DRIVE = (-5e3, 4e7, 900.0, 60.0, 5e3)


@pytest.mark.parametrize('path', [LAG, COOLANT, BOTH, HeatPath(5.0, 30e3, 900.0)])
def test_halved_steps_come_closer_to_a_fine_integration(path):
    start = START if path.has_coolant else (*START[:3], 0.0)
    truth = fine(path, start, (60.0, *DRIVE))
    errors = []
    for parts in (2, 4, 8):
        states = start
        for _ in range(parts):
            states = stepper(path)(*states, 60.0 / parts, *DRIVE)[:4]
        errors.append(abs(np.array(states) - truth))
    # Steps of 30 s, as in a plan: far below a plan's accuracy.
    assert (errors[0] < (1e-6, 2e-4, 1e-6, 5e-3)).all()
    for state in (0, 1, 3):
        assert errors[2][state] <= 0.6 * errors[0][state] + 1e-9


# A battery of shell and core

SHARE, CONDUCTANCE = 0.3, 240.0


def shell_car(conductance_w_per_k=CONDUCTANCE, sensor='shell', heater_lag_s=0.0):
    return with_shell(replace(REFERENCE, heat_path=HeatPath(heater_lag_s)), SHARE, conductance_w_per_k, sensor)


def course(vehicle, steps, duration_s, inputs, start=(0.8, 2.0, 0.0, 0.0)):
    """Return the states after each of equal steps, from `start` on: charge, core, heater, excess of the shell."""
    step, states = make_heated_step(vehicle, FLOATS), [start]
    for _ in range(steps):
        states.append(step(*states[-1], duration_s, *inputs)[:4])
    return np.array(states)


def test_a_steady_heat_lifts_the_shell_above_the_core():
    command_w, outer_w = 4e3, 700.0
    # Without current there is no Joule heat.
    _, core_c, _, excess_k = course(shell_car(), 120, 60.0, (-command_w, 0.0, outer_w, 0.0, command_w)).T
    warming_w = EFFICIENCY * command_w + outer_w
    steady_k = (1.0 - SHARE) * warming_w / CONDUCTANCE
    assert excess_k[-1] == pytest.approx(steady_k, rel=1e-6)
    # The shell is 1 - SHARE of the excess above the mean, the core SHARE below.
    mean_c = core_c + SHARE * excess_k
    rises_k = [sensed_c(shell_car(sensor=place).heat_path, core_c[-1], excess_k[-1]) - mean_c[-1]
               for place in ('shell', 'core', 'mean')]
    assert rises_k == pytest.approx([(1.0 - SHARE) * steady_k, -SHARE * steady_k, 0.0], abs=1e-4)
    # The approach has the time constant of both masses in series.
    lag_s = SHARE * (1.0 - SHARE) * BATTERY_J_PER_K / CONDUCTANCE
    assert excess_k[3] == pytest.approx(steady_k * -np.expm1(-180.0 / lag_s), rel=1e-9)
    # All heat warms the mean.
    assert mean_c[-1] - 2.0 == pytest.approx(warming_w * 7200.0 / BATTERY_J_PER_K, rel=1e-9)


@pytest.mark.parametrize('heater_lag_s', [0.0, 40.0])
def test_a_step_is_that_of_the_equations_of_both_masses(heater_lag_s):
    inputs = 21e3, 0.0, 1.4e3 - 10.0 * 47.0, 47.0, 4.5e3
    vehicle, start = shell_car(heater_lag_s=heater_lag_s), (0.8, -6.0, 500.0, 3.0)
    truth = fine(vehicle.heat_path, start, (900.0, *inputs), (1.0 - SHARE) * BATTERY_J_PER_K)
    # Joule heat and leakage are those at the start of a step: ten times shorter steps err by a tenth.
    for steps, core_k, excess_k in ((30, 0.01, 0.06), (300, 0.001, 0.006)):
        found = course(vehicle, steps, 900.0 / steps, inputs, start)[-1]
        assert found[0] == pytest.approx(truth[0], abs=1e-6)
        assert found[1] == pytest.approx(truth[1], abs=core_k)
        assert found[3] == pytest.approx(truth[3], abs=excess_k)


def test_with_a_good_conductance_it_is_a_battery_of_one_mass():
    step, one = make_runge_kutta_4(make_rates(REFERENCE, FLOATS)), (0.8, 2.0)
    for _ in range(40):
        one = step(*one, 30.0, 19e3, 0.0, 300.0 + EFFICIENCY * 4e3, 45.0)[:2]
    _, core_c, _, excess_k = course(shell_car(1e8), 40, 30.0, (15e3, 0.0, 300.0, 45.0, 4e3))[-1]
    assert (core_c, excess_k) == (pytest.approx(one[1], abs=2e-3), pytest.approx(0.0, abs=1e-3))
