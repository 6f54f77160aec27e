# SPDX-License-Identifier: Apache-2.0
"""
Temperature readings as intervals: residuals of a model's sensor temperature.

A reading of 5 in whole degrees says that the noisy temperature lay between 4.5 and 5.5. Readings that flicker
between two values say more than steady ones: their shares say how far the temperature is from the boundary. All
readings of a short window count together, with the temperature constant within it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import log_ndtr

from bev_preheat.numerics import FloatArray

# Standard deviation of sensor and model together, besides the rounding [K]: first guess, and range.
NOISE_K = 0.3
NOISE_RANGE_K = 0.1, 0.6
# A window whose readings are farther off than this many standard deviations counts linearly (Huber), so that a
# spike decides nothing.
HUBER_DEVIATIONS = 2.5
# Steps below this many standard deviations count as a continuous signal.
LEAST_HALF = 0.25
FARTHEST = 25.0
# Halvings of the interval in which the best temperature of a window lies.
WINDOW_HALVINGS = 40


@dataclass(frozen=True, eq=False)
class Readings:
    """
    Readings of K windows: `counts` (K, L) readings at `levels_c` (K, L) [deg C], in steps of `resolution_k`.

    Counts may be fractions; unused places have a count of 0. A resolution of 0 is a continuous signal.
    """

    levels_c: FloatArray
    counts: FloatArray
    resolution_k: float

    @property
    def total(self) -> FloatArray:
        """Return the number of readings in each window (K,)."""
        return np.asarray(self.counts.sum(axis=1))

    @property
    def mean_c(self) -> FloatArray:
        """Return the mean reading of each window (K,) [deg C]."""
        return np.asarray((self.counts * self.levels_c).sum(axis=1) / self.total)


class ReadingResiduals:
    """Residuals of Readings for one standard deviation of the noise."""

    def __init__(self, readings: Readings, noise_k: float = NOISE_K) -> None:
        """Find the temperature of each window that explains its readings best."""
        self._readings, self._noise_k = readings, noise_k
        self._half = 0.5 * readings.resolution_k / noise_k
        self._best_c = readings.mean_c
        self._least = np.zeros(len(self._best_c))
        self._curvature = np.ones(len(self._best_c))
        if self._half >= LEAST_HALF:
            self._best_c = self._bisected()
            self._least = self._cost(self._best_c)
            ahead, behind = (self._slope(self._best_c + change_k) for change_k in (1e-4, -1e-4))
            self._curvature = np.sqrt(np.maximum((ahead - behind) / 2e-4 / readings.total, 0.0)) * noise_k

    def __call__(self, model_c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """
        Return residuals (K,) of sensor temperatures (K,) [deg C], and their slopes over them [1/K].

        Half the square of a residual is the negative log-likelihood of the window's readings under independent
        normal noise, relative to the temperature that explains them best; for a continuous signal the residual is
        the scaled difference from their mean.
        """
        root = np.sqrt(self._readings.total)
        off = (model_c - self._best_c) / self._noise_k
        # Of one reading, so that the bound on the deviations is that of the readings.
        if self._half < LEAST_HALF:
            residual, slope = off, np.full_like(off, 1.0 / self._noise_k)
        else:
            magnitude = np.sqrt(np.maximum(2.0 * (self._cost(model_c) - self._least), 0.0)) / root
            is_far = magnitude > 1e-3
            steep = np.abs(self._slope(model_c)) / root**2 / np.maximum(magnitude, 1e-3)
            # Near the best temperature the slope is that of the parabola there.
            residual = np.copysign(np.where(is_far, magnitude, self._curvature * np.abs(off)), off)
            slope = np.where(is_far, steep, self._curvature / self._noise_k)
        beyond = np.abs(residual) > HUBER_DEVIATIONS
        limited = np.sqrt(np.maximum(2.0 * HUBER_DEVIATIONS * np.abs(residual) - HUBER_DEVIATIONS**2, 1e-12))
        return (root * np.where(beyond, np.copysign(limited, residual), residual),
                root * np.where(beyond, slope * HUBER_DEVIATIONS / limited, slope))

    def cost(self, model_c: FloatArray) -> float:
        """Return the negative log-likelihood of all readings at sensor temperatures (K,) [deg C]."""
        residual, _ = self(model_c)
        log_noise = np.log(self._noise_k) * self._readings.total if self._half < LEAST_HALF else 0.0
        return float(np.sum(0.5 * residual**2 + self._least + log_noise))

    def _parts(self, model_c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return scaled distances to the levels (K, L), signed and limited, and the logarithms of their shares."""
        off = (model_c[:, np.newaxis] - self._readings.levels_c) / self._noise_k
        # Beyond this the logarithms lose their digits; such readings count linearly anyway.
        distance = np.minimum(np.abs(off), self._half + FARTHEST)
        upper, lower = log_ndtr(self._half - distance), log_ndtr(-self._half - distance)
        return off, distance, np.asarray(upper + np.log1p(-np.exp(lower - upper)))

    def _cost(self, model_c: FloatArray) -> FloatArray:
        return np.asarray(-(self._readings.counts * self._parts(model_c)[2]).sum(axis=1))

    def _slope(self, model_c: FloatArray) -> FloatArray:
        off, distance, log_share = self._parts(model_c)
        # d/d distance of log(Phi(half - distance) - Phi(-half - distance))
        density = (np.exp(-0.5 * (self._half - distance)**2 - log_share)
                   - np.exp(-0.5 * (self._half + distance)**2 - log_share)) / np.sqrt(2.0 * np.pi)
        return np.asarray((self._readings.counts * np.copysign(density, off)).sum(axis=1) / self._noise_k)

    def _bisected(self) -> FloatArray:
        used = self._readings.counts > 0.0
        low = np.where(used, self._readings.levels_c, np.inf).min(axis=1)
        high = np.where(used, self._readings.levels_c, -np.inf).max(axis=1)
        for _ in range(WINDOW_HALVINGS):
            middle = 0.5 * (low + high)
            rises = self._slope(middle) > 0.0
            low, high = np.where(rises, low, middle), np.where(rises, middle, high)
        return np.asarray(0.5 * (low + high))


def likely_noise_k(readings: Sequence[Readings], sensors_c: Sequence[FloatArray]) -> float:
    """Return the standard deviation [K] under which Readings are likeliest, given sensor temperatures [deg C]."""
    def cost(log_noise: float) -> float:
        noise_k = float(np.exp(log_noise))
        return sum(ReadingResiduals(own, noise_k).cost(sensor_c) for own, sensor_c in zip(readings, sensors_c))

    return float(np.exp(minimize_scalar(cost, bounds=np.log(NOISE_RANGE_K), method='bounded',
                                        options={'xatol': 0.02}).x))
