# SPDX-License-Identifier: Apache-2.0
"""A temperature reading is an interval: residuals of a model's sensor temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_ndtr

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Standard deviation of sensor and model together, besides the rounding [K].
NOISE_K = 0.3
# Residuals beyond this many standard deviations count linearly (Huber), so that a spike decides nothing.
MOST_DEVIATIONS = 2.5
LEAST_RESIDUAL = 1e-4
FARTHEST = 25.0
HALF = 0.5


def interval_residuals(model_c: FloatArray, reading_c: FloatArray,
                       resolution_k: float) -> tuple[FloatArray, FloatArray]:
    """
    Return residuals (N,) of model temperatures against rounded readings, and their slopes over the model (N,).

    Half the square of a residual is the negative log-likelihood of the interval reading +- resolution/2 under
    normal
    noise of NOISE_K, relative to a model in its middle; for a continuous reading it is the scaled
    difference.
    """
    off = (model_c - reading_c) / NOISE_K
    half = HALF * resolution_k / NOISE_K
    if half < LEAST_RESIDUAL:
        residual, slope = off, np.full_like(off, 1.0 / NOISE_K)
    else:
        # Beyond this the logarithms lose their digits; such readings count linearly anyway.
        distance = np.minimum(np.abs(off), half + FARTHEST)
        log_share = _log_share(distance, half)
        square = np.maximum(2.0 * (_log_share(np.zeros(1), half) - log_share), 0.0)
        magnitude = np.sqrt(square)
        # d/d distance of log(Phi(half - distance) - Phi(-half - distance))
        density = (np.exp(-HALF * (half - distance)**2 - log_share)
                   - np.exp(-HALF * (half + distance)**2 - log_share)) / np.sqrt(2.0 * np.pi)
        # At the middle the slope is that of the parabola there.
        curvature = np.sqrt(2.0 * half * np.exp(-HALF * half**2 - _log_share(np.zeros(1), half))
                            / np.sqrt(2.0 * np.pi))
        steep = np.where(magnitude > 1e-3, density / np.maximum(magnitude, 1e-3), curvature)
        residual, slope = np.copysign(magnitude, off), steep / NOISE_K
    beyond = np.abs(residual) > MOST_DEVIATIONS
    limited = np.sqrt(np.maximum(2.0 * MOST_DEVIATIONS * np.abs(residual) - MOST_DEVIATIONS**2, 1e-12))
    return (np.where(beyond, np.copysign(limited, residual), residual),
            np.where(beyond, slope * MOST_DEVIATIONS / limited, slope))


def _log_share(distance: FloatArray, half: float) -> FloatArray:
    """Return log(Phi(half - distance) - Phi(-half - distance)) for distances >= 0."""
    upper, lower = log_ndtr(half - distance), log_ndtr(-half - distance)
    return np.asarray(upper + np.log1p(-np.exp(lower - upper)))
