# SPDX-License-Identifier: Apache-2.0
"""JSON lines: an object a line, nested, with any of the fields; or one value with a list of such objects."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import chain, islice
import json
import math
from pathlib import Path
import re
from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table import encoding_of, Layout, line_blocks
from bev_preheat.files.units import split_unit
from bev_preheat.logs.csv_log import MOST_CHANNELS, NAME, roles_of, TextLog, VALUE
from bev_preheat.numerics import IntArray

DEEPEST = 20
# Items of a list that become channels; a longer list of numbers is a course of time.
LONGEST_CHANNEL_LIST = 1000
# Share of the objects in a list that have a time.
LEAST_WITH_TIME = 0.9
# Fields of an object that is one reading: name, value, unit, time.
MOST_OF_NAMED = 4
TIME = re.compile(r'(^|[_ ]|[a-z](?=[TD]))(time(_?stamp)?|date|utc|ts|epoch|t|'
                  r'(created|recorded|logged|received|fetched|updated)_?at|tst)($|[_ ])', re.IGNORECASE)


def records(value: Any) -> Iterator[dict[str, str]]:
    """
    Yield the records of a JSON value: the rows of its tables, else the items of its longest list of objects.

    The objects must have a time; without them the value is a record itself. Raises InvalidInput if it has several
    lists of the same fields.
    """
    tables = list(_tables(value))
    if tables:
        for each in chain.from_iterable(tables):
            yield flat(each)
    elif isinstance(value, list):
        # Home Assistant names the entity in the first of its states.
        first = value[0] if value and isinstance(value[0], dict) else {}
        shared = {key: each for key, each in first.items() if NAME.match(key)}
        for each in value:
            yield from records(shared | each if isinstance(each, dict) else each)
    elif isinstance(value, dict):
        columns = _columns(value)
        lists = sorted(_lists(value), key=lambda found: len(found[1]), reverse=True) if columns is None else []
        longest = lists[0][1] if lists else [value]
        alike = [(name, found) for name, found in lists if found[0].keys() == longest[0].keys()]
        if len(alike) > 1 and any(map(VALUE.match, longest[0])):
            # A list of readings for each channel.
            longest = [{'name': name, **each} for name, found in alike for each in found]
        elif len(alike) > 1:
            raise InvalidInput(f'has several lists of {quoted(", ".join(longest[0]))}; a log must be one drive of '
                               'one car: split it')
        for each in columns or longest:
            yield flat(each)


def _tables(value: Any, depth: int = 0) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of tables: a list of names, a time among them, and lists of as many values."""
    if depth > DEEPEST or not isinstance(value, dict | list):
        return
    inside = list(value.values()) if isinstance(value, dict) else value
    names = next((each for each in inside if isinstance(each, list) and len(each) > 1
                  and all(isinstance(name, str) for name in each) and any(map(TIME.search, each))), None)
    rows = [] if names is None else inside if isinstance(value, list) else next(
        (each for each in inside if isinstance(each, list) and each and isinstance(each[0], list)), [])
    rows = [row for row in rows if isinstance(row, list) and row is not names and len(row) == len(names or ())]
    if names is None or not rows:
        for each in inside:
            yield from _tables(each, depth + 1)
        return
    # InfluxDB gives a table of two columns the name of its values.
    title = value.get('name') if isinstance(value, dict) and len(names) == 2 else None
    yield [dict(zip([names[0], title] if isinstance(title, str) else names, row)) for row in rows]


def _lists(value: Any, name: str = '', depth: int = 0) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield names and lists of objects with a time; those at the same place of several parents are one list."""
    if depth > DEEPEST or not isinstance(value, dict | list):
        return
    if isinstance(value, list):
        if len(value) > 1 and all(isinstance(each, dict) for each in value) and (
                sum(map(_has_time, value)) > LEAST_WITH_TIME * len(value)):
            # Drives, each with its instants.
            joined = [each for item in value for _, found in _lists(item, name, depth + 1) for each in found]
            yield name, joined if len(joined) > len(value) else value
            return
    for key, each in value.items() if isinstance(value, dict) else ((name, item) for item in value):
        yield from _lists(each, key, depth + 1)


def _has_time(item: Mapping[str, Any], depth: int = 0) -> bool:
    return any(TIME.search(key) or (isinstance(each, dict) and depth < DEEPEST and _has_time(each, depth + 1))
               for key, each in item.items())


def _columns(value: Any, depth: int = 0) -> list[dict[str, Any]] | None:
    """Return records of an object with a list for each channel, the time among them; None for another."""
    if not isinstance(value, dict) or depth > DEEPEST:
        return None
    # Pandas writes the values of a column with their index.
    lists = {key: each for key, item in value.items() if isinstance(
        each := list(item.values()) if isinstance(item, dict) and all(map(str.isdigit, item)) else item, list)
        and len(each) > 1}
    time = next((each for key, each in lists.items() if TIME.search(key) and not isinstance(each[0], dict | list)),
                None)
    if time is not None and len(lists) > 1:
        same = {key: each for key, each in lists.items() if len(each) == len(time)}
        if len(same) > 1:
            return [dict(zip(same, row)) for row in zip(*same.values())]
    return next((found for each in value.values() if (found := _columns(each, depth + 1)) is not None), None)


def flat(value: Mapping[str, Any], prefix: str = '', depth: int = 0) -> dict[str, str]:
    """
    Return the numbers and texts of a nested object by dotted path; items of lists have their number.

    Items that are a name and its value are channels of that name, {"value": {"doubleValue": 5}} is a number, and
    {"value": 5, "unit": "km/h"} one with a unit, whatever else is beside.
    """
    found: dict[str, str] = {}
    for key, item in value.items():
        name = f'{prefix}{key}'
        if isinstance(item, dict) and len(item) == 1 and next(iter(item)).endswith('Value'):
            item = next(iter(item.values()))
        both = {'value', 'unit'} & item.keys() if isinstance(item, dict) else ()
        if len(both) == 2 and isinstance(item['value'], int | float):
            found[name] = f'{item["value"]} {item["unit"] or ""}'.strip()
            item = {each: inner for each, inner in item.items() if each not in both}
        if named := _named(item):
            found.update(flat(named, prefix, depth + 1))
        elif isinstance(item, dict | list) and depth < DEEPEST:
            inner = item if isinstance(item, dict) else dict(zip(map(str, range(LONGEST_CHANNEL_LIST)), item))
            found.update(flat(inner, f'{name}.', depth + 1))
        elif isinstance(item, str):
            found[name] = item
        elif isinstance(item, bool):
            found[name] = str(item)
        elif isinstance(item, int | float):
            found[name] = repr(float(item)) if abs(item) < 1e300 and math.isfinite(item) else ''
    return found


def _named(items: Any) -> dict[str, Any]:
    """Return the values of a list of objects with a name and a value each, by name; {} for another."""
    found: dict[str, Any] = {}
    for item in items if isinstance(items, list) else ():
        if not isinstance(item, dict) or len(item) > MOST_OF_NAMED:
            return {}
        name = next((key for key in item if NAME.match(key) and isinstance(item[key], str)), None)
        value = next((key for key in item if VALUE.match(key)), None)
        if name is None or value is None:
            return {}
        found[item[name]] = item[value]
    return found


# Objects that are searched for channels, and those that show how time is written; texts that are held at once.
MOST_SEARCHED, OBJECTS_SHOWING_TIMES, CELLS_AT_ONCE = 200_000, 400, 1_000_000
# Largest file that is one array [bytes]; it is read as a whole.
LARGEST_ARRAY = 1 << 28
# First line of an object that wraps an array.
WRAPPED = re.compile(r'\{\s*"[^"]*"\s*:\s*\[?')
BETWEEN = re.compile(r'[\s,]*')
INDEXED = re.compile(r'(^|\.)\d+\.')
Item = Mapping[str, str]


class JsonRows:
    """Objects with flat keys as the rows of a log, like files.table.TableFile; a field is a column."""

    def __init__(self, path: str | Path, encoding: str) -> None:
        """Read the fields of the first objects; raises InvalidInput if the file has no object."""
        self.path, self._encoding = path, encoding
        self.is_array = _is_array(path, encoding)
        sample: list[Item] = []
        found: dict[str, None] = {}
        for count, (_, item) in enumerate(self._items(lambda *_: None)):
            if count < OBJECTS_SHOWING_TIMES:
                sample.append(item)
            elif count > MOST_SEARCHED:
                break
            found.update(dict.fromkeys(item))
            if len(found) > MOST_CHANNELS:
                raise InvalidInput(f'{path}: its objects have more than {MOST_CHANNELS} fields; this is no log')
        if not found:
            raise InvalidInput(f'{path}: has no JSON object with fields')
        if len(sample) == 1 and any(map(INDEXED.search, found)):
            raise InvalidInput(f'{path}: is one object whose lists have no time ({quoted(next(iter(found)))}, '
                               '...); write an object with a time a line')
        header = tuple(found)
        # {"path": "Vehicle.Speed", "value": 12} is one reading, not two fields.
        self.roles = roles_of(list(sample[0])) and roles_of(header)
        self.layout = Layout(None, header, 0, tuple(split_unit(key).unit for key in header), 1, tuple(
            tuple(item.get(key, '') for key in header) for item in sample), len(header), '.')

    def blocks(self, drop: Callable[[int, str], object]) -> Iterator[tuple[IntArray, list[tuple[str, ...]]]]:
        """Yield numbers of lines and the texts of each field, '' for a missing one; `drop` as for TableFile."""
        items, size = self._items(drop), max(CELLS_AT_ONCE // len(self.layout.header), 1)
        while block := list(islice(items, size)):
            yield np.array([number for number, _ in block]), [
                tuple(item.get(key, '') for _, item in block) for key in self.layout.header]

    def _items(self, drop: Callable[[int, str], object]) -> Iterator[tuple[int, Item]]:
        """Yield line numbers and the objects with flat keys; `drop` gets lines without an object."""
        if self.is_array:
            yield from self._array()
            return
        for first, lines in line_blocks(self.path, self._encoding):
            for number, line in enumerate(lines, start=first):
                text = line.strip().rstrip(',')
                if not text or text in '[]':
                    continue
                try:
                    value = json.loads(text)
                except (ValueError, RecursionError):
                    value = None
                if isinstance(value, dict):
                    for record in self._records(value):
                        yield number, record
                else:
                    drop(number, f'{quoted(text)} is not a JSON object')

    def _array(self) -> Iterator[tuple[int, Item]]:
        if Path(self.path).stat().st_size > LARGEST_ARRAY:
            raise InvalidInput(f'{self.path}: is one array of more than {LARGEST_ARRAY >> 20} MB; write an object '
                               'a line')
        values, decoder, at = [], json.JSONDecoder(), 0
        text = Path(self.path).read_text(encoding=self._encoding, errors='replace').strip()
        try:
            while at < len(text):
                value, end = decoder.raw_decode(text, at)
                values.append(value)
                at = BETWEEN.match(text, end).end()  # type: ignore[union-attr]
        except (ValueError, RecursionError) as error:
            raise InvalidInput(f'{self.path}: is not JSON: {error}') from error
        yield from enumerate(self._records(values if len(values) > 1 else values[0]), start=1)

    def _records(self, value: Any) -> Iterator[Item]:
        try:
            yield from records(value)
        except InvalidInput as error:
            raise InvalidInput(f'{self.path}: {error}') from error


def _is_array(path: str | Path, encoding: str) -> bool:
    """Return whether a file is one JSON value of several lines, not an object a line."""
    for _, lines in line_blocks(path, encoding):
        for line in lines:
            text = line.strip()
            if not text:
                continue
            if not text.startswith('{'):
                following = next((each for each in map(str.strip, lines[1:]) if each), '')
                return text != '[' or not _is_object(following)
            return text in ('{', '{"') or WRAPPED.fullmatch(text) is not None or not (
                any(map(str.strip, lines[1:])) or _is_object(text))
    return False


def _is_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text.rstrip(',')), dict)
    except (ValueError, RecursionError):
        return False


def open_json_lines(path: str | Path, head: bytes, _: Collection[str | Path] = ()) -> TextLog | None:
    """Return the open log if a file begins with a JSON object or array, else None."""
    encoding = encoding_of(head)
    if encoding is None or not re.match(r'\[\s*[\[{]|\{\s*"|\{\s*$', head.decode(encoding, 'replace').lstrip()):
        return None
    rows = JsonRows(path, encoding)
    return TextLog(rows, rows.roles, *(('JSON', 'field', 'record') if rows.is_array else ('JSON lines', 'field')))
