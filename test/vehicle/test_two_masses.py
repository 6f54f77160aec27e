# SPDX-License-Identifier: Apache-2.0
"""A battery of shell and core compared with closed forms, its equations, and a battery of one mass."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bev_preheat.numerics import FLOATS
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.heated_step import make_heated_step, sensed_c
from bev_preheat.vehicle.model import make_rates, make_runge_kutta_4
from bev_preheat.vehicle.variants import with_shell

REFERENCE = load_vehicle('reference')
PACK_J_PER_K, EFFICIENCY = REFERENCE.battery.heat_capacity_j_per_k, REFERENCE.hvch.efficiency
SHARE, CONDUCTANCE = 0.3, 240.0


def shell_car(conductance_w_per_k=CONDUCTANCE, sensor='shell', vehicle=REFERENCE):
    return with_shell(vehicle, SHARE, conductance_w_per_k, sensor)


def course(vehicle, steps, duration_s, command_w, power_w=0.0, heat_w=0.0, leakage_w_per_k=0.0,
           start=(0.8, 2.0, 0.0, 0.0)):
    """Return the states after each of equal steps, from `start` on: charge, core, heater, excess of the shell."""
    step, states = make_heated_step(vehicle, FLOATS), [start]
    for _ in range(steps):
        states.append(step(*states[-1], duration_s, power_w, 0.0, heat_w, leakage_w_per_k, command_w)[:4])
    return np.array(states)


def test_a_steady_heat_lifts_the_shell_above_the_core():
    command_w, outer_w = 4e3, 700.0
    # Without current there is no Joule heat.
    _, core_c, _, excess_k = course(shell_car(), 120, 60.0, command_w, -command_w, outer_w).T
    steady_k = (1.0 - SHARE) * (EFFICIENCY * command_w + outer_w) / CONDUCTANCE
    assert excess_k[-1] == pytest.approx(steady_k, rel=1e-6)
    # The shell is 1 - SHARE of the excess above the mean, the core SHARE below.
    mean_c = core_c + SHARE * excess_k
    rises_k = [sensed_c(shell_car(sensor=place).heat_path, core_c[-1], excess_k[-1]) - mean_c[-1]
               for place in ('shell', 'core', 'mean')]
    assert rises_k == pytest.approx([(1.0 - SHARE) * steady_k, -SHARE * steady_k, 0.0], abs=1e-4)
    # The approach has the time constant of both masses in series.
    lag_s = SHARE * (1.0 - SHARE) * PACK_J_PER_K / CONDUCTANCE
    assert excess_k[3] == pytest.approx(steady_k * -np.expm1(-180.0 / lag_s), rel=1e-9)
    # All heat warms the mean.
    assert mean_c[-1] - 2.0 == pytest.approx((EFFICIENCY * command_w + outer_w) * 7200.0 / PACK_J_PER_K, rel=1e-9)


@pytest.mark.parametrize('heater_lag_s', [0.0, 40.0])
def test_a_step_is_that_of_the_equations_of_both_masses(heater_lag_s):
    vehicle = shell_car(vehicle=replace(REFERENCE, heat_path=HeatPath(heater_lag_s)))
    power_w, heat_w, leakage_w_per_k, command_w = 21e3, 1.4e3 - 10.0 * 47.0, 47.0, 4.5e3
    battery = REFERENCE.battery

    def rates(_, states):
        soc, core_c, heater_w, shell_c = states
        drawn_w = heater_w if heater_lag_s else command_w
        volt, ohm = (curve.function(FLOATS)(soc, core_c) for curve in (
            battery.open_circuit_voltage, battery.resistance))
        current_a = (volt - np.sqrt(volt**2 - 4.0 * ohm * (power_w + drawn_w))) / (2.0 * ohm)
        joule_w, passed_w = ohm * current_a**2, CONDUCTANCE * (shell_c - core_c)
        outer_w = EFFICIENCY * drawn_w + heat_w - leakage_w_per_k * shell_c
        return (-current_a / battery.capacity_as,
                (passed_w + joule_w) / (1.0 - SHARE) / PACK_J_PER_K,
                (command_w - heater_w) / heater_lag_s if heater_lag_s else 0.0,
                (outer_w - passed_w) / SHARE / PACK_J_PER_K)

    inputs = command_w, power_w, heat_w, leakage_w_per_k
    fine = solve_ivp(rates, (0.0, 900.0), (0.8, -6.0, 500.0, -3.0), rtol=1e-10, atol=1e-10).y[:, -1]
    found = course(vehicle, 30, 30.0, *inputs, (0.8, -6.0, 500.0, 3.0))
    assert found[-1][0] == pytest.approx(fine[0], abs=1e-6)
    # Joule heat and leakage are those at the start of a step.
    assert found[-1][1] == pytest.approx(fine[1], abs=0.01)
    assert found[-1][3] == pytest.approx(fine[3] - fine[1], abs=0.06)
    # Ten times shorter steps err by a tenth.
    found = course(vehicle, 300, 3.0, *inputs, (0.8, -6.0, 500.0, 3.0))
    assert found[-1][1] == pytest.approx(fine[1], abs=0.001)
    assert found[-1][3] == pytest.approx(fine[3] - fine[1], abs=0.006)


def test_with_a_good_conductance_it_is_a_battery_of_one_mass():
    step, one = make_runge_kutta_4(make_rates(REFERENCE, FLOATS)), (0.8, 2.0)
    for _ in range(40):
        one = step(*one, 30.0, 19e3, 0.0, 300.0 + EFFICIENCY * 4e3, 45.0)[:2]
    _, core_c, _, excess_k = course(shell_car(1e8), 40, 30.0, 4e3, 15e3, 300.0, 45.0)[-1]
    assert (core_c, excess_k) == (pytest.approx(one[1], abs=2e-3), pytest.approx(0.0, abs=1e-3))
