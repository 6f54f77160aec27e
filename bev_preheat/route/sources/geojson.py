# SPDX-License-Identifier: Apache-2.0
"""
Reads GeoJSON (RFC 7946): LineString or MultiLineString, alone or in features.

Times of the points are taken from properties.coordTimes (or times, coordinateProperties.times), durations of parts
of the line from properties.segments[].steps[] with way_points, as openrouteservice writes them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.times import iso_seconds
from bev_preheat.numerics import FloatArray
from bev_preheat.route.sources.journey import (
    check_coordinates,
    distances_m,
    Journey,
    journey_of_pieces,
    RouteOptions,
)
from bev_preheat.route.sources.json_values import checked, in_words, items
from bev_preheat.route.sources.navigation import in_units, leg_of, points_of, Service
from bev_preheat.route.sources.track import journey_of_points

KIND = 'GeoJSON line'
OPENROUTESERVICE = Service(KIND, '', 'segments', ('distance',), ('duration',), (), 'steps', ('duration',))
# Lines that follow each other end and begin within this distance [m].
MOST_GAP_M = 1000.0


def read_geojson(contents: Any, options: RouteOptions) -> Journey:
    """Return the Journey of the lines in a GeoJSON object; raise InvalidInput naming the key."""
    lines = _lines(contents, 'GeoJSON', {})
    if not lines:
        raise InvalidInput(f'has no LineString; its type is {quoted(str(contents.get("type")))}')
    points = [points_of(coordinates, f'{place}.coordinates') for coordinates, place, _ in lines]
    for (one, other), (_, place, _) in zip(zip(points, points[1:]), lines[1:]):
        gap_m = float(distances_m(*np.stack((one[-1], other[0]), axis=1)[:2])[0])
        if gap_m > MOST_GAP_M:
            raise InvalidInput(f'{place}: begins {gap_m / 1e3:.1f} km from the end of the line before it; keep '
                               'one route in the file')
    remarks = [f'{len(lines)} lines are joined in their order'] if len(lines) > 1 else []
    latitude_deg, longitude_deg, elevation_m = np.concatenate(points).T
    check_coordinates(latitude_deg, longitude_deg, 'coordinate')
    properties = lines[0][2]
    if len(lines) == 1 and isinstance(properties.get('segments'), list):
        service = in_units(OPENROUTESERVICE, contents)
        legs = [part for at, segment in enumerate(properties['segments'])
                for part in leg_of(segment, f'properties.segments[{at}]', service)]
        if not legs:
            raise InvalidInput('properties.segments: is empty')
        return journey_of_pieces(KIND, legs, options, ['the mean speed of each step is used'],
                                 np.array((latitude_deg, longitude_deg, elevation_m)))
    times = [_times(line_properties, len(line)) for (_, _, line_properties), line in zip(lines, points)]
    time_s = None if any(each is None for each in times) else np.concatenate(
        [each for each in times if each is not None])
    return journey_of_points(KIND, latitude_deg, longitude_deg, elevation_m, time_s, options, remarks,
                             'coordinate')


def _lines(node: Any, place: str, properties: dict[str, Any]) -> list[tuple[list[Any], str, dict[str, Any]]]:
    """Return (coordinates, place, properties) of each line in a GeoJSON object."""
    if node is None:
        return []
    if not isinstance(node, dict):
        raise InvalidInput(f'{place}: must be an object, not {in_words(node)}')
    kind = node.get('type')
    if kind == 'FeatureCollection':
        return [line for at, feature in enumerate(items(node, 'features', place))
                for line in _lines(feature, f'features[{at}]', {})]
    if kind == 'Feature':
        own = node.get('properties')
        return _lines(node.get('geometry'), f'{place}.geometry', own if isinstance(own, dict) else {})
    if kind == 'GeometryCollection':
        return [line for at, geometry in enumerate(items(node, 'geometries', place))
                for line in _lines(geometry, f'{place}.geometries[{at}]', properties)]
    if kind == 'LineString':
        return [(items(node, 'coordinates', place), place, properties)]
    if kind == 'MultiLineString':
        lines: list[tuple[list[Any], str, dict[str, Any]]] = []
        for at, line in enumerate(items(node, 'coordinates', place)):
            if not isinstance(line, list):
                raise InvalidInput(f'{place}.coordinates[{at}]: must be a list of coordinates, not '
                                   f'{in_words(line)}')
            lines.append((line, f'{place}.coordinates[{at}]', {}))
        return lines
    return []


def _times(properties: dict[str, Any], count: int) -> FloatArray | None:
    """Return the times [s] of a line's points, None without them."""
    nested = properties.get('coordinateProperties')
    values = properties.get('coordTimes') or properties.get('times') or (
        nested.get('times') if isinstance(nested, dict) else None)
    if values is None:
        return None
    if not isinstance(values, list) or len(values) != count:
        raise InvalidInput(f'properties.coordTimes: must be a list of {count} times, one for each coordinate')
    seconds = []
    for at, value in enumerate(values):
        if isinstance(value, str):
            seconds.append(iso_seconds(value))
            if np.isnan(seconds[-1]):
                raise InvalidInput(f'properties.coordTimes[{at}]: {quoted(value)} is not a time as in ISO 8601: '
                                   '2026-01-31T08:00:00Z')
        else:
            # Milliseconds since 1970, as JavaScript counts, or seconds.
            number_of = checked(value, f'properties.coordTimes[{at}]')
            seconds.append(number_of / 1000.0 if number_of > 1e11 else number_of)
    return np.array(seconds)
