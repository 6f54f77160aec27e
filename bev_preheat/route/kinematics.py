# SPDX-License-Identifier: Apache-2.0
"""
Speed of a car along legs of a road, from speed limits, stops and comfortable accelerations.

The speed is computed over distance, because limits and stops have fixed places: the square of the speed may rise
by 2 a ds and fall by 2 b ds over a cell of length ds. Braking in time is then one pass from the end to the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from bev_preheat.numerics import FloatArray

# Longest cell [m] over which the acceleration is constant.
CELL_M = 2.0


@dataclass(frozen=True)
class RoadLeg:
    """
    A stretch of road with one speed limit and one slope.

    `slope` is rise over run; `stops` are spread evenly between the ends of the leg. Traffic reduces the speed
    limit by a random share between 0 and `traffic_slowdown`, redrawn every
    `traffic_length_m` and interpolated linearly. The ambient temperature is linear from start to end.
    """

    length_m: float
    speed_limit_mps: float
    slope: float = 0.0
    stops: int = 0
    stop_duration_s: float = 0.0
    traffic_slowdown: float = 0.0
    traffic_length_m: float = 300.0
    ambient_at_start_c: float = 0.0
    ambient_at_end_c: float = 0.0


@dataclass(frozen=True)
class Track:
    """Allowed speeds at M points along the road; arrays of shape (M,)."""

    distance_m: FloatArray
    allowed_speed_mps: FloatArray
    standstill_s: FloatArray


@dataclass(frozen=True)
class RoadDrive:
    """Instants of a drive, with constant acceleration in between; arrays of shape (K,)."""

    time_s: FloatArray
    distance_m: FloatArray
    speed_mps: FloatArray

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (distance [m], speed [m/s]) at instants [s]; shapes follow the input."""
        cell = np.searchsorted(self.time_s, time_s, side='right') - 1
        cell = np.clip(cell, 0, len(self.time_s) - 2)
        since_s = time_s - self.time_s[cell]
        start_mps = self.speed_mps[cell]
        acceleration_mps2 = ((self.speed_mps[cell + 1] - start_mps) / (self.time_s[cell + 1] - self.time_s[cell]))
        speed_mps = start_mps + acceleration_mps2 * since_s
        return self.distance_m[cell] + 0.5 * (start_mps + speed_mps) * since_s, speed_mps


def lay_track(legs: Sequence[RoadLeg], seed: int) -> Track:
    """Return the Track of RoadLegs, standstill to standstill; `seed` is that of the traffic's random numbers."""
    random = np.random.default_rng(seed)
    # A point between two legs belongs to both, and the lower speed applies: each leg contributes both of its
    # ends, and duplicate points are merged below.
    pieces = [_points(leg, start_m, random) for leg, start_m in zip(legs, leg_starts_m(legs))]
    distance_m, allowed_mps, standstill_s = (np.concatenate(column) for column in zip(*pieces))
    first = np.flatnonzero(np.diff(distance_m, prepend=-1.0) > 0.0)
    allowed_mps = np.minimum.reduceat(allowed_mps, first)
    allowed_mps[[0, -1]] = 0.0
    return Track(distance_m[first], allowed_mps, np.maximum.reduceat(standstill_s, first))


def leg_starts_m(legs: Sequence[RoadLeg]) -> list[float]:
    """Return the start of each leg and the end of the last one [m], a list of L + 1."""
    return list(accumulate((leg.length_m for leg in legs), initial=0.0))


def drive_along(track: Track, acceleration_mps2: float, deceleration_mps2: float, pace: float = 1.0) -> RoadDrive:
    """Return the fastest RoadDrive within accelerations [m/s^2] and the speeds of a Track times `pace`."""
    at_m = track.distance_m
    squared = (pace * track.allowed_speed_mps)**2
    rise = 2.0 * acceleration_mps2 * at_m
    squared = np.minimum.accumulate(squared - rise) + rise
    fall = 2.0 * deceleration_mps2 * at_m
    squared = (np.minimum.accumulate((squared + fall)[::-1])[::-1]) - fall
    # Rounding leaves a small value of either sign at a stop.
    stops = track.allowed_speed_mps == 0.0
    speed_mps = np.sqrt(np.where(stops, 0.0, np.maximum(squared, 0.0)))

    moving_s = 2.0 * np.diff(at_m) / (speed_mps[:-1] + speed_mps[1:])
    waited_s = np.cumsum(track.standstill_s)
    arrival_s = np.concatenate(([0.0], np.cumsum(moving_s) + waited_s[:-1]))
    waits = track.standstill_s > 0.0
    departure_s = arrival_s[waits] + track.standstill_s[waits]
    copies = 1 + waits
    return RoadDrive(
        time_s=np.sort(np.concatenate((arrival_s, departure_s)), kind='stable'),
        distance_m=np.repeat(at_m, copies), speed_mps=np.repeat(speed_mps, copies))


def _points(leg: RoadLeg, start_m: float,
            random: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return distance, allowed speed and standstill at the points of a leg, including its ends."""
    # Stops must be points, with at least one moving point in between.
    between_m = leg.length_m / (leg.stops + 1)
    cells = max(2, int(np.ceil(between_m / CELL_M)))
    along_m = np.linspace(0.0, leg.length_m, cells * (leg.stops + 1) + 1)
    knots = int(np.ceil(leg.length_m / leg.traffic_length_m)) + 1
    # Uniform random numbers: the streams of other distributions may change between NumPy releases.
    share = np.interp(along_m, leg.traffic_length_m * np.arange(knots), random.random(knots))
    allowed_mps = leg.speed_limit_mps * (1.0 - leg.traffic_slowdown * share)
    standstill_s = np.zeros_like(along_m)
    at_stops = np.arange(1, leg.stops + 1) * cells
    allowed_mps[at_stops] = 0.0
    standstill_s[at_stops] = leg.stop_duration_s
    return start_m + along_m, allowed_mps, standstill_s
