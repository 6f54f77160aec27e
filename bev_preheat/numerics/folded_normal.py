# SPDX-License-Identifier: Apache-2.0
"""The mean magnitude of a normally distributed quantity."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import array_exp

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

_erf = np.vectorize(math.erf, otypes=[float])
# A mean this many standard deviations from 0 changes its sign too rarely to matter.
CERTAIN_DEVIATIONS = 9.0
ROOT_2_OVER_PI = math.sqrt(2.0 / math.pi)


def mean_magnitude(mean: FloatArray | float, variance: FloatArray | float) -> FloatArray:
    """
    Return the mean of |x|, with x normally distributed with a mean and a variance; broadcast shape.

    That is the mean of the folded normal distribution (Leone, Nelson, Nottingham, Technometrics
    3(4), 1961): between |mean| and the root of mean^2 + variance; |mean| without variance.
    """
    magnitude = np.abs(mean)
    varies = np.asarray(variance > np.square(magnitude / CERTAIN_DEVIATIONS))
    if not varies.any():
        return np.broadcast_to(magnitude, varies.shape)
    deviation = np.sqrt(np.where(varies, variance, 1.0))
    standard = np.minimum(magnitude / (math.sqrt(2.0) * deviation), CERTAIN_DEVIATIONS)
    return np.where(
        varies, ROOT_2_OVER_PI * deviation * array_exp(-np.square(standard))
        + magnitude * _erf(standard), magnitude)
