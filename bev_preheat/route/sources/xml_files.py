# SPDX-License-Identifier: Apache-2.0
"""Reads routes in XML: tracks and routes of GPX 1.0 and 1.1, and the battery output of SUMO (battery-export)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table import Table
from bev_preheat.files.times import iso_seconds
from bev_preheat.files.units import NUMBER, split_unit
from bev_preheat.numerics import FloatArray
from bev_preheat.route.sources.headers import column, headers_of
from bev_preheat.route.sources.journey import distances_m, Journey, RouteOptions
from bev_preheat.route.sources.table import journey_of_table
from bev_preheat.route.sources.track import journey_of_points

# Deeper nesting is no route.
MOST_DEPTH = 50


def check_xml(text: bytes, on_element: Callable[[str, dict[str, str], int], None] | None = None) -> None:
    """Refuse a text that is no plain XML, by line; `on_element` gets name, attributes and line of each element."""
    parser = expat.ParserCreate()
    depth = 0

    def refuse(*_: object) -> None:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: has a document type (<!DOCTYPE …>); delete it: '
                           'routes need none')

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            raise InvalidInput(f'line {parser.CurrentLineNumber}: elements are nested more than {MOST_DEPTH} deep')
        if on_element is not None:
            on_element(name.rpartition(':')[2], attributes, parser.CurrentLineNumber)

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InvalidInput(f'line {error.lineno}: is not XML: {expat.ErrorString(error.code)}; is the file '
                           'complete?') from error
    except InvalidInput:
        raise
    except (ValueError, LookupError) as error:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: is not XML: {error}') from error


# Largest share of points without the time that the others have, and of the way that is lost with them.
MOST_WITHOUT_TIME = 0.5
MOST_LOST = 0.02


def read_gpx(text: bytes, options: RouteOptions) -> Journey:
    """Return the Journey of a GPX file; raise InvalidInput naming line or point and what to do."""
    check_xml(text)
    remarks: list[str] = []
    kind, element, nodes = _nodes(ElementTree.fromstring(text), remarks)
    points = np.array([_point(node, f'{element} {at}') for at, node in enumerate(nodes, start=1)])
    timed = np.isfinite(points[:, 3])
    without = int((~timed).sum())
    has_times = without <= MOST_WITHOUT_TIME * len(points)
    if has_times and without:
        kept = np.flatnonzero(timed)
        first, end = kept[0], kept[-1] + 1
        # Between points with times the way is at least bridged by a line.
        lost_m = (_length_m(points[:first]) + _length_m(points[end:])
                  + _length_m(points[first:end]) - _length_m(points[timed]))
        all_m = _length_m(points[timed]) + lost_m
        if lost_m > MOST_LOST * all_m:
            raise InvalidInput(f'{without} of {len(points)} {element}s have no time, from {element} '
                               f'{int(np.argmin(timed)) + 1} on, and with them {lost_m / 1e3:.1f} km of '
                               f'{all_m / 1e3:.1f} km would be lost; take out the part without times, or take out '
                               f'all times and {options.advice("free_speed_kmh", "give the speed on free road")}')
        remarks.append(f'{without} {element}s without a time are left out, {lost_m:.0f} m of {all_m / 1e3:.1f} km')
        points = points[timed]
    if not has_times and without < len(points):
        remarks.append(f'only {len(points) - without} of {len(points)} points have a time: times are not used')
    latitude_deg, longitude_deg, elevation_m, time_s = points.T
    if has_times and time_s[0] == time_s[-1]:
        remarks.append('all points have the same time: times are not used')
        has_times = False
    return journey_of_points(kind, latitude_deg, longitude_deg, elevation_m, time_s if has_times else None,
                             options, remarks, element)


def _nodes(root: ElementTree.Element, remarks: list[str]) -> tuple[str, str, list[ElementTree.Element]]:
    """Return the kind, the name of an element, and the points of the tracks, or of the routes."""
    for kind, line, element in (('GPX track', 'trk', 'trkpt'), ('GPX route', 'rte', 'rtept')):
        lines = [each.findall(f'.//{{*}}{element}') for each in root.iterfind(f'{{*}}{line}')]
        if lines := list(filter(None, lines)):
            if len(lines) > 1:
                remarks.append(f'{len(lines)} {kind.removeprefix("GPX ")}s are joined in their order')
            return kind, element, [point for points in lines for point in points]
    waypoints = sum(1 for _ in root.iterfind('{*}wpt'))
    more = f'; it has {waypoints} waypoints (wpt), which are no route' if waypoints else ''
    raise InvalidInput(f'has no track (trk) and no route (rte) with points{more}')


def _point(node: ElementTree.Element, place: str) -> list[float]:
    """Return latitude, longitude, elevation and time of a point; NaN for a missing elevation or time."""
    values = []
    for name, text in (('lat', node.get('lat', '')), ('lon', node.get('lon', '')),
                       ('ele', node.findtext('{*}ele') or 'nan')):
        match = NUMBER.fullmatch(text.strip())
        if text != 'nan' and (match is None or match[2]):
            raise InvalidInput(f'{place}: {name}: {quoted(text)} is not a number')
        values.append(float(text))
    time = (node.findtext('{*}time') or '').strip()
    seconds = iso_seconds(time)
    if time and np.isnan(seconds):
        raise InvalidInput(f'{place}: time: {quoted(time)} is not a time as in ISO 8601: 2026-01-31T08:00:00Z')
    return [*values, seconds]


def _length_m(points: FloatArray) -> float:
    return float(distances_m(points[:, 0], points[:, 1]).sum())


KIND = 'SUMO battery output'
# Vehicles named in a message.
NAMED_VEHICLES = 8
HEADER = ('time_s', 'speed_mps', 'consumption_wh')


def read_sumo(text: bytes, options: RouteOptions) -> Journey:
    """Return the Journey of the only vehicle, or of that of the options; refuse others by timestep."""
    rows: dict[str, list[tuple[str, str, str]]] = {}
    time = ['']
    root: list[str] = []

    def on_element(name: str, attributes: dict[str, str], line: int) -> None:
        if not root:
            root.append(name)
        if name == 'timestep':
            time[0] = attributes.get('time', '')
        elif name == 'vehicle':
            missing = [key for key in ('id', 'speed', 'energyConsumed') if key not in attributes]
            if missing:
                raise InvalidInput(f'line {line}: vehicle: missing {missing[0]}')
            rows.setdefault(attributes['id'], []).append(
                (time[0], attributes['speed'], attributes['energyConsumed']))

    check_xml(text, on_element)
    if not rows:
        raise InvalidInput(f'{root[0] if root else "the file"}: has no vehicle with a battery; the simulation '
                           'needs --battery-output and a vehicle with has.battery.device')
    chosen = _chosen(rows, options)
    table = Table(f'vehicle {quoted(chosen)}', HEADER, tuple(split_unit(name).unit for name in HEADER),
                  tuple(zip(*rows[chosen])), range(len(rows[chosen])), row_name='timestep')
    journey = journey_of_table(table)
    energy_wh = column(table, headers_of(table)[0]['consumption'])
    # The energy of a timestep is that of the step that ends with it.
    return replace(journey, kind=KIND, consumption_wh=energy_wh[1:],
                   remarks=(f'vehicle {chosen} of the simulation',))


def _chosen(rows: dict[str, list[tuple[str, str, str]]], options: RouteOptions) -> str:
    names = ', '.join(list(rows)[:NAMED_VEHICLES]) + (', …' if len(rows) > NAMED_VEHICLES else '')
    if options.vehicle_id is not None:
        if options.vehicle_id not in rows:
            raise InvalidInput(f'{options.name("vehicle_id")}: {quoted(options.vehicle_id)} is not in the file; '
                               f'it has: {names}')
        return options.vehicle_id
    if len(rows) > 1:
        raise InvalidInput(f'has {len(rows)} vehicles, {names}; '
                           + options.advice('vehicle_id', 'choose one', next(iter(rows))))
    return next(iter(rows))
