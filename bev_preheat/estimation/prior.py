# SPDX-License-Identifier: Apache-2.0
"""Prior knowledge of a car before its first battery state, from its file alone or from earlier drives."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.state import (
    HEAT_CAPACITY,
    HEAT_LAG,
    HEATER,
    HEATER_RISE,
    JOULE_RISE,
    LEAKAGE,
    nominal_heat_lag_s,
    PROPULSION,
    RESISTANCE,
    SENSOR_LAG,
)
from bev_preheat.numerics import FloatArray, frozen
from bev_preheat.tunables import (
    DESCRIBED_LAG_DEVIATION,
    LAG_DEVIATION,
    LEAST_NARROWING,
    NOMINAL_HEAT_LAG_S,
    NOMINAL_SENSOR_LAG_S,
    SHELL_LAG_DEVIATION,
)
from bev_preheat.vehicle.description import UNKNOWN_UNCERTAINTY

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import HeatPath, Uncertainty

# Prior standard deviation of the factors' logarithms: those of uniform distributions over +-10 % (heat
# capacity), +-20 % (leakage, resistance), +-5 % (heater), and of a route's consumption.
FACTOR_DEVIATIONS = {HEAT_CAPACITY: 0.058, LEAKAGE: 0.115, RESISTANCE: 0.115, HEATER: 0.029,
                     PROPULSION: 0.08}
# Bounds of the logarithms, relative to the vehicle file's values. Leakage: a file may take an insulated pack as
# bare, or a bare pack as insulated; the two differ by a factor of three.
FACTOR_BOUNDS = {HEAT_CAPACITY: 0.25, LEAKAGE: 1.2, RESISTANCE: 0.6, HEATER: 0.15, PROPULSION: 0.5}
LAGS = (HEAT_LAG, SENSOR_LAG)
NOMINAL_LAGS_S = np.array([NOMINAL_HEAT_LAG_S, NOMINAL_SENSOR_LAG_S])
# Shortest and longest lag [s]: heater up to 90 s and coolant up to 200 s; sensor up to 120 s.
LAG_RANGES_S = {HEAT_LAG: (2.0, 250.0), SENSOR_LAG: (2.0, 150.0)}
# Bounds of the lags' logarithms, in the order of LAGS.
LAG_BOUNDS = np.log(np.array([LAG_RANGES_S[index] for index in LAGS]) / NOMINAL_LAGS_S[:, np.newaxis])
# Rise of the sensor above its cell [K/kW] by Joule heat and by heater heat: mean, standard deviation
# and bounds of each. The nine measured drives of an i3 show 0.48 K/kW of Joule heat; a sensor in the middle of
# a module shows none. A shell of a fifth of the battery, at 1500 W/K, gets 0.5 K/kW warmer than its core.
RISES = (JOULE_RISE, HEATER_RISE)
RISES_K_PER_KW = np.array([0.35, 0.0])
RISE_DEVIATIONS = np.array([0.4, 0.25])
RISE_BOUNDS = np.array([(0.0, 1.0), (-0.8, 0.8)])


@dataclass(frozen=True, eq=False)
class Lags:
    """Logarithms of the lags relative to the nominal ones (2,), and their variances (2,), as LAGS; read-only."""

    logs: FloatArray
    variances: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        frozen(self.logs)
        frozen(self.variances)


def unknown_lags() -> Lags:
    """Return the Lags of an unknown car."""
    return Lags(np.zeros(2), np.full(2, LAG_DEVIATION**2))


def described_lags(path: HeatPath) -> Lags:
    """
    Return the Lags described by a HeatPath: heater plus coolant or shell, and sensor.

    Missing parts are unknown.
    """
    logs, variances = np.zeros(2), unknown_lags().variances.copy()
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

    Logarithms of the factors (5,) and their covariance (5, 5), in the order of `state`; its Lags,
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
    """Return the covariance (5, 5) of the factors' logarithms of a car known only from its file."""
    deviations = factor_deviations(uncertainty)
    return np.diag([deviations[index]**2
                    for index in (HEAT_CAPACITY, LEAKAGE, RESISTANCE, HEATER, PROPULSION)])


def factor_deviations(uncertainty: Uncertainty) -> dict[int, float]:
    """
    Return the standard deviations of the factors' logarithms of a car known only from its file.

    A deviation of the file is limited to LEAST_NARROWING ... 1 times that in FACTOR_DEVIATIONS.
    """
    stated = {HEAT_CAPACITY: uncertainty.heat_capacity, LEAKAGE: uncertainty.leakage,
              RESISTANCE: uncertainty.resistance, HEATER: uncertainty.heater_efficiency}
    return {index: assumed if (own := stated.get(index)) is None
            else min(max(own, LEAST_NARROWING * assumed), assumed)
            for index, assumed in FACTOR_DEVIATIONS.items()}
