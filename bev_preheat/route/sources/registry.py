# SPDX-License-Identifier: Apache-2.0
"""Chooses the reader of a route's file by its content; names and suffixes do not count."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

from bev_preheat.errors import InvalidInput, located
from bev_preheat.files.input_files import beginning_of
from bev_preheat.files.table import read_table, Table
from bev_preheat.route.sources.headers import headers_of
from bev_preheat.route.sources.journey import Journey, RouteOptions
from bev_preheat.route.sources.table import is_track, journey_of_table, journey_of_track

# Largest file [bytes]; a day of samples at 10 Hz has less.
LARGEST_FILE = 64_000_000
# Enough text to recognise a format.
BEGINNING = 4096
UTF_16 = b'\xff\xfe', b'\xfe\xff'
# Purpose of fields of RouteOptions that only some formats use.
PURPOSES = {'free_speed_kmh': 'a line on the map without times',
            'stop_duration_s': 'an answer of navigation with waypoints',
            'vehicle_id': 'the battery output of SUMO'}
ROOT_ELEMENT = re.compile(rb'<(?![?!])(?:[\w.-]+:)?([\w.-]+)')
COMMENT = re.compile(rb'<!--.*?-->', re.DOTALL)
GEOJSON_TYPES = ('FeatureCollection', 'Feature', 'LineString', 'MultiLineString', 'GeometryCollection', 'Point',
                 'MultiPoint', 'Polygon', 'MultiPolygon')


def read_journey(path: Path, options: RouteOptions) -> Journey | Table:
    """Return the Journey of a file, the Table of a route file with powers; InvalidInput names place and remedy."""
    kind = kind_of(path)
    if kind == 'table':
        table = read_table(path)
        if _has_powers(table):
            return table
        with located(path):
            _refuse_unused(options, ('free_speed_kmh',) if is_track(table) else ())
        return journey_of_track(table, options) if is_track(table) else journey_of_table(table)
    with located(path):
        return (_read_xml if kind == 'xml' else _read_json)(path.read_bytes(), options)


def kind_of(path: Path) -> str:
    """Return 'xml', 'json' or 'table'; raise InvalidInput if a file is too large, binary or cannot be read."""
    beginning, size = beginning_of(path, BEGINNING), path.stat().st_size
    if size > LARGEST_FILE:
        raise InvalidInput(f'{path}: has {size / 1e6:.0f} MB; at most {LARGEST_FILE / 1e6:.0f} MB are read')
    if b'\0' in beginning and not beginning.startswith(UTF_16):
        raise InvalidInput(f'{path}: is a binary file; routes are text: CSV, GPX, GeoJSON, JSON or XML')
    first = _plain(beginning).lstrip()[:1]
    return {b'<': 'xml', b'{': 'json', b'[': 'json'}.get(first, 'table')


def _plain(text: bytes) -> bytes:
    """Return a text of UTF-8 or UTF-16 in UTF-8 without its mark; its end may cut a character."""
    return (text.decode('utf-16', 'ignore').encode('utf-8', 'replace') if text.startswith(UTF_16) else
            text.removeprefix(b'\xef\xbb\xbf'))


def has_powers(path: Path) -> bool:
    """Return whether a file is a route file with powers."""
    return kind_of(path) == 'table' and _has_powers(read_table(path))


def _has_powers(table: Table) -> bool:
    """Return whether a table has powers, or no column that describes a motion."""
    known = headers_of(table)[0].keys()
    return bool(known & {'propulsion_power', 'propulsion_power_rms', 'propulsion_power_magnitude'}) or (
        not known & {'time', 'speed', 'duration', 'length', 'latitude'})


def _refuse_unused(options: RouteOptions, used: tuple[str, ...]) -> None:
    """Raise InvalidInput if an option is given that a format does not use."""
    for figure, purpose in PURPOSES.items():
        if getattr(options, figure) is not None and figure not in used:
            raise InvalidInput(f'{options.name(figure)}: is only for {purpose}')


def _read_xml(text: bytes, options: RouteOptions) -> Journey:
    root = ROOT_ELEMENT.search(COMMENT.sub(b'', _plain(text[:1_000_000])))
    name = root[1].decode('ascii', 'replace') if root else ''
    if name == 'gpx':
        from bev_preheat.route.sources.xml_files import read_gpx
        _refuse_unused(options, ('free_speed_kmh',))
        return read_gpx(text, options)
    if name in ('battery-export', 'battery-output'):
        from bev_preheat.route.sources.xml_files import read_sumo
        _refuse_unused(options, ('vehicle_id',))
        return read_sumo(text, options)
    if not name:
        raise InvalidInput('is not XML: it has no element; is the file complete?')
    hint = '; export the route as GPX' if name in ('kml', 'TrainingCenterDatabase') else ''
    raise InvalidInput(f'the element <{name}> is no route that can be read; <gpx> and <battery-export> (SUMO) '
                       f'are{hint}')


def _read_json(text: bytes, options: RouteOptions) -> Journey:
    from bev_preheat.route.sources.json_values import parse_json
    from bev_preheat.route.sources.navigation import read_navigation, service_of
    contents: Any = parse_json(text)
    service = service_of(contents)
    if service is not None:
        _refuse_unused(options, ('stop_duration_s',))
        return read_navigation(contents, service, options)
    if isinstance(contents, dict) and contents.get('type') in GEOJSON_TYPES:
        from bev_preheat.route.sources.geojson import read_geojson
        _refuse_unused(options, ('free_speed_kmh', 'stop_duration_s'))
        return read_geojson(contents, options)
    from bev_preheat.route.sources.json_values import read_records
    _refuse_unused(options, ())
    return read_records(contents)
