# SPDX-License-Identifier: Apache-2.0
"""Decodes polylines: Google's Encoded Polyline Algorithm Format, with 5 or 6 decimal places."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.route.sources.timeline import distances_m

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Bits of a number in each character, and the sign that another one follows.
BITS, MORE, FIRST = 5, 0x20, 63
# A difference of coordinates has at most this many characters.
MOST_CHARACTERS = 8


def decode_polyline(text: object, places: int) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes [deg], shapes (M,); raise InvalidInput naming the character."""
    if not isinstance(text, str) or not text:
        raise InvalidInput('must be an encoded polyline (a text)')
    values, value, shift = [], 0, 0
    for at, sign in enumerate(text):
        code = ord(sign) - FIRST
        if not 0 <= code < 64:
            raise InvalidInput(f'character {at + 1}, {sign!r}, does not belong to an encoded polyline')
        value |= (code & (MORE - 1)) << shift
        shift += BITS
        if not code & MORE:
            values.append(~(value >> 1) if value & 1 else value >> 1)
            value, shift = 0, 0
        elif shift > BITS * MOST_CHARACTERS:
            raise InvalidInput(f'character {at + 1}: a number is too long for an encoded polyline')
    if shift or len(values) % 2:
        raise InvalidInput('the encoded polyline is cut off')
    points = np.cumsum(np.array(values, dtype=float).reshape(-1, 2), axis=0) / 10.0**places
    return points[:, 0], points[:, 1]


def decode_by_length(text: object, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates of a polyline with the number of places that fits its length [m] best."""
    return min((decode_polyline(text, places) for places in (5, 6)), key=lambda line: _misfit(line, length_m))


def _misfit(line: tuple[FloatArray, FloatArray], length_m: float) -> float:
    latitude_deg, longitude_deg = line
    if np.abs(latitude_deg).max() > 90.0 or np.abs(longitude_deg).max() > 180.0:
        return np.inf
    own_m = max(float(distances_m(latitude_deg, longitude_deg).sum()), 1e-3)
    return abs(float(np.log(own_m / max(length_m, 1e-3))))
