# SPDX-License-Identifier: Apache-2.0
"""Reads answers of Valhalla: maneuvers with times and lengths, the shape as a polyline of 6 places."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.route.sources.json_text import items, number, numbers
from bev_preheat.route.sources.pieces import journey_of_pieces, Pieces
from bev_preheat.route.sources.polyline import decode_polyline

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.route.sources.journey import Journey, RouteOptions

KIND = 'Valhalla answer'
M_PER_UNIT = {'kilometers': 1000.0, 'km': 1000.0, 'miles': 1609.344, 'mi': 1609.344}
PLACES = 6
ELEVATION_INTERVAL_M = 30.0


def read_valhalla(contents: Any, options: RouteOptions) -> Journey:
    """Return the Journey of an answer; raise InvalidInput naming the key."""
    trip = contents.get('trip')
    if not isinstance(trip, dict):
        raise InvalidInput(f'the service found no route: '
                           f'{quoted(str(contents.get("error", "no trip in the answer")))}')
    if trip.get('status', 0) != 0:
        raise InvalidInput(f'the service found no route: '
                           f'{quoted(str(trip.get("status_message", trip["status"])))}')
    units = trip.get('units', 'kilometers')
    if not isinstance(units, str) or units not in M_PER_UNIT:
        raise InvalidInput(f'trip.units: {quoted(str(units))} is not known; it must be kilometers or miles')
    metres = M_PER_UNIT[units]
    legs, lines, heights, remarks, length_m = [], [], [], [], 0.0
    for at, leg in enumerate(items(trip, 'legs', 'trip')):
        place = f'trip.legs[{at}]'
        maneuvers = items(leg, 'maneuvers', place)
        if not maneuvers:
            raise InvalidInput(f'{place}.maneuvers: is empty')
        pieces = Pieces(*(np.array([number(maneuver, key, f'{place}.maneuvers[{index}]')
                                    for index, maneuver in enumerate(maneuvers)]) * factor
                          for key, factor in (('length', metres), ('time', 1.0))))
        legs.append(pieces)
        if 'shape' in leg:
            try:
                lines.append(decode_polyline(leg['shape'], PLACES))
            except InvalidInput as error:
                raise InvalidInput([f'{place}.shape: {problem}' for problem in error.problems]) from error
        if 'elevation' in leg:
            elevation_m = numbers(leg, 'elevation', place, -500.0, 9000.0)
            interval_m = number(leg, 'elevation_interval', place, 0.1, 1e5) if 'elevation_interval' in leg \
                else ELEVATION_INTERVAL_M
            if len(elevation_m) >= 2:
                along_m = np.minimum(np.arange(len(elevation_m)) * interval_m, pieces.length_m.sum())
                heights.append((length_m + along_m, elevation_m))
        length_m += float(pieces.length_m.sum())
    if not legs:
        raise InvalidInput('trip.legs: is empty')
    remarks.append('the mean speed of each maneuver is used')
    line = _joined(lines) if len(lines) == len(legs) else None
    return journey_of_pieces(KIND, legs, options, remarks, line, _joined(heights) if heights else None)


def _joined(parts: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    first, second = (np.concatenate(column) for column in zip(*parts))
    return first, second
