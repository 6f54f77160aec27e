# SPDX-License-Identifier: Apache-2.0
"""Distances of a recording: by speed, odometer and position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.logs.recording import Series
from bev_preheat.numerics.factors import EARTH_RADIUS_M

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Intervals longer than this [s] have no known charge, energy or distance.
LONGEST_HOLD_S = 120.0
# Distance that tells a speed's unit [m], and the agreement that a unit must reach.
UNIT_TELLING_M, AGREEMENT = 500.0, 0.08


def integral(series: Series) -> FloatArray:
    """Return the integral of a signal up to each sample, shape (N,); long intervals count nothing."""
    step_s = np.diff(series.time_s)
    means = 0.5 * (series.value[1:] + series.value[:-1])
    return np.concatenate([[0.0], np.cumsum(np.where(step_s <= LONGEST_HOLD_S, step_s, 0.0) * means)])


def by_speed(signals: Mapping[str, Series]) -> Series | None:
    """Return the integral of the speed [m], None without a speed."""
    speed = signals.get('speed_mps')
    return None if speed is None else Series(speed.time_s, integral(speed))


def by_position(signals: Mapping[str, Series]) -> Series | None:
    """Return the distance by latitude and longitude [m], None without these."""
    if not {'latitude_deg', 'longitude_deg'} <= signals.keys():
        return None
    latitude, longitude = signals['latitude_deg'], signals['longitude_deg']
    north = np.radians(latitude.value)
    east = np.radians(np.interp(latitude.time_s, longitude.time_s, longitude.value, left=np.nan, right=np.nan))
    step_s = np.diff(latitude.time_s)
    steps_m = EARTH_RADIUS_M * np.hypot(np.diff(north), np.diff(east) * np.cos(0.5 * (north[1:] + north[:-1])))
    # Jumps of the receiver are no drives.
    steps_m = np.where(np.isfinite(steps_m) & (steps_m <= 70.0 * np.maximum(step_s, 1.0))
                       & (step_s <= LONGEST_HOLD_S), steps_m, 0.0)
    return Series(latitude.time_s, np.concatenate([[0.0], np.cumsum(steps_m)]))


def distances(driven: Series, other: Series) -> tuple[float, float] | None:
    """Return two distances [m] in the time that both series cover, None if they are short."""
    inside = (other.time_s >= driven.time_s[0]) & (other.time_s <= driven.time_s[-1])
    if inside.sum() < 2:
        return None
    ends = other.time_s[inside][[0, -1]]
    other_m = float(np.ptp(other.value[inside]))
    own_m = float(np.diff(np.interp(ends, driven.time_s, driven.value))[0])
    return (own_m, other_m) if other_m >= UNIT_TELLING_M and own_m > 0.0 else None
