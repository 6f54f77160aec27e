# SPDX-License-Identifier: Apache-2.0
"""Reads lists of segments of route planners in JSON: a list of objects, or an object of lists."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.files.table import Table
from bev_preheat.files.units import split_unit
from bev_preheat.route.sources.table import journey_of_table
from bev_preheat.route.sources.texts import in_words

if TYPE_CHECKING:
    from bev_preheat.route.sources.journey import Journey

# Names of the list of segments in an object.
LISTS = ('segments', 'steps', 'legs', 'route', 'path', 'sections')


def read_records(contents: Any) -> Journey:
    """Return the Journey of a list of segments; raise InvalidInput naming segment, key and value."""
    records = contents
    if isinstance(contents, dict):
        lists = [name for name in LISTS if isinstance(contents.get(name), list)]
        if lists:
            records = contents[lists[0]]
        elif contents and all(isinstance(column, list) for column in contents.values()):
            records = _rows(contents)
        else:
            raise InvalidInput(_why_no_route(contents))
    if not isinstance(records, list) or not records:
        raise InvalidInput(f'is not a list of segments: {in_words(records)}')
    header: dict[str, None] = {}
    for at, record in enumerate(records):
        if not isinstance(record, dict):
            raise InvalidInput(f'segment {at + 1}: must be an object, not {in_words(record)}')
        for key, value in record.items():
            if isinstance(value, int | float | str) and not isinstance(value, bool):
                header[key] = None
    if not header:
        raise InvalidInput(f'segment 1: has no figures; its keys are: {_keys(records[0])}')
    # Texts, so that numbers are checked as in tables; a missing one is reported if its column is used.
    rows = [[_text(record.get(name)) for name in header] for record in records]
    return journey_of_table(Table('segments', tuple(header), tuple(split_unit(name).unit for name in header),
                                  tuple(zip(*rows)), range(1, len(rows) + 1), row_name='segment'))


def _why_no_route(contents: dict[str, Any]) -> str:
    """Return why an object is not a route: the message of the service, or else its keys."""
    error = next((contents[name] for name in ('error', 'detailedError', 'trip')
                  if isinstance(contents.get(name), dict)), contents)
    for name in ('message', 'description', 'error_message', 'status_message', 'title', 'error'):
        if isinstance(error.get(name), str):
            return f'the service found no route: {in_words(error[name])}'
    for name in ('routes', 'matchings', 'paths'):
        if contents.get(name) == []:
            return f'{name}: is empty; the service found no route'
    return ('is not a route: it has no routes (OSRM, TomTom, HERE, Google), no paths (GraphHopper), no trip '
            f'(Valhalla), no type (GeoJSON) and no segments; its keys are: {_keys(contents)}')


def _keys(node: dict[str, Any]) -> str:
    return ', '.join(map(str, list(node)[:8])) or 'none'


def _rows(columns: dict[str, list[Any]]) -> list[dict[str, Any]]:
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise InvalidInput(f'its lists have different lengths: {", ".join(map(str, sorted(lengths)))}')
    return [dict(zip(columns, row)) for row in zip(*columns.values())]


def _text(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)
    return '' if value is None or isinstance(value, bool | list | dict) else str(value)
