# SPDX-License-Identifier: Apache-2.0
"""
The state that is estimated, and how it moves.

Battery temperature [deg C], state of charge (0 ... 1), and the logarithms of five factors: on the
vehicle file's heat capacity, leakage, resistance and HVCH efficiency, and on the propulsion power
that the route foresees. The equations are those of `model`, for a vehicle whose quantities are
arrays (`vehicle.corrections`).

Few vehicle files tell of the heat's path (`vehicle.heat_path`), and a temperature in whole degrees
hardly tells a heater that lags from coolant that has to get warm. So one lag stands for both: the
heater's heat that has not arrived, as the kelvin that it will bring, arrives with a time constant.
The sensor follows the battery with another. Both are estimated as logarithms, over a nominal lag.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import AnyNumber, array_exp, ARRAYS
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

(TEMPERATURE, SOC, HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION, HEAT_LAG, SENSOR_LAG,
 UNDER_WAY, SENSOR) = range(11)
SIZE = 11
FACTORS = slice(HEAT_CAPACITY, PROPULSION + 1)
# Lags [s] of which the logarithms are 0.
NOMINAL_HEAT_LAG_S = 40.0
NOMINAL_SENSOR_LAG_S = 20.0
# What moves with time; all else wanders.
MOVING = (TEMPERATURE, SOC, UNDER_WAY, SENSOR)
FACTOR_NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion_power')
# By how much each element is moved to see what depends on it.
PERTURBATION = np.array(
    [0.01, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.01, 0.01])


@dataclass(frozen=True)
class DriveInputs:
    """
    What the car does in one step, floats or arrays: the inputs of the model before they are summed.

    `propulsion_power_w` (mean), `power_variance_w2` and `propulsion_power_magnitude_w` (mean of
    |P|) are the route's, cabin and auxiliaries too.
    `terminal_power_w` is what the battery was seen to give; None where only the route is known.
    `power_variance_w2` is then what was seen, and `hidden_variance_w2` what the route says of the
    variation and the sensors do not show.
    `heater_power_w` is what the HVCH takes for the battery.
    """

    speed_mps: AnyNumber
    ambient_temperature_c: AnyNumber
    propulsion_power_w: AnyNumber
    power_variance_w2: AnyNumber
    propulsion_power_magnitude_w: AnyNumber
    cabin_heating_power_w: AnyNumber
    auxiliary_power_w: AnyNumber
    heater_power_w: AnyNumber
    terminal_power_w: AnyNumber = None
    hidden_variance_w2: AnyNumber = 0.0


def state_rates(vehicle: Vehicle, state: FloatArray,
                drive: DriveInputs) -> tuple[FloatArray, FloatArray]:
    """
    Return (dT/dt [K/s], d soc/dt [1/s]) of states (..., SIZE) in DriveInputs, arrays (...).

    Where the battery's power was seen, the propulsion power is what it leaves of it; else it is the
    route's, times its factor.
    """
    factors = array_exp(state[..., FACTORS])
    heat_capacity, leakage, resistance, heater_efficiency, propulsion = np.moveaxis(factors, -1, 0)
    car = corrected_vehicle(vehicle, Corrections(
        heat_capacity, leakage, resistance, heater_efficiency))
    others_w = drive.cabin_heating_power_w + drive.auxiliary_power_w + drive.heater_power_w
    if drive.terminal_power_w is None:
        propulsion_w = propulsion * drive.propulsion_power_w
        terminal_w, variance_w2 = propulsion_w + others_w, propulsion**2 * drive.power_variance_w2
        magnitude_w = propulsion * drive.propulsion_power_magnitude_w
    else:
        terminal_w = drive.terminal_power_w
        variance_w2 = drive.power_variance_w2 + drive.hidden_variance_w2
        # Of what is hidden the route knows how much of it drives, and how much regenerates.
        hidden = drive.hidden_variance_w2 / np.maximum(variance_w2, 1.0)
        magnitude_w = ((1.0 - hidden) * mean_magnitude(terminal_w - others_w, drive.power_variance_w2)
                       + hidden * propulsion * drive.propulsion_power_magnitude_w)
    leakage_w_per_k = car.battery.leakage.coefficient_w_per_k(drive.speed_mps)
    heat_w = (car.hvch.efficiency * drive.heater_power_w
              + leakage_w_per_k * drive.ambient_temperature_c
              + car.drivetrain.heat_to_battery_w(magnitude_w))
    soc_rate, temperature_rate, _ = make_rates(car, ARRAYS)(
        state[..., SOC], state[..., TEMPERATURE], terminal_w, variance_w2, heat_w,
        leakage_w_per_k)
    return temperature_rate, soc_rate


def moved(vehicle: Vehicle, state: FloatArray, drive: DriveInputs,
          duration_s: float) -> FloatArray:
    """
    Return temperature, state of charge, heat under way and sensor after a step, shape (..., 4).

    Of states (..., SIZE) in DriveInputs, arrays (...). The lags are solved within the step
    (vehicle.heat_path has the equations), as they may be shorter.
    """
    temperature_rate, soc_rate = state_rates(vehicle, state, drive)
    made_k = duration_s * (
        array_exp(state[..., HEATER] - state[..., HEAT_CAPACITY]) * vehicle.hvch.efficiency
        / vehicle.battery.heat_capacity_j_per_k * drive.heater_power_w)
    heat_lag_s = NOMINAL_HEAT_LAG_S * array_exp(state[..., HEAT_LAG])
    sensor_lag_s = NOMINAL_SENSOR_LAG_S * array_exp(state[..., SENSOR_LAG])
    left = array_exp(-duration_s / heat_lag_s)
    under_way_k = (state[..., UNDER_WAY] * left
                   + made_k * heat_lag_s / duration_s * (1.0 - left))
    warmer_k = duration_s * temperature_rate - (under_way_k - state[..., UNDER_WAY])
    behind_k = warmer_k * sensor_lag_s / duration_s
    end_c = state[..., TEMPERATURE] + warmer_k
    sensor_c = end_c - behind_k + (
        state[..., SENSOR] - state[..., TEMPERATURE] + behind_k) * array_exp(-duration_s / sensor_lag_s)
    return np.stack((end_c, state[..., SOC] + duration_s * soc_rate, under_way_k, sensor_c), axis=-1)


def moved_with_slopes(vehicle: Vehicle, state: FloatArray, drive: DriveInputs,
                      duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Return what `moved` does of states (..., SIZE), and its slopes (..., 4, SIZE)."""
    after = moved(vehicle, _along_each_element(state), drive, duration_s)
    return after[..., 0, :], np.swapaxes(
        (after[..., 1:, :] - after[..., :1, :]) / PERTURBATION[:, np.newaxis], -1, -2)


def _along_each_element(state: FloatArray) -> FloatArray:
    """Return states (..., SIZE), and each moved along each of its elements: (..., SIZE + 1, SIZE)."""
    along = np.repeat(state[..., np.newaxis, :], SIZE + 1, axis=-2)
    index = np.arange(SIZE)
    along[..., index + 1, index] += PERTURBATION
    return along


def rates_and_slopes(vehicle: Vehicle, state: FloatArray,
                     drive: DriveInputs) -> tuple[FloatArray, FloatArray]:
    """
    Return the rates of states (..., SIZE), shape (..., 2), and their slopes (..., 2, SIZE).

    The rates are those of temperature and state of charge. DriveInputs of arrays must have the shape
    (..., 1): each state is moved along each of its elements, and those stand beside each other.
    """
    rates = np.stack(state_rates(vehicle, _along_each_element(state), drive), axis=-2)
    slopes = (rates[..., 1:] - rates[..., :1]) / PERTURBATION
    return rates[..., 0], slopes
