# SPDX-License-Identifier: Apache-2.0
"""
Reads answers of navigation services whose legs have a length and a duration: a table of keys, one row a service.

The parts of a leg (edges of the map, steps, instructions, spans) are used if their lengths add up to the leg's;
their durations are scaled to the leg's, which includes traffic, turns and lights. Charging stops of the answer are
kept with their durations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import re
from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, located, quoted
from bev_preheat.numerics import FloatArray
from bev_preheat.route.segments import ELEVATION_RANGE_M
from bev_preheat.route.sources.journey import Journey, journey_of_pieces, Pieces, RouteOptions
from bev_preheat.route.sources.json_values import checked, in_words, items, numbers
from bev_preheat.route.sources.polyline import decode_flexible, decode_points_by_length

# Durations as a text; the longest leg and charging stop [s], and the longest leg [m].
SECONDS = re.compile(r'([0-9]+(?:\.[0-9]*)?)s')
LONGEST_LEG_S, LONGEST_STOP_S, LONGEST_LEG_M = 1e6, 86400.0, 1e7
# Parts of a leg may add up to this share more or less than the leg, because they are rounded.
LEG_ROUNDING = 0.02
# The duration of a leg over that of its parts; beyond this range they do not belong together.
LEG_SCALE_RANGE = (0.5, 3.0)
# Valhalla's units of length [m], and the distance of its elevations [m] unless it is given.
M_PER_UNIT = {'kilometers': 1000.0, 'km': 1000.0, 'miles': 1609.344, 'mi': 1609.344, 'm': 1.0}
M_PER_FOOT = 0.3048
ELEVATION_INTERVAL_M = 30.0
# GraphHopper's sign of an instruction at a waypoint.
WAYPOINT_REACHED = 5
LATITUDE_LONGITUDE = re.compile(r'(-?[0-9]{1,3}(?:\.[0-9]*)?),(-?[0-9]{1,3}(?:\.[0-9]*)?)(,.*)?')
# Names of coordinates: a latitude and its longitude.
COORDINATES = (('latitude', 'longitude'), ('lat', 'lng'), ('lat', 'lon'))


@dataclass(frozen=True)
class Service:
    """
    The keys of a service; of several paths (keys with a dot between them) the first that exists counts.

    `routes` is the list of routes, or the only one ('': the answer is one), `legs` that of the legs in a route
    ('': the route is one). A unit of time is `second` [s], a unit of length `metre` [m].
    """

    kind: str
    routes: str
    legs: str
    length: tuple[str, ...]
    duration: tuple[str, ...]
    line: tuple[str, ...]
    parts: str = ''
    part_duration: tuple[str, ...] = ()
    second: float = 1.0
    metre: float = 1.0
    # Lists of instants along the route: distance and time from its start.
    progress: tuple[tuple[str, str], ...] = ()


SERVICES = (
    Service('TomTom answer', 'routes', 'legs', ('summary.lengthInMeters',), ('summary.travelTimeInSeconds',),
            ('points', 'encodedPolyline'),
            progress=(('progress', 'distanceInMeters'), ('guidance.instructions', 'routeOffsetInMeters'))),
    Service('HERE answer', 'routes', 'sections', ('travelSummary.length', 'summary.length'),
            ('travelSummary.duration', 'summary.duration'), ('polyline',), 'spans', ('duration',)),
    Service('HERE answer', 'response.route', 'leg', ('length',), ('travelTime',), ('shape',), 'maneuver',
            ('travelTime',)),
    Service('Google answer', 'routes', 'legs', ('distanceMeters', 'distance.value'),
            ('duration_in_traffic.value', 'duration.value', 'duration'),
            ('polyline', 'overview_polyline'), 'steps', ('staticDuration', 'duration.value')),
    Service('Google answer', 'routes', '', ('distanceMeters',), ('duration',), ('polyline',)),
    Service('GraphHopper answer', 'paths', '', ('distance',), ('time',), ('points',), 'instructions', ('time',),
            1e-3),
    *(Service('OSRM answer', routes, legs, ('distance',), ('duration',), ('geometry',), 'steps', ('duration',))
      for routes in ('routes', 'matchings') for legs in ('legs', 'segments')),
    Service('Valhalla answer', 'trip', 'legs', ('summary.length',), ('summary.time',), ('shape',), 'maneuvers',
            ('time',)),
    Service('routingpy route', '', '', ('distance',), ('duration',), ('geometry',)),
)
PART_LENGTH = ('distanceMeters', 'distance.value', 'distance', 'length')


def service_of(contents: Any) -> Service | None:
    """Return the Service whose keys an answer has, None without one."""
    for service in SERVICES:
        route = _routes(contents, service)[0]
        leg = route
        if service.legs and isinstance(route, dict):
            legs = route.get(service.legs)
            leg = legs[0] if isinstance(legs, list) and legs else None
        if all(_found(leg, paths) is not None for paths in (service.length, service.duration)) and (
                service.routes or _found(leg, service.line) is not None):
            return service
    return None


def read_navigation(contents: Any, service: Service, options: RouteOptions) -> Journey:
    """Return the Journey of the first route of an answer; raise InvalidInput naming the key."""
    route, *others = _routes(contents, service)
    place = f'{service.routes}[0]' if service.routes else 'route'
    remarks: list[str] = []
    service, place = in_units(service, contents), 'trip' if service.routes == 'trip' else place
    if others:
        remarks.append(f'{1 + len(others)} routes in the answer: the first one is used')
    nodes = [(leg, f'{place}.{service.legs}[{at}]') for at, leg in enumerate(items(route, service.legs, place))] \
        if service.legs else [(route, place)]
    legs = [part for leg, where in nodes for part in leg_of(leg, where, service)]
    legs = _with_progress(legs, route, service, place)
    if any(len(leg.length_m) == 1 for leg in legs):
        remarks.append('the mean speed of each leg is used; the answer has no steps that fit' if service.legs else
                       'the mean speed of the whole way is used; the answer has no steps that fit')
    points = _line(route, legs, nodes, service, place)
    return journey_of_pieces(service.kind, legs, options, remarks, points, _heights(nodes, service))


def in_units(service: Service, contents: Any) -> Service:
    """Return the Service with the unit of length that an answer states: Valhalla's, openrouteservice's."""
    default = '', 'kilometers' if service.routes == 'trip' else 'm'
    path, units = _found(contents, ('trip.units', 'metadata.query.units')) or default
    if not isinstance(units, str) or units not in M_PER_UNIT:
        raise InvalidInput(f'{path}: {quoted(str(units))} is not one of {", ".join(M_PER_UNIT)}')
    return replace(service, metre=M_PER_UNIT[units])


def _routes(contents: Any, service: Service) -> list[Any]:
    """Return the routes of an answer; the first is None without one."""
    if not service.routes:
        # Several objects are a list of segments.
        return contents if isinstance(contents, list) and len(contents) == 1 else [contents]
    found = _found(contents, (service.routes,))
    routes = None if found is None else found[1]
    return routes or [None] if isinstance(routes, list) else [routes]


def _found(node: Any, paths: tuple[str, ...]) -> tuple[str, Any] | None:
    """Return the first path that is there, and its value."""
    for path in paths:
        value = node
        for key in path.split('.'):
            value = value.get(key) if isinstance(value, dict) else None
        if value is not None:
            return path, value
    return None


def _figure(node: Any, paths: tuple[str, ...], place: str, most: float) -> float:
    """Return a number, or the number of a text such as 750s; raise InvalidInput naming the key."""
    found = _found(node, paths)
    if found is None:
        raise InvalidInput(f'{place}: missing {" or ".join(paths)}' if isinstance(node, dict) else
                           f'{place}: must be an object, not {in_words(node)}')
    path, value = found
    text = SECONDS.fullmatch(value) if isinstance(value, str) else None
    return checked(float(text[1]) if text else value, f'{place}.{path}', 0.0, most)


def leg_of(leg: Any, place: str, service: Service) -> list[Pieces]:
    """Return a leg; in several parts if an instruction within says that a waypoint is reached."""
    length_m = _figure(leg, service.length, place, LONGEST_LEG_M) * service.metre
    duration_s = _figure(leg, service.duration, place, LONGEST_LEG_S / service.second) * service.second
    stop_s, actions_s = _stops_s(leg, place)
    found = _found(leg, service.duration)
    if found is not None and found[0] == 'summary.duration':
        # HERE's summary includes the actions before and after the drive.
        duration_s = max(duration_s - actions_s, 0.0)
    whole = Pieces(np.array([length_m]), np.array([duration_s]), stop_s=stop_s)
    slowest, fastest = LEG_SCALE_RANGE
    fitting = [pieces for pieces in (_edges(leg, place), _parts(leg, place, service)) if pieces is not None
               and abs(float(pieces.length_m.sum()) - length_m) <= LEG_ROUNDING * length_m
               and slowest <= duration_s / max(float(pieces.duration_s.sum()), 1e-9) <= fastest]
    if not fitting:
        return [whole]
    fine = replace(fitting[0].scaled_to(duration_s), stop_s=stop_s)
    ends = [at + 1 for at, part in enumerate((leg.get(service.parts) or [])[:-1])
            if isinstance(part, dict) and part.get('sign') == WAYPOINT_REACHED]
    return [replace(fine, length_m=length_m, duration_s=duration_s) for length_m, duration_s in zip(
        np.split(fine.length_m, ends), np.split(fine.duration_s, ends))]


def _edges(leg: dict[str, Any], place: str) -> Pieces | None:
    """Return the edges of the map in the annotation of a leg, None without."""
    annotation, place = leg.get('annotation'), f'{place}.annotation'
    if not isinstance(annotation, dict) or 'distance' not in annotation or not (
            annotation.keys() & {'duration', 'speed'}):
        return None
    length_m = numbers(annotation, 'distance', place)
    other = numbers(annotation, 'duration' if 'duration' in annotation else 'speed', place)
    if len(other) != len(length_m):
        raise InvalidInput(f'{place}: distance has {len(length_m)} values, duration or speed {len(other)}; they '
                           'must be equally many')
    if 'duration' in annotation:
        return Pieces(length_m, other)
    return Pieces(length_m, np.divide(length_m, other, out=np.zeros(len(other)), where=other > 0.0))


def _parts(leg: dict[str, Any], place: str, service: Service) -> Pieces | None:
    """Return the parts of a leg, None without, or if one has no length or no duration."""
    parts = leg.get(service.parts)
    if not isinstance(parts, list) or not parts or any(
            _found(part, paths) is None for part in parts for paths in (PART_LENGTH, service.part_duration)):
        return None
    figures = np.array([(_figure(part, PART_LENGTH, f'{place}.{service.parts}[{at}]', LONGEST_LEG_M),
                         _figure(part, service.part_duration, f'{place}.{service.parts}[{at}]',
                                 LONGEST_LEG_S / service.second)) for at, part in enumerate(parts)])
    return Pieces(figures[:, 0] * service.metre, figures[:, 1] * service.second)


def _heights(nodes: list[tuple[Any, str]], service: Service) -> tuple[FloatArray, FloatArray] | None:
    """Return distances and elevations [m] of Valhalla's answer; None without."""
    parts, begin_m = [], 0.0
    for leg, place in nodes if service.routes == 'trip' else ():
        length_m = _figure(leg, service.length, place, LONGEST_LEG_M) * service.metre
        if leg.get('elevation'):
            # Beside miles both are in feet.
            unit_m = M_PER_FOOT if service.metre == M_PER_UNIT['miles'] else 1.0
            values_m = unit_m * numbers(leg, 'elevation', place, *(end / unit_m for end in ELEVATION_RANGE_M))
            interval_m = unit_m * checked(leg.get('elevation_interval', ELEVATION_INTERVAL_M / unit_m),
                                          f'{place}.elevation_interval', 0.1, 1e5)
            parts.append((begin_m + np.minimum(np.arange(len(values_m)) * interval_m, length_m), values_m))
        begin_m += length_m
    if not parts:
        return None
    at_m, elevation_m = (np.concatenate(column) for column in zip(*parts))
    return at_m, elevation_m


def _stops_s(leg: dict[str, Any], place: str) -> tuple[float, float]:
    """Return the time of charging at the end of a leg, and of all actions before and after its drive [s]."""
    tomtom = ('summary.chargingInformationAtEndOfLeg.chargingTimeInSeconds',)
    if _found(leg, tomtom) is not None:
        return (_figure(leg, tomtom, place, LONGEST_STOP_S),) * 2
    charging_s = total_s = 0.0
    for name in ('preActions', 'postActions'):
        for at, action in enumerate(items(leg, name, place) if name in leg else ()):
            if _found(action, ('duration',)) is None:
                continue
            duration_s = _figure(action, ('duration',), f'{place}.{name}[{at}]', LONGEST_STOP_S)
            total_s += duration_s
            charging_s += duration_s if str(action.get('action')).startswith('charging') else 0.0
    return charging_s, total_s


def _with_progress(legs: list[Pieces], route: Any, service: Service, place: str) -> list[Pieces]:
    """Return the legs with the times along the route, if the answer has some that end with the legs."""
    ends_m = np.cumsum([leg.length_m.sum() for leg in legs])
    ends_s = np.cumsum([leg.duration_s.sum() for leg in legs])
    for path, distance in service.progress:
        found = _found(route, (path,))
        if found is None or not isinstance(found[1], list) or len(found[1]) < 3:
            continue
        at_m, at_s = np.array([[_figure(node, (key,), f'{place}.{path}[{at}]', LONGEST_LEG_M)
                                for key in (distance, 'travelTimeInSeconds')]
                               for at, node in enumerate(found[1])]).T
        stops_s = np.array([leg.stop_s for leg in legs[:-1]])
        if abs(at_s[-1] / (ends_s[-1] + stops_s.sum()) - 1.0) <= LEG_ROUNDING:
            # The times include the charging.
            at_s = at_s - (at_m[:, np.newaxis] > ends_m[:-1]) @ stops_s
        if (np.diff(at_m) < 0.0).any() or (np.diff(at_s) < 0.0).any() or at_s[-1] <= 0.0 or max(
                abs(at_m[-1] / ends_m[-1] - 1.0), abs(at_s[-1] / ends_s[-1] - 1.0)) > LEG_ROUNDING:
            continue
        edges_m = [np.unique(np.concatenate(([begin_m], at_m[(at_m > begin_m) & (at_m < end_m)], [end_m])))
                   for begin_m, end_m in zip(np.concatenate(([0.0], ends_m)), ends_m)]
        return [Pieces(np.diff(edges), np.diff(np.interp(edges, at_m, at_s)), stop_s=leg.stop_s).scaled_to(
            float(leg.duration_s.sum())) for edges, leg in zip(edges_m, legs)]
    return legs


def _line(route: Any, legs: list[Pieces], nodes: list[tuple[Any, str]], service: Service,
          place: str) -> FloatArray | None:
    """Return latitudes, longitudes [deg] and elevations [m] (NaN: none) of the way, shape (3, M); None without."""
    lengths_m = [float(leg.length_m.sum()) for leg in legs]
    steps = [(step, f'{where}.{service.parts}[{at}]') for leg, where in nodes
             for at, step in enumerate(leg[service.parts] if isinstance(leg.get(service.parts), list) else ())]
    for owners, of_owners_m in (([(route, place)], [sum(lengths_m)]), (nodes, lengths_m), (steps, [])):
        found = [(_found(owner, service.line), where) for owner, where in owners]
        if not found or any(line is None for line, _ in found):
            continue
        of_owners_m = of_owners_m or [
            _figure(step, PART_LENGTH, where, LONGEST_LEG_M) * service.metre for step, where in steps]
        return np.concatenate([_points(line[1], f'{where}.{line[0]}', length_m, service)
                               for (line, where), length_m in zip(found, of_owners_m) if line is not None]).T
    return None


def _points(value: Any, place: str, length_m: float, service: Service) -> FloatArray:
    """Return latitude, longitude and elevation of the points of a line in any of the forms, shape (M, 3)."""
    inner = _found(value, ('coordinates', 'points', 'encodedPolyline', 'geoJsonLinestring'))
    if inner is not None:
        return _points(inner[1], f'{place}.{inner[0]}', length_m, service)
    if isinstance(value, list):
        return points_of(value, place)
    with located(place):
        return decode_flexible(value) if service.routes and service.legs == 'sections' else \
            decode_points_by_length(value, length_m)


def points_of(values: list[Any], place: str) -> FloatArray:
    """Return latitude, longitude and elevation (NaN: none) of the points in a list, shape (M, 3)."""
    points = np.array([_point(point, f'{place}[{at}]') for at, point in enumerate(values)])
    if len(points) < 2:
        raise InvalidInput(f'{place}: has {len(points)} points; at least 2 are needed')
    return points


def _point(point: Any, place: str) -> list[float]:
    """Return latitude, longitude, elevation (NaN: none) of an object, or of [longitude, latitude, elevation]."""
    if isinstance(point, str) and (match := LATITUDE_LONGITUDE.fullmatch(point)):
        # HERE's version 7.
        point = dict(zip(COORDINATES[0], map(float, match.group(1, 2))))
    if isinstance(point, dict):
        for names in COORDINATES:
            if all(name in point for name in names):
                return [checked(point[name], f'{place}.{name}', -180.0, 180.0) for name in names] + [np.nan]
    if not isinstance(point, list) or len(point) < 2:
        raise InvalidInput(f'{place}: must be [longitude, latitude], or an object with latitude and longitude, '
                           f'not {in_words(point)}')
    longitude, latitude = (checked(number, place, -180.0, 180.0) for number in point[:2])
    return [latitude, longitude,
            checked(point[2], place, *ELEVATION_RANGE_M) if len(point) > 2 and point[2] is not None else np.nan]
