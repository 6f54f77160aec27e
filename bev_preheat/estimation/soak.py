# SPDX-License-Identifier: Apache-2.0
"""
Battery temperature after a soak, and the offset of a sensor that reads something else.

A parked battery approaches ambient temperature with the time constant C / gamma(0). The remaining difference
depends on the temperature at parking, if known, and on leakage and heat capacity, which the vehicle file gives
approximately. The route's ambient temperature is a forecast.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.prior import factor_deviations
from bev_preheat.estimation.state import HEAT_CAPACITY, LEAKAGE
from bev_preheat.tunables import (
    AMBIENT_DEVIATION_K,
    ELSEWHERE_SHARE,
    ELSEWHERE_WITHIN_K,
    KNOWN_PARKED_DEVIATION_K,
    KNOWN_TIME_CONSTANT_DEVIATION,
    OFFSET_DEVIATION_K,
    PARKED_DEVIATION_K,
    PARKED_WARMER_K,
    UNMEASURED_LEAKAGE_DEVIATION,
)

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

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
