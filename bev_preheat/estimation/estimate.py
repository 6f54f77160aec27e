# SPDX-License-Identifier: Apache-2.0
"""
The estimate of the battery and its car: the elements of the estimated state, and their motion.

Battery temperature [deg C], state of charge (0 ... 1), and the logarithms of six factors: on the vehicle
file's heat capacity, leakage, resistance and HVCH efficiency, on the route's propulsion power, and on the heat
that other sources give for each watt, beside the HVCH's factor. An Estimate has mean and covariance of these
elements. The equations are those of `vehicle.variants`.

Few vehicle files describe the heat path or the battery's shell (both: `vehicle.heat_path`),
and readings hardly distinguish a lagging heater, coolant that has to warm up, and a shell. One lag therefore
stands for all: heat that has not arrived in the core, in kelvin of battery warming, arrives with a time constant.
The sensor follows its place with another. Both are estimated as logarithms over a nominal lag. The sensor's place
is warmer than the core by `SENSOR_PLACE` times the heat under way: 0 in the core, 1 at the mean of shell and core,
and one over the shell's share on the shell.

Next to cells that Joule heat warms first, the reading is the sensor's temperature plus a local rise, which follows
that heat with a time constant of 100 s; the steady rise [K/kW] is estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
import math

import numpy as np

from bev_preheat.estimation.hypotheses import HeaterReport
from bev_preheat.numerics import array_exp, ARRAYS, FloatArray, frozen, mean_magnitude
from bev_preheat.tunables import (
    LOCAL_LAG_S,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    OUTSIDE_LAG_S,
    UNSEEN_SHELL_RISE,
)
from bev_preheat.vehicle.description import DIRECT, HeatPath, Vehicle
from bev_preheat.vehicle.variants import Corrections, DriveInputs, Lagging, make_drive_rates, make_lagging_step

(TEMPERATURE, SOC, HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION, SOURCE_HEAT, HEAT_LAG, SENSOR_LAG,
 JOULE_RISE, SENSOR_PLACE, UNDER_WAY, SENSOR, LOCAL) = range(15)
SIZE = 15
FACTORS = slice(HEAT_CAPACITY, SOURCE_HEAT + 1)
# The factors of the car, in the order of Corrections; that of the propulsion power belongs to a route.
OF_CAR = (HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, SOURCE_HEAT)
# The elements that move with time; all others are random walks.
MOVING = (TEMPERATURE, SOC, UNDER_WAY, SENSOR, LOCAL)
FACTOR_NAMES = ('heat_capacity', 'leakage', 'resistance', 'heater_efficiency', 'propulsion_power', 'source_heat')
# Perturbation of each element for finite-difference slopes.
PERTURBATION = np.array(
    [0.01, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01, 0.01, 0.01])


def nominal_heat_lag_s(path: HeatPath) -> float:
    """Return the lag of the heat [s] whose logarithm is 0; of a shell it is the vehicle file's."""
    return path.coolant_lag_s if path.is_shell else NOMINAL_HEAT_LAG_S


def outside_lag_s(path: HeatPath) -> float:
    """Return the most lag of heat outside a battery whose shell is not described [s]; endless if its path is."""
    return OUTSIDE_LAG_S if path.is_direct else math.inf


def share_in_battery(path: HeatPath, state: FloatArray) -> FloatArray:
    """
    Return the share (...) of the heat under way in states (..., SIZE) that is in the battery, but not in its core.

    A described path says where its heat is: none counts. Else heater and coolant delay the heat by
    OUTSIDE_LAG_S at most; parts of the battery that warm before the core do the rest. Heat that warms the
    sensor before the core is in the battery.
    """
    lag_s = nominal_heat_lag_s(path) * array_exp(state[..., HEAT_LAG])
    share: FloatArray = np.maximum(
        1.0 - outside_lag_s(path) / (1.0 + np.maximum(state[..., SENSOR_PLACE], 0.0)) / lag_s, 0.0)
    return share


def shell_excess_k(path: HeatPath, state: FloatArray) -> FloatArray:
    """
    Return the temperature of the shell above the core's [K] in states (..., SIZE), shape (...).

    Of a shell that is not described, that of the sensor, and at least UNSEEN_SHELL_RISE times the heat under
    way in the battery: a sensor in the core does not show it.
    """
    rise = 1.0 / path.shell_share if path.is_shell else np.maximum(
        state[..., SENSOR_PLACE], UNSEEN_SHELL_RISE * share_in_battery(path, state))
    excess_k: FloatArray = rise * state[..., UNDER_WAY]
    return excess_k


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
        math.exp(-duration_s / LOCAL_LAG_S), state[..., JOULE_RISE], state[..., SENSOR_PLACE])
    return np.stack(make_lagging_step(vehicle)(
        lagging, state_rates(vehicle, state, drive), array_exp(state[..., HEAT_CAPACITY]), duration_s), axis=-1)


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


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    The estimate of the battery at an instant [ns].

    `mean` (SIZE,) and `covariance` (SIZE, SIZE) are those of the elements of the state.

    `heater` is the report on the heater's response, `temperature_resolution_k` the step of the temperature
    signal (0: continuous), `resets` the number of resets, with the reason and instant of the last one.
    `sensor_offset_k` is subtracted from the readings [K], `ignored_share` (0 ... 1) is the share of the
    latest readings rejected as outliers. `path` is the vehicle's HeatPath.
    """

    stamp_ns: int
    mean: FloatArray
    covariance: FloatArray
    heater: HeaterReport
    temperature_resolution_k: float
    resets: int = 0
    reset_reason: str = ''
    reset_at_ns: int | None = None
    sensor_offset_k: float = 0.0
    ignored_share: float = 0.0
    path: HeatPath = DIRECT

    def stood_until(self, temperature_c: float) -> Estimate:
        """Return the Estimate after the battery has stood until it reaches a temperature [deg C]."""
        mean = self.mean.copy()
        mean[TEMPERATURE] = mean[SENSOR] = temperature_c
        mean[UNDER_WAY] = 0.0
        return replace(self, mean=mean)

    def mixed_with(self, others: Sequence[tuple[float, Estimate]], odds: float) -> Estimate:
        """Return the Estimate of a mixture with (odds, Estimate) of others; `odds` are its own."""
        if not others:
            return self
        weights = np.array([odds, *(own for own, _ in others)])
        weights /= weights.sum()
        means = np.array([self.mean, *(other.mean for _, other in others)])
        mean = weights @ means
        off = means - mean
        covariance = np.tensordot(weights, [self.covariance, *(other.covariance for _, other in others)], 1)
        return replace(self, mean=frozen(mean), covariance=frozen(covariance + (weights * off.T) @ off))

    @property
    def log_factors(self) -> FloatArray:
        """Return the logarithms of the factors (6,), in the state's order."""
        return self.mean[FACTORS]

    @property
    def temperature_c(self) -> float:
        """Battery temperature [deg C]."""
        return self.mean.item(TEMPERATURE)

    @property
    def temperature_deviation_k(self) -> float:
        """Standard deviation of the battery temperature [K]."""
        return math.sqrt(max(self.covariance.item(TEMPERATURE, TEMPERATURE), 0.0))

    @property
    def settled_deviation_k(self) -> float:
        """Standard deviation of the battery temperature once the heat under way has arrived [K]."""
        covariance = self.covariance.item
        return math.sqrt(max(
            covariance(TEMPERATURE, TEMPERATURE) + covariance(UNDER_WAY, UNDER_WAY)
            + 2.0 * covariance(TEMPERATURE, UNDER_WAY), 0.0))

    @property
    def under_way_k(self) -> float:
        """Rise of the core's temperature still to come from heat that the heater has already produced [K]."""
        return max(self.mean.item(UNDER_WAY), 0.0)

    @property
    def sensor_excess_k(self) -> float:
        """Temperature of the sensor's place above the core's [K]."""
        return self.mean.item(SENSOR_PLACE) * self.mean.item(UNDER_WAY)

    @property
    def shell_excess_k(self) -> float:
        """Temperature of the shell above the core's [K]."""
        return float(shell_excess_k(self.path, self.mean))

    @property
    def heat_lag_s(self) -> float:
        """Lag of the heater's heat until it is in the core [s]."""
        return nominal_heat_lag_s(self.path) * math.exp(self.mean.item(HEAT_LAG))

    @cached_property
    def share_in_battery(self) -> float:
        """Share of the heat under way that is in the battery already, and not yet in its core (0 ... 1)."""
        return float(share_in_battery(self.path, self.mean))

    @property
    def planned_temperature_c(self) -> float:
        """Battery temperature of the plans [deg C]: of a shell that is described, the core's; else the mean."""
        return self.mean.item(TEMPERATURE) + self.share_in_battery * self.under_way_k

    @property
    def outside_k(self) -> float:
        """Rise of `planned_temperature_c` still to come from heat that the heater has already produced [K]."""
        return (1.0 - self.share_in_battery) * self.under_way_k

    @property
    def outside_lag_s(self) -> float:
        """Lag of the heater's heat until it raises `planned_temperature_c` [s]."""
        return (1.0 - self.share_in_battery) * self.heat_lag_s

    @property
    def later_heat_s(self) -> float:
        """By how much `outside_lag_s` grows if it is off by a standard deviation [s]."""
        deviation = math.sqrt(max(self.covariance.item(HEAT_LAG, HEAT_LAG), 0.0))
        return self.outside_lag_s * math.expm1(deviation)

    @property
    def sensor_lag_s(self) -> float:
        """Lag of the temperature sensor [s]."""
        return NOMINAL_SENSOR_LAG_S * math.exp(self.mean.item(SENSOR_LAG))

    @property
    def soc(self) -> float:
        """State of charge, 0 ... 1."""
        return min(max(self.mean.item(SOC), 0.0), 1.0)

    @property
    def corrections(self) -> Corrections:
        """Corrections of the vehicle file."""
        return Corrections(*(math.exp(value) for value in self.mean[[*OF_CAR]]))

    @property
    def propulsion_factor(self) -> float:
        """Propulsion power of the car as a multiple of the route's."""
        return math.exp(self.mean.item(PROPULSION))

    @property
    def factor_deviations(self) -> FloatArray:
        """Return the relative standard deviations of the six factors, in the state's order."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[FACTORS], 0.0))
