# SPDX-License-Identifier: Apache-2.0
"""
Prior knowledge of a car before its first battery state, from its file alone or from earlier drives.

A parked battery approaches ambient temperature with the time constant C / gamma(0). The remaining difference
depends on the temperature at parking, if known, and on leakage and heat capacity, which the vehicle file gives
approximately. The route's ambient temperature is a forecast.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.estimation.estimate import (
    HEAT_CAPACITY,
    HEAT_LAG,
    HEATER,
    JOULE_RISE,
    LEAKAGE,
    nominal_heat_lag_s,
    PROPULSION,
    RESISTANCE,
    SENSOR_LAG,
    SENSOR_PLACE,
    SOURCE_HEAT,
)
from bev_preheat.estimation.hypotheses import PLACE_DEVIATIONS, PLACE_LAG_DEVIATIONS, PLACE_LAGS_S, PLACES
from bev_preheat.numerics import FloatArray, frozen
from bev_preheat.tunables import (
    AMBIENT_DEVIATION_K,
    DESCRIBED_LAG_DEVIATION,
    DESCRIBED_PLACE_DEVIATION,
    ELSEWHERE_SHARE,
    ELSEWHERE_WITHIN_K,
    KNOWN_PARKED_DEVIATION_K,
    KNOWN_TIME_CONSTANT_DEVIATION,
    LAG_DEVIATION,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    OFFSET_DEVIATION_K,
    PARKED_DEVIATION_K,
    PARKED_WARMER_K,
    SHELL_LAG_DEVIATION,
    UNMEASURED_LEAKAGE_DEVIATION,
)
from bev_preheat.vehicle.description import HeatPath, Uncertainty, UNKNOWN_UNCERTAINTY, Vehicle

# Prior standard deviations of the factors' logarithms, for a file that was not measured on this car: uniform over
# +-10 % (heat capacity, heater) and +-20 % (resistance); leakage between an insulated and a bare pack, which
# differ by a factor of three: ln 3 / sqrt(12). Propulsion: a route's consumption. Other sources: a heat pump's
# data sheet knows no frost, no pipes and no wear.
FACTOR_DEVIATIONS = {HEAT_CAPACITY: 0.058, LEAKAGE: 0.32, RESISTANCE: 0.115, HEATER: 0.058,
                     PROPULSION: 0.08, SOURCE_HEAT: 0.1}
# The least that counts if a file states its own: half of +-10, 20, 20 and 5 %, the best for nine i3 drives, each
# left out. The factors also stand for ageing and other errors that no log shows.
LEAST_DEVIATIONS = {HEAT_CAPACITY: 0.029, LEAKAGE: 0.0575, RESISTANCE: 0.0575, HEATER: 0.0145, SOURCE_HEAT: 0.03}
# Bounds of the logarithms, relative to the vehicle file's values. Leakage: a file may take an insulated pack as
# bare, or a bare pack as insulated; the two differ by a factor of three.
FACTOR_BOUNDS = {HEAT_CAPACITY: 0.25, LEAKAGE: 1.2, RESISTANCE: 0.6, HEATER: 0.15,
                 PROPULSION: 0.5, SOURCE_HEAT: 0.4}
LAGS = (HEAT_LAG, SENSOR_LAG)
NOMINAL_LAGS_S = np.array([NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S])
# Shortest and longest lag [s]: heater up to 90 s, coolant up to 200 s, a shell of 65 kJ/K at 55 W/K up to
# 1180 s (with 600 s its heater counts as derated); sensor up to 120 s.
LAG_RANGES_S = {HEAT_LAG: (2.0, 1200.0), SENSOR_LAG: (2.0, 150.0)}
# Bounds of the lags' logarithms, in the order of LAGS.
LAG_BOUNDS = np.log(np.array([LAG_RANGES_S[index] for index in LAGS]) / NOMINAL_LAGS_S[:, np.newaxis])
# The sensor: rise above its cell by Joule heat [K/kW], and its place (`estimate`), which a file may describe.
# The nine measured drives of an i3 show 0.48 K/kW of Joule heat; a sensor in the middle of a module shows none.
PLACING = (JOULE_RISE, SENSOR_PLACE)
PLACING_BOUNDS = np.array([(0.0, 1.0), (0.0, 12.0)])


def described_placing(path: HeatPath) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (places, 2) of the elements in PLACING for a HeatPath."""
    rise, rise_deviation, places, deviations = 0.35, 0.4, np.array(PLACES), np.array(PLACE_DEVIATIONS)
    if path.is_shell:
        places = np.full(len(PLACES), path.sensor_rise)
        deviations = DESCRIBED_PLACE_DEVIATION * np.maximum(places - 1.0, 0.0)
        if path.sensor_rise > 1.0:
            # Joule heat warms the cells of the core, and not the shell before them.
            rise, rise_deviation = 0.0, 0.1
    return (np.stack((np.full(len(PLACES), rise), places), axis=-1),
            np.square(np.stack((np.full(len(PLACES), rise_deviation), deviations), axis=-1)))


def lags_of_places() -> tuple[FloatArray, FloatArray]:
    """Return means and variances (places, 2) of the lags of a car whose file has none, as in LAGS."""
    heat = np.log(np.array(PLACE_LAGS_S) / NOMINAL_HEAT_LAG_S)
    return (np.stack((heat, np.zeros(len(PLACES))), axis=-1),
            np.square(np.stack((PLACE_LAG_DEVIATIONS, np.full(len(PLACES), LAG_DEVIATION)), axis=-1)))


@dataclass(frozen=True, eq=False)
class Lags:
    """Logarithms of the lags relative to the nominal ones (2,), and their variances (2,), as LAGS; read-only."""

    logs: FloatArray
    variances: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        frozen(self.logs)
        frozen(self.variances)


def described_lags(path: HeatPath) -> Lags:
    """
    Return the Lags described by a HeatPath: heater plus coolant or shell, and sensor.

    Missing parts are unknown.
    """
    logs, variances = np.zeros(2), np.full(2, LAG_DEVIATION**2)
    nominal_s = nominal_heat_lag_s(path), NOMINAL_SENSOR_LAG_S
    for at, lag_s in enumerate((path.heat_lag_s, path.sensor_lag_s)):
        if lag_s > 0.0:
            low, high = LAG_BOUNDS[at]
            logs[at] = min(max(math.log(lag_s / nominal_s[at]), low), high)
            is_shell = path.is_shell and at == 0
            variances[at] = (SHELL_LAG_DEVIATION if is_shell else DESCRIBED_LAG_DEVIATION)**2
    return Lags(logs, variances)


@dataclass(frozen=True, eq=False)
class Learned:
    """
    Learned values of a car; read-only.

    Logarithms of the factors (6,) and their covariance (6, 6), in the state's order; its Lags,
    None if they were not learned.
    """

    factors: FloatArray
    covariance: FloatArray
    lags: Lags | None = None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        frozen(self.factors)
        frozen(self.covariance)


def nothing_learned(uncertainty: Uncertainty = UNKNOWN_UNCERTAINTY) -> Learned:
    """Return the Learned of a car known only from its file, which may state its Uncertainty."""
    return Learned(np.zeros(len(FACTOR_DEVIATIONS)), prior_factor_covariance(uncertainty))


def prior_factor_covariance(uncertainty: Uncertainty = UNKNOWN_UNCERTAINTY) -> FloatArray:
    """Return the covariance (6, 6) of the factors' logarithms of a car known only from its file."""
    deviations = factor_deviations(uncertainty)
    return np.diag([deviations[index]**2
                    for index in (HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION, SOURCE_HEAT)])


def factor_deviations(uncertainty: Uncertainty) -> dict[int, float]:
    """
    Return the standard deviations of the factors' logarithms of a car known only from its file.

    A deviation of the file is limited to those in LEAST_DEVIATIONS ... FACTOR_DEVIATIONS.
    """
    stated = {HEAT_CAPACITY: uncertainty.heat_capacity, LEAKAGE: uncertainty.leakage,
              RESISTANCE: uncertainty.resistance, HEATER: uncertainty.heater_efficiency,
              SOURCE_HEAT: uncertainty.source_heat}
    return {index: assumed if (own := stated.get(index)) is None
            else min(max(own, LEAST_DEVIATIONS[index]), assumed)
            for index, assumed in FACTOR_DEVIATIONS.items()}


# Points and weights of a standard normal distribution: the share left is far from linear in the time constant.
POINTS, WEIGHTS = np.polynomial.hermite_e.hermegauss(15)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


class Soak(NamedTuple):
    """
    Expected battery temperature after a soak [deg C].

    `left_deviation_k` is the standard deviation [K] of the remaining difference to ambient;
    `ambient_deviation_k` [K] is that of the ambient temperature.
    """

    temperature_c: float
    left_deviation_k: float
    ambient_deviation_k: float = AMBIENT_DEVIATION_K

    @property
    def deviation_k(self) -> float:
        """Standard deviation of the temperature [K]."""
        return math.hypot(self.left_deviation_k, self.ambient_deviation_k)


def after_soak(vehicle: Vehicle, ambient_c: float, standing_s: float,
               parked_c: float | None = None) -> Soak:
    """
    Return the Soak of a vehicle's battery after `standing_s` [s] at an ambient temperature [deg C].

    `parked_c` is the battery temperature [deg C] at parking; None: unknown.
    """
    own = _time_constant_deviation(vehicle)
    warmer_k, deviation_k, time_constant_deviation = (
        (PARKED_WARMER_K, PARKED_DEVIATION_K, own) if parked_c is None
        else (parked_c - ambient_c, KNOWN_PARKED_DEVIATION_K, max(own, KNOWN_TIME_CONSTANT_DEVIATION)))
    time_constants = _time_constants(vehicle, standing_s)
    left = math.exp(-time_constants)
    lefts = np.exp(-time_constants * np.exp(time_constant_deviation * POINTS))
    return Soak(
        ambient_c + warmer_k * left,
        math.sqrt(float(WEIGHTS @ (warmer_k**2 * (lefts - left)**2 + deviation_k**2 * lefts**2))),
        # A battery seen a moment ago has not reached ambient temperature.
        AMBIENT_DEVIATION_K * (1.0 if parked_c is None else 1.0 - left))


def temperature_after(vehicle: Vehicle, parked_c: float, ambient_c: float, standing_s: float) -> float:
    """Return the temperature [deg C] of a battery `standing_s` [s] after parking at `parked_c` [deg C]."""
    return ambient_c + (parked_c - ambient_c) * math.exp(-_time_constants(vehicle, standing_s))


def _time_constant_deviation(vehicle: Vehicle) -> float:
    """Return the standard deviation of the time constant's logarithm, from those of the vehicle file."""
    deviations = factor_deviations(vehicle.uncertainty)
    is_assumed = 'battery.leakage' in vehicle.assumed and vehicle.uncertainty.leakage is None
    return math.hypot(deviations[HEAT_CAPACITY],
                      UNMEASURED_LEAKAGE_DEVIATION if is_assumed else deviations[LEAKAGE])


def _time_constants(vehicle: Vehicle, standing_s: float) -> float:
    rate_per_s = (vehicle.battery.leakage.coefficient_w_per_k(0.0)
                  / vehicle.pack_heat_capacity_j_per_k)
    return rate_per_s * standing_s


def expected_offset_k(standing: Soak, reading_c: float, reading_variance: float) -> float:
    """
    Return the expected offset of a sensor [K] (positive: it reads too warm).

    `reading_c` [deg C] is its reading after a Soak, `reading_variance` [K^2] the variance of its noise.
    A difference is shared between the sensor and the expected battery temperature, by
    their variances. The larger it is, the more likely the car stood elsewhere; then the sensor is
    trusted.
    """
    difference_k = reading_c - standing.temperature_c
    variance = OFFSET_DEVIATION_K**2 + standing.deviation_k**2 + reading_variance
    here = ((1.0 - ELSEWHERE_SHARE) * math.exp(-0.5 * difference_k**2 / variance)
            / math.sqrt(2.0 * math.pi * variance))
    elsewhere = ELSEWHERE_SHARE / ELSEWHERE_WITHIN_K
    return here / (here + elsewhere) * OFFSET_DEVIATION_K**2 / variance * difference_k
