# SPDX-License-Identifier: Apache-2.0
"""The rates of the estimated state compared with the planner's model, and their slopes."""

from dataclasses import replace
from math import exp, sqrt

import numpy as np
import pytest

from bev_preheat.estimation.estimate import (
    DriveInputs,
    HEAT_CAPACITY,
    HEAT_LAG,
    JOULE_RISE,
    moved,
    MOVING,
    PROPULSION,
    rates_and_slopes,
    SENSOR_LAG,
    SENSOR_PLACE,
    SIZE,
    state_rates,
)
from bev_preheat.numerics import FLOATS
from bev_preheat.tunables import LOCAL_LAG_S, NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.model import make_rates

VEHICLES = {name: load_vehicle(name) for name in ('reference', 'small_car')}
STATE = np.array([3.7, 0.63, 0.08, -0.15, 0.11, -0.04, 0.07, 0.12, 0.3, -0.4, 0.35, -0.15, 0.9, 3.1, 0.4])
DRIVE = DriveInputs(
    speed_mps=23.0, ambient_temperature_c=-11.0, propulsion_power_w=17e3, power_variance_w2=4e7,
    propulsion_power_magnitude_w=17.7e3, cabin_heating_power_w=1300.0, auxiliary_power_w=450.0,
    heater_power_w=3100.0, source_heat_w=1900.0)


def by_hand(vehicle, state, drive):
    """Return the rates of a car with every quantity multiplied by hand, from the scalar model."""
    temperature_c, soc, capacity, leakage, resistance, heater, propulsion, source = state[:8]
    battery = vehicle.battery
    propulsion_w = exp(propulsion) * drive.propulsion_power_w
    terminal_w = propulsion_w + (drive.cabin_heating_power_w + drive.auxiliary_power_w
                                 + drive.heater_power_w)
    variance_w2 = exp(propulsion)**2 * drive.power_variance_w2
    magnitude_w = exp(propulsion) * drive.propulsion_power_magnitude_w
    if drive.terminal_power_w is not None:
        terminal_w, variance_w2 = drive.terminal_power_w, drive.power_variance_w2
        propulsion_w = terminal_w - (drive.cabin_heating_power_w + drive.auxiliary_power_w
                                     + drive.heater_power_w)
        deviation_w = sqrt(variance_w2)
        from scipy.stats import foldnorm
        magnitude_w = foldnorm(abs(propulsion_w) / deviation_w, scale=deviation_w).mean()
    gamma = exp(leakage) * (battery.leakage.gamma_0_w_per_k
                            + battery.leakage.gamma_v_w_per_k_per_mps * drive.speed_mps)
    heat_w = (exp(heater) * vehicle.hvch.efficiency * (drive.heater_power_w + exp(source) * drive.source_heat_w)
              + gamma * (drive.ambient_temperature_c - temperature_c)
              + vehicle.drivetrain.heat_recovery_efficiency
              * (1.0 - vehicle.drivetrain.efficiency) * magnitude_w)

    class Scaled:
        def function(self, arithmetic):
            plain = battery.resistance.function(arithmetic)
            return lambda s, t: exp(resistance) * plain(s, t)

    scaled = replace(vehicle, battery=replace(battery, resistance=Scaled()))
    soc_rate, _, joule_w = make_rates(scaled, FLOATS)(
        soc, temperature_c, terminal_w, variance_w2, 0.0, 0.0)
    return (heat_w + joule_w) / (exp(capacity) * battery.heat_capacity_j_per_k), soc_rate, joule_w


@pytest.mark.parametrize('name', VEHICLES)
@pytest.mark.parametrize('seen_w', [None, 21.5e3, -9e3])
def test_rates_are_those_of_the_car_by_hand(name, seen_w):
    drive = replace(DRIVE, terminal_power_w=seen_w)
    assert [*map(float, state_rates(VEHICLES[name], STATE, drive))] == pytest.approx(
        by_hand(VEHICLES[name], STATE, drive), rel=1e-12)


@pytest.mark.parametrize('index', range(SIZE))
def test_slopes_are_central_differences(index):
    vehicle = VEHICLES['reference']
    _, slopes = rates_and_slopes(vehicle, STATE[np.newaxis], DriveInputs(**{
        name: np.array([[value]]) for name, value in vars(DRIVE).items() if value is not None}))
    step = np.zeros(SIZE)
    step[index] = 1e-4
    above, below = (
        np.array(by_hand(vehicle, state, DRIVE)[:2]) for state in (STATE + step, STATE - step))
    assert slopes[0, :, index] == pytest.approx((above - below) / 2e-4, rel=5e-3, abs=1e-12)


@pytest.mark.parametrize('duration_s', [1.0, 10.0])
def test_what_moves_is_what_a_fine_integration_moves(duration_s):
    """Heat under way, sensor and local rise, in small steps; other heat of the battery is constant (Euler)."""
    from scipy.integrate import solve_ivp
    vehicle = VEHICLES['reference']
    temperature_rate, soc_rate, joule_w = by_hand(vehicle, STATE, DRIVE)
    made = temperature_rate - joule_w / (exp(STATE[HEAT_CAPACITY]) * vehicle.battery.heat_capacity_j_per_k)
    heat_lag_s = NOMINAL_HEAT_LAG_S * exp(STATE[HEAT_LAG])
    sensor_lag_s = NOMINAL_SENSOR_LAG_S * exp(STATE[SENSOR_LAG])

    def rates(_, moving):
        temperature_c, _, under_way_k, sensor_c, local_k = moving
        arrives = under_way_k / heat_lag_s
        return (temperature_rate - made + arrives, soc_rate, made - arrives,
                (temperature_c + STATE[SENSOR_PLACE] * under_way_k - sensor_c) / sensor_lag_s,
                (steady_k - local_k) / LOCAL_LAG_S)

    steady_k = STATE[JOULE_RISE] * joule_w / 1e3
    start = STATE[list(MOVING)]
    fine = solve_ivp(rates, (0.0, duration_s), start, rtol=1e-11, atol=1e-12).y[:, -1]
    # Linear warming within a step causes a small error of the sensor.
    assert moved(vehicle, STATE, DRIVE, duration_s) == pytest.approx(fine, rel=1e-9, abs=2e-3)
    without_sensor = [0, 1, 2, 4]
    assert moved(vehicle, STATE, DRIVE, duration_s)[without_sensor] == pytest.approx(
        fine[without_sensor], rel=1e-9)


def test_what_was_hidden_warms_as_the_route_says_it_does():
    """Hidden variation of a measured power warms like the route's variation."""
    vehicle = VEHICLES['reference']
    state = STATE.copy()
    state[PROPULSION] = 0.0
    others_w = DRIVE.cabin_heating_power_w + DRIVE.auxiliary_power_w + DRIVE.heater_power_w
    hidden = replace(DRIVE, terminal_power_w=DRIVE.propulsion_power_w + others_w,
                     power_variance_w2=0.0, hidden_variance_w2=DRIVE.power_variance_w2)
    assert np.array(state_rates(vehicle, state, hidden)) == pytest.approx(
        np.array(state_rates(vehicle, state, DRIVE)), rel=1e-12)
