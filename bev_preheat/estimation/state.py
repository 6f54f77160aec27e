# SPDX-License-Identifier: Apache-2.0
"""
The estimated state and its motion.

Battery temperature [deg C], state of charge (0 ... 1), and the logarithms of five factors: on the
vehicle file's heat capacity, leakage, resistance and HVCH efficiency, and on the route's propulsion
power. The equations are those of `vehicle.variants`.

Few vehicle files describe the heat path (`vehicle.description`), and a temperature in whole degrees
hardly distinguishes a lagging heater from coolant that has to warm up. One lag therefore stands for both:
heat that the heater has produced but that has not arrived, in kelvin of battery warming, arrives with a time
constant. The sensor follows the battery with another. Both are estimated as logarithms over a nominal lag.

The sensor sits in one spot: next to cells that Joule heat warms first, or next to the plate that the
heater warms. Its reading is the sensor's temperature plus a local rise, which follows both heats with a time
constant of 100 s; the steady rises [K/kW] are estimated.

Of a battery with a shell (`vehicle.heated_step`) the temperature is the core's, heat under way is the shell's
excess, the heat's lag is that between the two masses, and the sensor follows its place in shell or core.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import array_exp, ARRAYS, mean_magnitude
from bev_preheat.tunables import LOCAL_LAG_S, NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S
from bev_preheat.vehicle.variants import DriveInputs, Lagging, make_drive_rates, make_lagging_step

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.vehicle.description import HeatPath, Vehicle

(TEMPERATURE, SOC, HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION, HEAT_LAG, SENSOR_LAG,
 JOULE_RISE, HEATER_RISE, UNDER_WAY, SENSOR, LOCAL) = range(14)
SIZE = 14
FACTORS = slice(HEAT_CAPACITY, PROPULSION + 1)
# The elements that move with time; all others are random walks.
MOVING = (TEMPERATURE, SOC, UNDER_WAY, SENSOR, LOCAL)
FACTOR_NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion_power')
# Perturbation of each element for finite-difference slopes.
PERTURBATION = np.array(
    [0.01, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01, 0.01, 0.01])


def nominal_heat_lag_s(path: HeatPath) -> float:
    """Return the lag of the heat [s] whose logarithm is 0; of a shell it is the vehicle file's."""
    return path.coolant_lag_s if path.is_shell else NOMINAL_HEAT_LAG_S


def state_rates(vehicle: Vehicle, state: FloatArray,
                drive: DriveInputs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (dT/dt [K/s], d soc/dt [1/s], Joule heat [W]) of states (..., SIZE) in DriveInputs, arrays (...)."""
    factors = np.moveaxis(array_exp(state[..., FACTORS]), -1, 0)
    return make_drive_rates(vehicle, ARRAYS, mean_magnitude)(
        state[..., TEMPERATURE], state[..., SOC], factors, drive)


def moved(vehicle: Vehicle, state: FloatArray, drive: DriveInputs,
          duration_s: float) -> FloatArray:
    """
    Return temperature, state of charge, heat under way, sensor and local rise after a step, shape (..., 5).

    Of states (..., SIZE) in DriveInputs, arrays (...).
    """
    heat_lag_s = nominal_heat_lag_s(vehicle.heat_path) * array_exp(state[..., HEAT_LAG])
    sensor_lag_s = NOMINAL_SENSOR_LAG_S * array_exp(state[..., SENSOR_LAG])
    lagging = Lagging(
        state[..., TEMPERATURE], state[..., SOC], state[..., UNDER_WAY], state[..., SENSOR], state[..., LOCAL],
        heat_lag_s, sensor_lag_s, array_exp(-duration_s / heat_lag_s), array_exp(-duration_s / sensor_lag_s),
        math.exp(-duration_s / LOCAL_LAG_S), array_exp(state[..., HEATER] - state[..., HEAT_CAPACITY]),
        state[..., JOULE_RISE], state[..., HEATER_RISE])
    return np.stack(make_lagging_step(vehicle)(
        lagging, state_rates(vehicle, state, drive), drive.heater_power_w, duration_s), axis=-1)


def moved_with_slopes(vehicle: Vehicle, state: FloatArray, drive: DriveInputs,
                      duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the result of `moved` for states (..., SIZE), and its slopes (..., 5, SIZE)."""
    after = moved(vehicle, _along_each_element(state), drive, duration_s)
    return after[..., 0, :], np.swapaxes(
        (after[..., 1:, :] - after[..., :1, :]) / PERTURBATION[:, np.newaxis], -1, -2)


def _along_each_element(state: FloatArray) -> FloatArray:
    """Return states (..., SIZE) and their perturbations along each element: (..., SIZE + 1, SIZE)."""
    along = np.repeat(state[..., np.newaxis, :], SIZE + 1, axis=-2)
    index = np.arange(SIZE)
    along[..., index + 1, index] += PERTURBATION
    return along


def rates_and_slopes(vehicle: Vehicle, state: FloatArray,
                     drive: DriveInputs) -> tuple[FloatArray, FloatArray]:
    """
    Return the rates of states (..., SIZE), shape (..., 2), and their slopes (..., 2, SIZE).

    The rates are those of temperature and state of charge. DriveInputs of arrays must have the shape
    (..., 1), which broadcasts over the perturbations of each state.
    """
    rates = np.stack(state_rates(vehicle, _along_each_element(state), drive)[:2], axis=-2)
    slopes = (rates[..., 1:] - rates[..., :1]) / PERTURBATION
    return rates[..., 0], slopes
