# SPDX-License-Identifier: Apache-2.0
"""Random variation from segment to segment, as traffic makes it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray


def vary(random: np.random.Generator, steps: int, mean: float, variability: float) -> FloatArray:
    """
    Return a positive series that wanders about its mean, as traffic does, shape (steps,).

    `random` is a numpy Generator, `variability` the standard deviation of the series' logarithm.
    """
    noise = random.normal(size=steps)
    smooth = np.convolve(noise, np.full(5, 1.0 / np.sqrt(5.0)), mode='same')[:steps]
    return mean * np.exp(variability * smooth - 0.5 * variability**2)
