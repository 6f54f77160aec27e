# SPDX-License-Identifier: Apache-2.0
"""A Journey from points on the map: with the times of a recording, or driven at a free speed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from bev_preheat.errors import figure, InvalidInput
from bev_preheat.numerics import BoolArray, EARTH_RADIUS_M, FloatArray, no_position
from bev_preheat.route.legs import drive_along, Track
from bev_preheat.route.segments import LONGEST_ROUTE_S
from bev_preheat.route.sources.elevation import gaussian
from bev_preheat.route.sources.journey import (
    check_coordinates,
    distances_m,
    Journey,
    journey_of,
    RouteOptions,
    Timeline,
)

# No car is faster [m/s]; a fix beyond is an error of the receiver.
MOST_SPEED_MPS = 83.0
# Share of the fixes that may be dropped.
MOST_DROPPED = 0.2
# Longer times between fixes are named [s].
NAMED_GAP_S = 60.0
# The car stands if it stays within this distance [m] for this time [s].
STOP_RADIUS_M = 15.0
LEAST_STOP_S = 20.0
# Positions closer in time are filtered by a Gaussian with this deviation [s].
POSITION_FILTER_S = 2.0
# Free driving: comfortable acceleration, also in curves [m/s^2], and the length over which a curve is measured
# [m].
COMFORTABLE_MPS2 = 1.0
LATERAL_MPS2 = 2.0
CURVE_M = 60.0
CURVE_OVER_M = 5.0
MOST_CELLS = 200_000
LEAST_CURVE_MPS = 4.0
# Points farther apart than this [m] are not a line along the road, whose curves count.
DENSE_M = 60.0
SPEED_RANGE_KMH = (5.0, 250.0)


def journey_of_points(kind: str, latitude_deg: FloatArray, longitude_deg: FloatArray,
                      elevation_m: FloatArray, time_s: FloatArray | None, options: RouteOptions,
                      remarks: Sequence[str] = (), element: str = 'point') -> Journey:
    """
    Return the Journey of M points on the map, shapes (M,), NaN for an unknown elevation.

    Raises InvalidInput naming the point and the remedy.
    """
    check_coordinates(latitude_deg, longitude_deg, element)
    remarks, missing = list(remarks), no_position(latitude_deg, longitude_deg)
    if missing.any():
        remarks.append(f'{missing.sum()} {element}s dropped, from {element} {int(np.argmax(missing)) + 1} on: '
                       'latitude 0 and longitude 0 mean that the receiver had no position')
        latitude_deg, longitude_deg, elevation_m = (
            values[~missing] for values in (latitude_deg, longitude_deg, elevation_m))
        time_s = None if time_s is None else time_s[~missing]
        if len(latitude_deg) < 2:
            raise InvalidInput([f'has {len(latitude_deg)} {element}s with a position; a route needs at least 2',
                                *remarks])
    if time_s is None:
        return _free(kind, latitude_deg, longitude_deg, elevation_m, options, remarks)
    if options.free_speed_kmh is not None:
        raise InvalidInput(f'the {kind} has times; leave out {options.name("free_speed_kmh")}')
    timely = _in_order(time_s)
    wild = int((~timely).sum())
    if wild > MOST_DROPPED * len(timely):
        at = int(np.argmax(np.diff(time_s) < 0.0)) + 1
        raise InvalidInput(f'{element} {at + 1}: time: is {figure(float(time_s[at - 1] - time_s[at]))} s before '
                           f'that of the previous {element}, and {wild} of {len(timely)} do not fit the others')
    if wild:
        remarks.append(f'{wild} {element}s dropped, from {element} {int(np.argmin(timely)) + 1} on: the time does '
                       'not fit those of the others')
        latitude_deg, longitude_deg, elevation_m, time_s = (
            values[timely] for values in (latitude_deg, longitude_deg, elevation_m, time_s))
    keep = _plausible(latitude_deg, longitude_deg, time_s)
    dropped = int((~keep).sum())
    # Receivers that are faster than their whole seconds repeat a time.
    far = int((~keep & (np.diff(time_s, prepend=-np.inf) > 0.0)).sum())
    if far > MOST_DROPPED * len(keep) or keep.sum() < 2:
        raise InvalidInput(f'{far} of {len(keep)} {element}s would need more than {MOST_SPEED_MPS * 3.6:.0f} '
                           'km/h from the previous one; check times and coordinates')
    if dropped:
        first = int(np.argmin(keep)) + 1
        remarks.append(f'{dropped} {element}s dropped, from {element} {first} on: at the same time as '
                       'the one before, or too far from it')
    latitude_deg, longitude_deg, elevation_m, time_s = (
        values[keep] for values in (latitude_deg, longitude_deg, elevation_m, time_s))
    elapsed_s = time_s - time_s[0]
    step_m = _smooth_steps_m(latitude_deg, longitude_deg, elapsed_s)
    stands, breaks_s = _standstills(latitude_deg, longitude_deg, elapsed_s)
    step_m = np.where(stands, 0.0, step_m)
    if breaks_s:
        waits_s = float(np.diff(elapsed_s)[stands].sum())
        remarks.append(f'{len(breaks_s) // 2} stops, {waits_s:.0f} s in total')
    gaps_s = np.diff(elapsed_s)[~stands]
    if gaps := int((gaps_s > NAMED_GAP_S).sum()):
        remarks.append(f'gaps of more than {NAMED_GAP_S:g} s without a {element}: {gaps}, the longest '
                       f'{gaps_s.max():.0f} s; driven at constant speed')
    distance_m = np.concatenate(([0.0], np.cumsum(step_m)))
    return journey_of(kind, Timeline(distance_m, elapsed_s, latitude_deg, longitude_deg, elevation_m,
                                     breaks_s=tuple(breaks_s)), remarks)


def _in_order(time_s: FloatArray) -> BoolArray:
    """Return which times to keep, shape (M,): the most that never fall, none far from the others."""
    keep = np.abs(time_s - np.median(time_s)) <= LONGEST_ROUTE_S
    if keep.all() and (np.diff(time_s) >= 0.0).all():
        return keep
    # The longest subsequence that never falls: for each length the one with the earliest end.
    ends_s: list[float] = []
    ends: list[int] = []
    before = np.full(len(time_s), -1)
    for at in np.flatnonzero(keep).tolist():
        length = bisect_right(ends_s, time_s[at])
        before[at] = ends[length - 1] if length else -1
        ends_s[length:length + 1], ends[length:length + 1] = [time_s[at]], [at]
    keep[:] = False
    at = ends[-1] if ends else -1
    while at >= 0:
        keep[at] = True
        at = int(before[at])
    return keep


def _plausible(latitude_deg: FloatArray, longitude_deg: FloatArray, time_s: FloatArray) -> BoolArray:
    """Return whether each fix can be reached from the last plausible fix, shape (M,)."""
    keep = np.ones(len(time_s), dtype=bool)
    step_s, step_m = np.diff(time_s), distances_m(latitude_deg, longitude_deg)
    if (step_s > 0.0).all() and (step_m <= MOST_SPEED_MPS * step_s).all():
        return keep
    last = 0
    for at in range(1, len(time_s)):
        since_s = time_s[at] - time_s[last]
        pair = [last, at]
        away_m = float(distances_m(latitude_deg[pair], longitude_deg[pair])[0])
        keep[at] = since_s > 0.0 and away_m <= MOST_SPEED_MPS * since_s
        if keep[at]:
            last = at
    return keep


def _standstills(latitude_deg: FloatArray, longitude_deg: FloatArray,
                 elapsed_s: FloatArray) -> tuple[BoolArray, list[float]]:
    """Return whether the car stands between neighbours, shape (M - 1,), and start and end of each stop [s]."""
    stands = np.zeros(len(elapsed_s) - 1, dtype=bool)
    breaks_s: list[float] = []
    east_m, north_m = _plane_m(latitude_deg, longitude_deg)
    # Candidates: steps slower than the radius within the least duration.
    slow = np.hypot(np.diff(north_m), np.diff(east_m)) <= STOP_RADIUS_M
    start, count = 0, len(elapsed_s)
    while start < count - 1:
        if not slow[start]:
            start += 1
            continue
        end = start + 1
        while end < count and (north_m[end] - north_m[start])**2 + (
                east_m[end] - east_m[start])**2 <= STOP_RADIUS_M**2:
            end += 1
        end -= 1
        if elapsed_s[end] - elapsed_s[start] >= LEAST_STOP_S:
            stands[start:end] = True
            breaks_s += [float(elapsed_s[start]), float(elapsed_s[end])]
            start = end
        else:
            start += 1
    return stands, breaks_s


def _plane_m(latitude_deg: FloatArray, longitude_deg: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions east and north [m] of the first point, shapes (M,); good for curves and stops."""
    east = np.radians(longitude_deg - longitude_deg[0]) * np.cos(np.radians(latitude_deg))
    return EARTH_RADIUS_M * east, EARTH_RADIUS_M * np.radians(latitude_deg - latitude_deg[0])


def _smooth_steps_m(latitude_deg: FloatArray, longitude_deg: FloatArray, elapsed_s: FloatArray) -> FloatArray:
    """Return the distances between neighbours [m], shape (M - 1,), without the zigzag of position errors."""
    between_s = float(np.median(np.diff(elapsed_s)))
    deviation = POSITION_FILTER_S / between_s
    if deviation < 1.0 or len(elapsed_s) < 8:
        return distances_m(latitude_deg, longitude_deg)
    return distances_m(gaussian(latitude_deg, deviation), gaussian(longitude_deg, deviation))


def _free(kind: str, latitude_deg: FloatArray, longitude_deg: FloatArray, elevation_m: FloatArray,
          options: RouteOptions, remarks: list[str]) -> Journey:
    """Return the Journey of a line without times, driven at the free speed and slower in curves."""
    if options.free_speed_kmh is None:
        raise InvalidInput([f'the {kind} has no usable times; '
                            + options.advice('free_speed_kmh', 'give the speed on free road'), *remarks])
    low, high = SPEED_RANGE_KMH
    if not low <= options.free_speed_kmh <= high:
        raise InvalidInput(f'{options.name("free_speed_kmh")}: {options.free_speed_kmh:g} km/h is not allowed; it '
                           f'must be {low:g} ... {high:g} km/h')
    step_m = distances_m(latitude_deg, longitude_deg)
    different = np.concatenate(([True], step_m > 0.01))
    latitude_deg, longitude_deg, elevation_m = (
        values[different] for values in (latitude_deg, longitude_deg, elevation_m))
    distance_m = np.concatenate(([0.0], np.cumsum(distances_m(latitude_deg, longitude_deg))))
    if not 10.0 <= distance_m[-1] <= 5e6:
        raise InvalidInput(f'the {kind} is {figure(float(distance_m[-1]), 4)} m long; it must be 10 ... 5000000 m')
    cells = int(np.clip(np.ceil(distance_m[-1] / CURVE_OVER_M), 4, MOST_CELLS))
    grid_m = np.linspace(0.0, distance_m[-1], cells + 1)
    allowed_mps, in_curves = np.full(len(grid_m), options.free_speed_kmh / 3.6), ''
    if float(np.median(np.diff(distance_m))) <= DENSE_M:
        allowed_mps = np.minimum(allowed_mps, _curve_speed_mps(grid_m, distance_m, latitude_deg, longitude_deg))
        in_curves = ', slower in curves'
    remarks.append(f'no times: driven at {options.free_speed_kmh:g} km/h{in_curves}')
    allowed_mps[[0, -1]] = 0.0
    drive = drive_along(Track(grid_m, allowed_mps, np.zeros(len(grid_m))), COMFORTABLE_MPS2, COMFORTABLE_MPS2)
    return journey_of(kind, Timeline(
        drive.distance_m, drive.time_s, np.interp(grid_m, distance_m, latitude_deg),
        np.interp(grid_m, distance_m, longitude_deg), np.interp(grid_m, distance_m, elevation_m)), remarks)


def _curve_speed_mps(grid_m: FloatArray, distance_m: FloatArray, latitude_deg: FloatArray,
                     longitude_deg: FloatArray) -> FloatArray:
    """Return the speed [m/s] of comfortable lateral acceleration at points of a line, shape of `grid_m`."""
    east_m, north_m = _plane_m(latitude_deg, longitude_deg)

    def at(along_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        inside_m = np.clip(along_m, 0.0, distance_m[-1])
        return np.interp(inside_m, distance_m, east_m), np.interp(inside_m, distance_m, north_m)

    x0, y0 = at(grid_m - CURVE_M)
    x1, y1 = at(grid_m)
    x2, y2 = at(grid_m + CURVE_M)
    # Radius of the circle through three points: abc / (4 area).
    a, b, c = np.hypot(x1 - x0, y1 - y0), np.hypot(x2 - x1, y2 - y1), np.hypot(x2 - x0, y2 - y0)
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    radius_m = a * b * c / np.maximum(4.0 * area, 1e-6)
    return np.maximum(np.sqrt(LATERAL_MPS2 * radius_m), LEAST_CURVE_MPS)
