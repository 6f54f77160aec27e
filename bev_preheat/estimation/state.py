# SPDX-License-Identifier: Apache-2.0
"""
The state that is estimated, and how it moves.

Battery temperature [deg C], state of charge (0 ... 1), and the logarithms of five factors: on the
vehicle file's heat capacity, leakage, resistance and HVCH efficiency, and on the propulsion power
that the route foresees. The equations are those of `model`, for a vehicle whose quantities are
arrays (`vehicle.corrections`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import AnyNumber, ARRAYS
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.vehicle.corrections import corrected_vehicle, Corrections
from bev_preheat.vehicle.model import make_rates

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

TEMPERATURE, SOC, HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION = range(7)
SIZE = 7
FACTORS = slice(HEAT_CAPACITY, SIZE)
FACTOR_NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion_power')
# By how much each element is moved to see what depends on it.
PERTURBATION = np.array([0.01, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3])


@dataclass(frozen=True)
class DriveInputs:
    """
    What the car does in one step, floats or arrays: the inputs of the model before they are summed.

    `propulsion_power_w` (mean), `power_variance_w2` and `propulsion_power_magnitude_w` (mean of
    |P|) are the route's, cabin and auxiliaries too.
    `terminal_power_w` is what the battery was seen to give; None where only the route is known.
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


def state_rates(vehicle: Vehicle, state: FloatArray,
                drive: DriveInputs) -> tuple[FloatArray, FloatArray]:
    """
    Return (dT/dt [K/s], d soc/dt [1/s]) of states (..., SIZE) in DriveInputs, arrays (...).

    Where the battery's power was seen, the propulsion power is what it leaves of it; else it is the
    route's, times its factor.
    """
    factors = np.exp(state[..., FACTORS])
    heat_capacity, leakage, resistance, heater_efficiency, propulsion = np.moveaxis(factors, -1, 0)
    car = corrected_vehicle(vehicle, Corrections(
        heat_capacity, leakage, resistance, heater_efficiency))
    others_w = drive.cabin_heating_power_w + drive.auxiliary_power_w + drive.heater_power_w
    if drive.terminal_power_w is None:
        propulsion_w = propulsion * drive.propulsion_power_w
        terminal_w, variance_w2 = propulsion_w + others_w, propulsion**2 * drive.power_variance_w2
        magnitude_w = propulsion * drive.propulsion_power_magnitude_w
    else:
        terminal_w, variance_w2 = drive.terminal_power_w, drive.power_variance_w2
        magnitude_w = mean_magnitude(terminal_w - others_w, variance_w2)
    leakage_w_per_k = car.battery.leakage.coefficient_w_per_k(drive.speed_mps)
    heat_w = (car.hvch.efficiency * drive.heater_power_w
              + leakage_w_per_k * drive.ambient_temperature_c
              + car.drivetrain.heat_to_battery_w(magnitude_w))
    soc_rate, temperature_rate, _ = make_rates(car, ARRAYS)(
        state[..., SOC], state[..., TEMPERATURE], terminal_w, variance_w2, heat_w,
        leakage_w_per_k)
    return temperature_rate, soc_rate


def rates_and_slopes(vehicle: Vehicle, state: FloatArray,
                     drive: DriveInputs) -> tuple[FloatArray, FloatArray]:
    """
    Return the rates of states (..., SIZE), shape (..., 2), and their slopes (..., 2, SIZE).

    The rates are those of temperature and state of charge. DriveInputs of arrays must have the shape
    (..., 1): each state is moved along each of its elements, and those stand beside each other.
    """
    moved = np.repeat(state[..., np.newaxis, :], SIZE + 1, axis=-2)
    index = np.arange(SIZE)
    moved[..., index + 1, index] += PERTURBATION
    rates = np.stack(state_rates(vehicle, moved, drive), axis=-2)
    slopes = (rates[..., 1:] - rates[..., :1]) / PERTURBATION
    return rates[..., 0], slopes
