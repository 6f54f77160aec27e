# SPDX-License-Identifier: Apache-2.0
"""Mean magnitude of a power that varies normally within a step: an independent implementation."""

from math import erf, exp, pi, sqrt


def magnitude_w(mean_w, rms_w):
    """Return the mean magnitude [W] of a power with a mean and a root mean square [W]."""
    variance_w2 = rms_w**2 - mean_w**2
    if variance_w2 <= 0.0:
        return abs(mean_w)
    # The density of |P| is that of P, folded: integrated by parts on either side of 0.
    negative = 0.5 * (1.0 - erf(mean_w / sqrt(2.0 * variance_w2)))
    tail = sqrt(variance_w2 / (2.0 * pi)) * exp(-0.5 * mean_w**2 / variance_w2)
    return mean_w * (1.0 - 2.0 * negative) + 2.0 * tail
