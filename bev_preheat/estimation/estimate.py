# SPDX-License-Identifier: Apache-2.0
"""The estimate of the battery and its car."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.hypotheses import HeaterReport
from bev_preheat.estimation.state import (
    FACTORS,
    HEAT_LAG,
    nominal_heat_lag_s,
    PROPULSION,
    SENSOR,
    SENSOR_LAG,
    SOC,
    TEMPERATURE,
    UNDER_WAY,
)
from bev_preheat.tunables import NOMINAL_SENSOR_LAG_S
from bev_preheat.vehicle.description import DIRECT, HeatPath
from bev_preheat.vehicle.variants import Corrections

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    The estimate of the battery at an instant [ns].

    `mean` (SIZE,) and `covariance` (SIZE, SIZE) are those of the elements of `state`.

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

    @property
    def log_factors(self) -> FloatArray:
        """Return the logarithms of the factors (5,), in the order of `state`."""
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
        """Temperature rise still to come from heat that the heater has already produced [K]."""
        return max(self.mean.item(UNDER_WAY), 0.0)

    @property
    def shell_excess_k(self) -> float:
        """Temperature of the shell above the core's [K]; 0 without a shell."""
        return self.mean.item(UNDER_WAY) / self.path.shell_share if self.path.is_shell else 0.0

    @property
    def heat_lag_s(self) -> float:
        """Lag of the heater's heat [s]."""
        return nominal_heat_lag_s(self.path) * math.exp(self.mean.item(HEAT_LAG))

    def later_heat_s(self, deviations: float) -> float:
        """Return by how much the heat lag grows if it is off by `deviations` standard deviations [s]."""
        deviation = math.sqrt(max(self.covariance.item(HEAT_LAG, HEAT_LAG), 0.0))
        return self.heat_lag_s * math.expm1(deviations * deviation)

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
        return Corrections(*(math.exp(value) for value in self.mean[FACTORS][:4]))

    @property
    def propulsion_factor(self) -> float:
        """Propulsion power of the car as a multiple of the route's."""
        return math.exp(self.mean.item(PROPULSION))

    @property
    def factor_deviations(self) -> FloatArray:
        """Return the relative standard deviations of the five factors, in the order of `state`."""
        return np.sqrt(np.maximum(np.diag(self.covariance)[FACTORS], 0.0))
