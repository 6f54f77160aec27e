# SPDX-License-Identifier: Apache-2.0
"""
The normal distribution truncated to an interval: the information in a quantised signal.

A reading of 3 from a sensor that rounds to whole degrees means that the (noisy) temperature is
between 2.5 and 3.5. The truncated normal distribution has mean and variance in closed form.
"""

from math import erf, erfc, exp, expm1, log, pi, sqrt

from bev_preheat.tunables import TAIL

ROOT_2 = sqrt(2.0)
LOG_ROOT_2_PI = 0.5 * log(2.0 * pi)


def truncated_moments(mean: float, variance: float, low: float,
                      high: float) -> tuple[float, float, float]:
    """
    Return (mean, variance, log of the probability) of a normal variable restricted to [low, high].

    If the interval is a point (low == high), the probability is the density there.
    """
    deviation = sqrt(variance)
    a, b = (low - mean) / deviation, (high - mean) / deviation
    if b - a < 1e-9:
        return 0.5 * (low + high), 0.0, -0.5 * a * a - LOG_ROOT_2_PI - log(deviation)
    if a > TAIL:
        offset, spread, log_probability = _tail(a, b - a)
        return low + deviation * offset, variance * spread, log_probability
    if b < -TAIL:
        offset, spread, log_probability = _tail(-b, b - a)
        return high - deviation * offset, variance * spread, log_probability
    if a > 0.0:
        probability = 0.5 * (erfc(a / ROOT_2) - erfc(b / ROOT_2))
    elif b < 0.0:
        probability = 0.5 * (erfc(-b / ROOT_2) - erfc(-a / ROOT_2))
    else:
        probability = 0.5 * (erf(b / ROOT_2) - erf(a / ROOT_2))
    density_a = exp(-0.5 * a * a - LOG_ROOT_2_PI)
    density_b = exp(-0.5 * b * b - LOG_ROOT_2_PI)
    shift = (density_a - density_b) / probability
    spread = 1.0 + (a * density_a - b * density_b) / probability - shift * shift
    return (mean + deviation * shift, variance * max(spread, 0.0), log(probability))


def _tail(distance: float, width: float) -> tuple[float, float, float]:
    """
    Return (mean beyond `distance`, variance, log of the probability) in the standard normal's tail.

    There the density decays exponentially, at rate `distance`, over the interval's `width`.
    """
    x = distance * width
    log_density = -0.5 * distance * distance - LOG_ROOT_2_PI
    if x < 1e-4:
        return 0.5 * width, width * width / 12.0, log_density + log(width)
    # Beyond this the far end is irrelevant, and exp would overflow.
    x = min(x, 700.0)
    grown = expm1(x)
    return (1.0 / distance - width / grown,
            max(0.0, 1.0 / distance**2 - width * width * (grown + 1.0) / (grown * grown)),
            log_density + log(-expm1(-x) / distance))
