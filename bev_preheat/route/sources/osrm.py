# SPDX-License-Identifier: Apache-2.0
"""
Reads answers of OSRM and of services with the same form (Mapbox, Valhalla with format=osrm, openrouteservice).

The annotations have a distance and a duration for each edge of the map; without them the steps are used, without
steps the legs. The durations of annotations leave out turns and traffic lights; they are scaled to the leg's.
"""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.route.sources.json_text import checked, items, number, numbers
from bev_preheat.route.sources.pieces import journey_of_pieces, Pieces
from bev_preheat.route.sources.polyline import decode_by_length

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.route.sources.journey import Journey, RouteOptions

KIND = 'OSRM answer'
# The sum of the annotations' durations over the leg's: beyond this range they do not belong together.
SCALE_RANGE = (0.5, 3.0)


def read_osrm(contents: Any, options: RouteOptions) -> Journey:
    """Return the Journey of the first route of an answer; raise InvalidInput naming the key."""
    code = contents.get('code')
    if code is not None and code not in ('Ok', 'ok'):
        message = contents.get('message')
        raise InvalidInput(f'the service found no route: code {quoted(str(code))}'
                           f'{f", {quoted(str(message))}" if message else ""}')
    name = 'routes' if 'routes' in contents else 'matchings'
    routes = items(contents, name, 'answer')
    if not routes:
        raise InvalidInput(f'{name}: is empty; the service found no route')
    remarks = [f'{len(routes)} routes in the answer: the first one is used'] if len(routes) > 1 else []
    route, place = routes[0], f'{name}[0]'
    if not isinstance(route, dict):
        raise InvalidInput(f'{place}: must be an object')
    legs_key = 'legs' if 'legs' in route else 'segments'
    scales: list[float] = []
    legs = [_leg(leg, f'{place}.{legs_key}[{at}]', remarks, scales)
            for at, leg in enumerate(items(route, legs_key, place))]
    if not legs:
        raise InvalidInput(f'{place}.{legs_key}: is empty')
    length_m = float(sum(leg.length_m.sum() for leg in legs))
    if scales:
        remarks.append(f'durations of the edges are scaled by {_span(scales)} to the durations of the legs, which '
                       'include turns and traffic lights')
    return journey_of_pieces(KIND, legs, options, list(dict.fromkeys(remarks)), _line(route, length_m, place))


def _span(scales: list[float]) -> str:
    low, high = f'{min(scales):.3f}', f'{max(scales):.3f}'
    return low if low == high else f'{low} ... {high}'


def _leg(leg: Any, place: str, remarks: list[str], scales: list[float]) -> Pieces:
    total_s, total_m = number(leg, 'duration', place), number(leg, 'distance', place)
    annotation = leg.get('annotation')
    if annotation is not None and not isinstance(annotation, dict):
        raise InvalidInput(f'{place}.annotation: must be an object')
    if annotation and ('duration' in annotation or 'speed' in annotation) and 'distance' in annotation:
        pieces = _annotated(annotation, f'{place}.annotation')
        own_s = float(pieces.duration_s.sum())
        if own_s > 0.0 and abs(own_s - total_s) > 0.001 * total_s:
            low, high = SCALE_RANGE
            if not low <= total_s / own_s <= high:
                raise InvalidInput(f'{place}: duration: {total_s:g} s, but the annotations add up to {own_s:.0f} '
                                   's')
            scales.append(total_s / own_s)
            pieces = pieces.scaled_to(total_s)
        return pieces
    steps = leg.get('steps')
    if steps:
        places = [f'{place}.steps[{at}]' for at in range(len(items(leg, 'steps', place)))]
        remarks.append('no annotations: the mean speed of each step is used; ask the service for annotations=true')
        return Pieces(np.array([number(step, 'distance', name) for step, name in zip(steps, places)]),
                      np.array([number(step, 'duration', name) for step, name in zip(steps, places)]))
    remarks.append('no annotations and no steps: the mean speed of the whole leg is used; ask the service for '
                   'annotations=true')
    return Pieces(np.array([total_m]), np.array([total_s]))


def _annotated(annotation: dict[str, Any], place: str) -> Pieces:
    length_m = numbers(annotation, 'distance', place)
    if 'duration' in annotation:
        duration_s = numbers(annotation, 'duration', place)
    else:
        speed_mps = numbers(annotation, 'speed', place, high=100.0)
        duration_s = np.divide(length_m[:len(speed_mps)], speed_mps[:len(length_m)],
                               out=np.zeros(min(len(length_m), len(speed_mps))),
                               where=speed_mps[:len(length_m)] > 0.0)
    if len(duration_s) != len(length_m):
        raise InvalidInput(f'{place}: distance has {len(length_m)} values, duration or speed '
                           f'{len(duration_s)}; they must be equally many')
    if not len(length_m):
        raise InvalidInput(f'{place}.distance: is empty')
    return Pieces(length_m, duration_s)


def _line(route: dict[str, Any], length_m: float, place: str) -> tuple[FloatArray, FloatArray] | None:
    """Return the line of a route on the map, from its geometry or from that of its steps; None without one."""
    geometry = route.get('geometry')
    if geometry is not None:
        return line_of(geometry, length_m, f'{place}.geometry')
    parts = []
    for at, leg in enumerate(route.get('legs') or ()):
        for index, step in enumerate(leg['steps'] if isinstance(leg.get('steps'), list) else ()):
            if isinstance(step, dict) and step.get('geometry'):
                where = f'{place}.legs[{at}].steps[{index}]'
                parts.append(line_of(step['geometry'], number(step, 'distance', where), f'{where}.geometry'))
    if not parts:
        return None
    latitudes, longitudes = (np.concatenate(column) for column in zip(*parts))
    return (latitudes, longitudes) if len(latitudes) >= 2 else None


def line_of(geometry: Any, length_m: float, place: str) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes [deg] of an encoded polyline or of a GeoJSON LineString."""
    if isinstance(geometry, dict):
        pairs = items(geometry, 'coordinates', place)
        points = []
        for at, pair in enumerate(pairs):
            if not isinstance(pair, list) or len(pair) < 2:
                raise InvalidInput(f'{place}.coordinates[{at}]: must be [longitude, latitude]')
            points.append([checked(value, f'{place}.coordinates[{at}]', -180.0, 180.0) for value in pair[:2]])
        if len(points) < 2:
            raise InvalidInput(f'{place}.coordinates: has {len(points)} points; at least 2 are needed')
        array = np.array(points)
        return array[:, 1], array[:, 0]
    try:
        return decode_by_length(geometry, length_m)
    except InvalidInput as error:
        raise InvalidInput([f'{place}: {problem}' for problem in error.problems]) from error
