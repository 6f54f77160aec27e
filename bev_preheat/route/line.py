# SPDX-License-Identifier: Apache-2.0
"""The route's line on the map, searched by position; fixes, their places on it, or the reason for none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.numerics import AnyNumber, first_true, FloatArray, IntArray


@dataclass(frozen=True)
class RouteLine:
    """
    M points of a route on the map (WGS 84), each array of shape (M,), M >= 2.

    `distance_m` counts along the line and never falls. `elapsed_s` is the planned time since the start of
    segment 0 and never falls; at a stop it rises while `distance_m` stays.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    distance_m: FloatArray
    elapsed_s: FloatArray


class Cause(Enum):
    """The reason for a place, or for none."""

    MATCHED = 'on the route'
    RECKONED = 'on the route by the odometer'
    SILENT = 'no position yet'
    CONFIRMING = 'place to be confirmed'
    AMBIGUOUS = 'several places possible'
    UNCERTAIN = 'place too uncertain'
    OUTLIER = 'position contradicts the place'
    OFF_ROUTE = 'off the route'
    ELSEWHERE = 'on another part of the route'
    AGAINST = 'against the direction of the route'
    ARRIVED = 'beyond the end of the route'
    COARSE = 'position too coarse'
    FROZEN = 'position frozen'
    OVERTAKEN = 'position out of order'


class Fix(NamedTuple):
    """A position [deg, WGS 84] at an instant [ns], with the deviation of each of its axes [m]; None: unknown."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    deviation_m: float | None = None


class Match(NamedTuple):
    """
    The place on the line at an instant: distance [m] and standard deviation [m], both None in doubt.

    `sentence` explains the cause.
    """

    cause: Cause
    sentence: str
    stamp_ns: int
    distance_m: float | None = None
    deviation_m: float | None = None


# WGS 84 (EPSG 4326): semi-major axis [m] and square of the first eccentricity.
SEMI_MAJOR_AXIS_M = 6_378_137.0
ECCENTRICITY_SQUARED = 6.694_379_990_14e-3
# Half of it is well below the deviation of a good receiver, and 1000 km are 250 000 points.
SPACING_M = 4.0
# Points in one block of the search, 100 m of road: a route of 500 km has 5000 blocks.
BLOCK = 25
# Beyond it the plane's longitude is degenerate; no road goes there.
MOST_LATITUDE_DEG = 85.0


class Nearby(NamedTuple):
    """Points of a line near a position: their indices, and distances from it [m]; shapes (K,), K >= 0."""

    at: IntArray
    distance_m: FloatArray


class MapLine:
    """
    P points SPACING_M apart or closer along a RouteLine.

    `along_m` is the distance of each from the start [m], `elapsed_s` the planned time [s], both of shape (P,).
    """

    def __init__(self, line: RouteLine) -> None:
        """Divide a RouteLine into points; raise InvalidInput, with one problem per array, if it is unusable."""
        _check(line)
        self.length_m = float(line.distance_m[-1])
        self.spacing_m = self.length_m / math.ceil(self.length_m / SPACING_M)
        count = round(self.length_m / self.spacing_m) + 1
        self.along_m: FloatArray = np.linspace(0.0, self.length_m, count)
        self.elapsed_s: FloatArray = np.interp(self.along_m, line.distance_m, line.elapsed_s)
        self._planned_m, self._planned_s = line.distance_m, line.elapsed_s
        self._latitude_deg = np.interp(self.along_m, line.distance_m, line.latitude_deg)
        self._longitude_deg = np.interp(self.along_m, line.distance_m, np.unwrap(line.longitude_deg, period=360.0))
        first = np.arange(0, count, BLOCK)
        self._centre = np.minimum(first + BLOCK // 2, count - 1)
        self._block = np.repeat(self._centre, BLOCK)[:count]
        east_m, north_m = offset_m(
            self._latitude_deg[self._block], self._longitude_deg[self._block],
            self._latitude_deg, self._longitude_deg)
        self._radius_m = np.maximum.reduceat(np.hypot(east_m, north_m), first)
        self._first, self._count = first, count

    def near(self, latitude_deg: float, longitude_deg: float, radius_m: float) -> Nearby:
        """Return the points within a radius [m] of a position [deg], in driving order."""
        distance_m = self._to_blocks_m(latitude_deg, longitude_deg)
        return self._of_blocks(np.flatnonzero(distance_m - self._radius_m <= radius_m),
                               latitude_deg, longitude_deg, radius_m)

    def nearest(self, latitude_deg: float, longitude_deg: float) -> tuple[int, float]:
        """Return the point nearest to a position [deg], and its distance [m]."""
        distance_m = self._to_blocks_m(latitude_deg, longitude_deg)
        # The nearest point of all lies no further than the far end of the block that is nearest so.
        limit_m = float((distance_m + self._radius_m).min())
        found = self._of_blocks(np.flatnonzero(distance_m - self._radius_m <= limit_m),
                                latitude_deg, longitude_deg, math.inf)
        best = int(found.distance_m.argmin())
        return int(found.at[best]), float(found.distance_m[best])

    def position(self, distance_m: float) -> tuple[float, float]:
        """Return latitude and longitude [deg] at a distance [m] from the start."""
        return (float(np.interp(distance_m, self.along_m, self._latitude_deg)),
                float(np.interp(distance_m, self.along_m, self._longitude_deg)))

    def direction(self, at: int) -> tuple[float, float]:
        """Return the line's direction at a point as (east, north), of length 1; (0, 0) if it has none."""
        before, after = max(at - 1, 0), min(at + 1, self._count - 1)
        return unit_vector(
            float(self._latitude_deg[before]), float(self._longitude_deg[before]),
            float(self._latitude_deg[after]), float(self._longitude_deg[after]))

    def planned_m(self, from_m: FloatArray, seconds: float) -> FloatArray:
        """Return the planned distances [m] `seconds` after the vehicle was at distances [m], stops included."""
        from_s = np.interp(from_m, self._planned_m, self._planned_s)
        return np.interp(from_s + seconds, self._planned_s, self._planned_m)

    def planned_s(self, distance_m: float) -> float:
        """Return the planned time [s] at a distance [m]."""
        return float(np.interp(distance_m, self._planned_m, self._planned_s))

    def _to_blocks_m(self, latitude_deg: float, longitude_deg: float) -> FloatArray:
        distance_m: FloatArray = np.hypot(*offset_m(
            latitude_deg, longitude_deg, self._latitude_deg[self._centre], self._longitude_deg[self._centre]))
        return distance_m

    def _of_blocks(self, blocks: IntArray, latitude_deg: float, longitude_deg: float, radius_m: float) -> Nearby:
        at = (self._first[blocks][:, None] + np.arange(BLOCK)).ravel()
        at = at[at < self._count]
        distance_m = np.hypot(*offset_m(
            latitude_deg, longitude_deg, self._latitude_deg[at], self._longitude_deg[at]))
        kept = distance_m <= radius_m
        return Nearby(at[kept], distance_m[kept])


def unit_vector(latitude_deg: float, longitude_deg: float, to_latitude_deg: float,
                to_longitude_deg: float) -> tuple[float, float]:
    """Return the direction from one position to another as (east, north), of length 1; (0, 0) if they are one."""
    east_m, north_m = offset_m(latitude_deg, longitude_deg, to_latitude_deg, to_longitude_deg)
    length_m = math.hypot(east_m, north_m)
    return (east_m / length_m, north_m / length_m) if length_m > 0.0 else (0.0, 0.0)


def offset_m(latitude_deg: AnyNumber, longitude_deg: AnyNumber, to_latitude_deg: AnyNumber,
             to_longitude_deg: AnyNumber) -> tuple[AnyNumber, AnyNumber]:
    """
    Return (east, north) [m] from one position to another one nearby; shapes follow the inputs.

    In the plane that touches the ellipsoid at the first position.
    """
    latitude = np.radians(latitude_deg)
    flattening = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude)**2
    # Radii of curvature in the meridian and in the prime vertical.
    meridian_m = SEMI_MAJOR_AXIS_M * (1.0 - ECCENTRICITY_SQUARED) / flattening**1.5
    vertical_m = SEMI_MAJOR_AXIS_M / np.sqrt(flattening)
    # The shorter way round the earth.
    longitude_apart_deg = (to_longitude_deg - longitude_deg + 180.0) % 360.0 - 180.0
    return (np.radians(longitude_apart_deg) * vertical_m * np.cos(latitude),
            np.radians(to_latitude_deg - latitude_deg) * meridian_m)


def _check(line: RouteLine) -> None:
    arrays = {name: getattr(line, name) for name in ('latitude_deg', 'longitude_deg', 'distance_m', 'elapsed_s')}
    problems = [f'{name} of the line: has {len(values)} values; all arrays must have the same length, at '
                'least 2' for name, values in arrays.items() if len(values) != len(line.distance_m)
                or len(values) < 2]
    if problems:
        raise InvalidInput(problems)
    for name, values in arrays.items():
        if (at := first_true(~np.isfinite(values))) is not None:
            problems.append(f'{name}[{at}] of the line: {values[at]} is not allowed; it must be finite')
    for name, limit in (('latitude_deg', MOST_LATITUDE_DEG), ('longitude_deg', 360.0)):
        if (at := first_true(np.abs(arrays[name]) > limit)) is not None:
            problems.append(f'{name}[{at}] of the line: {figure(float(arrays[name][at]))} is not allowed; it must '
                            f'be {-limit:g} ... {limit:g}')
    problems += [f'{name} of the line: must not fall' for name in ('distance_m', 'elapsed_s')
                 if (np.diff(arrays[name]) < 0.0).any()]
    if not problems and not (line.distance_m[0] == 0.0 and line.distance_m[-1] > 0.0):
        problems.append('distance_m of the line: must begin at 0 and end above it')
    if problems:
        raise InvalidInput(problems)
