# SPDX-License-Identifier: Apache-2.0
"""Random variation of power by traffic, from segment to segment and within a segment."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.route.segments import Route

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray


# Noise is smoothed over this many segments.
SMOOTHED = 5
WEIGHTS = np.full(SMOOTHED, 1.0 / np.sqrt(SMOOTHED))


def vary(random: np.random.Generator, steps: int, mean: float, variability: float) -> FloatArray:
    """
    Return a positive series that varies about its mean, as in traffic, shape (steps,).

    `random` is a numpy Generator, `variability` the standard deviation of the series' logarithm.
    """
    smooth = np.convolve(random.normal(size=steps), WEIGHTS, mode='same')[:steps]
    series: FloatArray = mean * np.exp(variability * smooth - 0.5 * variability**2)
    return series


# Number of cycles of accelerating, braking and rolling within a segment.
CYCLES = 3


def with_cycles(route: Route) -> Route:
    """
    Return the route with the power of each segment in cycles of constant powers.

    In each cycle the car drives with a power, regenerates with the same and rolls; the durations follow from
    mean, root mean square and mean magnitude of the segment. Segments without variation stay.
    """
    rms_w, magnitude_w = route.propulsion_power_rms_w, route.propulsion_power_magnitude_w
    varies = route.propulsion_power_variance_w2 > 0.0
    safe_w = np.where(varies, magnitude_w, 1.0)
    # Shares of the time, shape (N, 3), that reproduce all three; the power is rms^2 / magnitude.
    power_w = np.where(varies, rms_w**2 / safe_w, route.propulsion_power_w)
    total = np.where(varies, safe_w**2 / np.maximum(rms_w, 1e-9)**2, 1.0)
    driving = np.where(varies, 0.5 * (magnitude_w + route.propulsion_power_w) / np.where(
        varies, power_w, 1.0), 1.0)
    shares = np.stack((driving, total - driving, 1.0 - total), axis=1)
    powers_w = np.stack((power_w, -power_w, np.zeros(len(route))), axis=1)
    parts = np.where(varies, CYCLES, 1)
    durations_s = np.repeat(shares * (route.duration_s / parts)[:, np.newaxis], parts, axis=0)
    columns = {field.name: np.repeat(getattr(route, field.name), 3 * parts) for field in fields(Route)}
    columns['duration_s'] = durations_s.ravel()
    columns['propulsion_power_w'] = np.repeat(powers_w, parts, axis=0).ravel()
    columns['propulsion_power_rms_w'] = np.abs(columns['propulsion_power_w'])
    columns['propulsion_power_magnitude_w'] = columns['propulsion_power_rms_w']
    lasts = columns['duration_s'] > 1e-6
    return Route(**{name: values[lasts] for name, values in columns.items()})
