# SPDX-License-Identifier: Apache-2.0
"""Decodes polylines: Google's Encoded Polyline Algorithm Format of 5 or 6 places, and HERE's flexible one."""

from __future__ import annotations

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FloatArray
from bev_preheat.route.sources.journey import distances_m

# Bits of a number in each character, and the sign that another one follows.
BITS, MORE, FIRST = 5, 0x20, 63
# A difference of coordinates has at most this many characters.
MOST_CHARACTERS = 8
# Values of the characters: of Google's format, and of HERE's (base 64 for URLs).
CODES = {chr(code + FIRST): code for code in range(64)}
FLEXIBLE_CODES = {sign: code for code, sign in enumerate(
    'ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_')}
FLEXIBLE_VERSION = 1
# Kinds of HERE's third dimension that are elevations [m]: altitude and elevation.
ELEVATIONS = (2, 3)
# Elevations in Google's format have two places, whatever the coordinates have.
ELEVATION_PLACES = 2


def decode_points_by_length(text: object, length_m: float) -> FloatArray:
    """
    Return latitudes, longitudes [deg] and elevations [m] (NaN: none), shape (M, 3).

    Of 5 or 6 places, with or without elevation, the reading counts whose length is nearest to the one given [m].
    """
    numbers = _numbers(text, CODES)
    readings = [_points(numbers, places, (ELEVATION_PLACES,) * with_elevation)
                for with_elevation in (False, True) for places in (5, 6)
                if len(numbers) % (2 + with_elevation) == 0]
    if not readings:
        raise InvalidInput('the encoded polyline is cut off')
    return min(readings, key=lambda points: _misfit(points, length_m))


def decode_flexible(text: object) -> FloatArray:
    """Return latitudes, longitudes [deg] and elevations [m] (NaN: none) of HERE's format, shape (M, 3)."""
    version, header, *numbers = _numbers(text, FLEXIBLE_CODES, header=2)
    if version != FLEXIBLE_VERSION:
        raise InvalidInput(f'is no flexible polyline of version {FLEXIBLE_VERSION}')
    places, kind, third_places = header & 15, header >> 4 & 7, header >> 7 & 15
    points = _points(numbers, places, (third_places,) * bool(kind))
    if kind not in ELEVATIONS:
        points[:, 2] = np.nan
    return points


def _numbers(text: object, codes: dict[str, int], header: int = 0) -> list[int]:
    """Return the numbers in a text; after the first `header` ones the lowest bit is the sign."""
    if not isinstance(text, str) or not text:
        raise InvalidInput('must be an encoded polyline (a text)')
    values: list[int] = []
    value = shift = 0
    for at, sign in enumerate(text):
        code = codes.get(sign)
        if code is None:
            raise InvalidInput(f'character {at + 1}, {sign!r}, does not belong to an encoded polyline')
        value |= (code & (MORE - 1)) << shift
        shift += BITS
        if not code & MORE:
            values.append(value if len(values) < header else ~(value >> 1) if value & 1 else value >> 1)
            value, shift = 0, 0
        elif shift > BITS * MOST_CHARACTERS:
            raise InvalidInput(f'character {at + 1}: a number is too long for an encoded polyline')
    if shift or len(values) <= header:
        raise InvalidInput('the encoded polyline is cut off')
    return values


def _points(numbers: list[int], places: int, third_places: tuple[int, ...] = ()) -> FloatArray:
    """Return points of differences, shape (M, 3); without a third dimension it is NaN."""
    dimensions = 2 + len(third_places)
    if len(numbers) % dimensions:
        raise InvalidInput('the encoded polyline is cut off')
    points = np.full((len(numbers) // dimensions, 3), np.nan)
    sums = np.cumsum(np.array(numbers, dtype=float).reshape(-1, dimensions), axis=0)
    points[:, :dimensions] = sums / 10.0**np.array((places, places, *third_places))
    return points


def _misfit(points: FloatArray, length_m: float) -> float:
    latitude_deg, longitude_deg, _ = points.T
    if np.abs(latitude_deg).max() > 90.0 or np.abs(longitude_deg).max() > 180.0:
        return np.inf
    own_m = max(float(distances_m(latitude_deg, longitude_deg).sum()), 1e-3)
    return abs(float(np.log(own_m / max(length_m, 1e-3))))
