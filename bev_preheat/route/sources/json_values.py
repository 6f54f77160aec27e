# SPDX-License-Identifier: Apache-2.0
"""Values of JSON texts, checked; lists of segments of route planners: a list of objects, or an object of lists."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.files.table import Table
from bev_preheat.files.units import split_unit
from bev_preheat.numerics import FloatArray
from bev_preheat.route.sources.journey import Journey
from bev_preheat.route.sources.table import journey_of_table

MOST_NUMBER = 1e15


def parse_json(text: bytes) -> Any:
    """Return the contents of a JSON text; raise InvalidInput naming line and problem."""
    def refuse(name: str) -> Any:
        raise ValueError(f'{name} is not a number in JSON')

    try:
        return json.loads(text.decode(json.detect_encoding(text)), parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise InvalidInput(f'line {error.lineno}: is not JSON: {error.msg} (column {error.colno}); is the file '
                           'complete?') from error
    except UnicodeDecodeError as error:
        raise InvalidInput(f'is not {error.encoding.upper()} text (byte {error.start})') from error
    except RecursionError as error:
        raise InvalidInput('is not JSON: its values are nested too deeply') from error
    except ValueError as error:
        raise InvalidInput(f'is not JSON: {error}') from error


def checked(value: Any, place: str, low: float = 0.0, high: float = MOST_NUMBER) -> float:
    """Return a number in a range; raise InvalidInput naming the place."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InvalidInput(f'{place}: must be a number, not {in_words(value)}')
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if not low <= result <= high:
        raise InvalidInput(f'{place}: {result:g} is not allowed; it must be {low:g} ... {high:g}')
    return result


def numbers(node: Any, key: str, place: str, low: float = 0.0, high: float = MOST_NUMBER) -> FloatArray:
    """Return the numbers of a list in an object, shape (N,)."""
    values = items(node, key, place)
    return np.array([checked(value, f'{place}.{key}[{at}]', low, high) for at, value in enumerate(values)])


def items(node: Any, key: str, place: str) -> list[Any]:
    """Return a list in an object; raise InvalidInput naming place and key."""
    if not isinstance(node, dict):
        raise InvalidInput(f'{place}: must be an object, not {in_words(node)}')
    values = node.get(key)
    if not isinstance(values, list):
        raise InvalidInput(f'{place}: missing {key}' if values is None else
                           f'{place}.{key}: must be a list, not {in_words(values)}')
    return values


def in_words(value: Any) -> str:
    """Return a JSON value for a message."""
    if isinstance(value, dict):
        return 'an object'
    if isinstance(value, list):
        return 'a list'
    return 'null' if value is None else quoted(shortened(str(value), 60))


# Names of the list of segments in an object.
LISTS = ('segments', 'steps', 'legs', 'route', 'path', 'sections')


def read_records(contents: Any) -> Journey:
    """Return the Journey of a list of segments; raise InvalidInput naming segment, key and value."""
    records = contents
    if isinstance(contents, dict):
        lists = [name for name in LISTS if isinstance(contents.get(name), list)]
        if lists:
            records = contents[lists[0]]
        elif contents and all(isinstance(column, list) and not any(
                isinstance(each, dict | list) for each in column) for column in contents.values()):
            records = _rows(contents)
        else:
            raise InvalidInput(_why_no_route(contents))
    if not isinstance(records, list) or not records:
        raise InvalidInput('its list of segments is empty' if records == [] else
                           f'is not a list of segments: {in_words(records)}')
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
        if name in contents:
            return (f'{name}[0]: has no length and duration of its legs; ask the service for them (HERE: '
                    'return=summary; Google: the field mask routes.legs.distanceMeters,routes.legs.duration)')
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
