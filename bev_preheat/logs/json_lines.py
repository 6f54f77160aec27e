# SPDX-License-Identifier: Apache-2.0
"""JSON lines: an object a line, nested, with any of the fields; or one value with a list of such objects."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
import json
import math
from pathlib import Path
import re
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table_text import encoding_of, line_blocks
from bev_preheat.files.units import split_unit, unit_named
from bev_preheat.logs.choice import find_time_column
from bev_preheat.logs.csv_log import MOST_CHANNELS, NAME, UNIT, VALUE
from bev_preheat.logs.raw_log import Channel, Piece

if TYPE_CHECKING:
    from bev_preheat.files.times import Clock
    from bev_preheat.logs.raw_log import Remarks
    from bev_preheat.logs.signal_map import SignalMap

DEEPEST = 20
# Items of a list that become channels; a longer list of numbers is a course of time.
LONGEST_CHANNEL_LIST = 1000
# Fields of an object that is one reading: name, value, unit, time.
MOST_OF_NAMED = 4
TIME = re.compile(r'(^|[_ ]|[a-z](?=[TD]))(time(_?stamp)?|date|utc|ts|epoch|t|'
                  r'(created|recorded|logged|received)_?at)($|[_ ])', re.IGNORECASE)


def records(value: Any) -> Iterator[dict[str, str]]:
    """Yield the records of a JSON value: the items of its longest list of objects with a time, else the value."""
    if isinstance(value, list):
        for each in value:
            yield from records(each)
        return
    if not isinstance(value, dict):
        return
    columns = _columns(value)
    found = max(_lists(value, 0), key=len, default=[]) if columns is None else []
    for each in columns or found or [value]:
        yield flat(each)


def _lists(value: Any, depth: int) -> Iterator[list[dict[str, Any]]]:
    """Yield the lists of objects with a time in a value; those at the same place of several parents are one."""
    if depth > DEEPEST or not isinstance(value, dict | list):
        return
    if isinstance(value, list):
        if len(value) > 1 and all(isinstance(each, dict) and _has_time(each) for each in value):
            inner = [found for each in value for found in _lists(each, depth + 1)]
            # Drives, each with its instants.
            joined = [each for found in inner for each in found]
            yield joined if len(joined) > len(value) else value
            return
    inside = value if isinstance(value, list) else value.values()
    for each in inside:
        yield from _lists(each, depth + 1)


def _has_time(item: Mapping[str, Any]) -> bool:
    return any(TIME.search(key) for key in item)


def _columns(value: Any, depth: int = 0) -> list[dict[str, Any]] | None:
    """Return records of an object with a list for each channel, the time among them; None for another."""
    if not isinstance(value, dict) or depth > DEEPEST:
        return None
    lists = {key: each for key, each in value.items() if isinstance(each, list) and len(each) > 1}
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

    Items that are a name and its value are channels of that name, {"value": {"doubleValue": 5}} is a number.
    """
    found: dict[str, str] = {}
    for key, item in value.items():
        name = f'{prefix}{key}'
        if isinstance(item, dict) and len(item) == 1 and next(iter(item)).endswith('Value'):
            item = next(iter(item.values()))
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


# Objects that are searched for channels, and those that tell how time is written.
MOST_SEARCHED, SAMPLE = 200_000, 400
# Largest file that is one array [bytes]; it is read as a whole.
LARGEST_ARRAY = 1 << 28
# First line of an object that wraps an array.
WRAPPED = re.compile(r'\{\s*"[^"]*"\s*:\s*\[?')
Item = Mapping[str, str]


class JsonLines:
    """An open log of JSON objects; see RawLog."""

    format = 'JSON lines'
    place = 'line'
    decimal = '.'
    times: tuple[str, ...] = ()

    def __init__(self, path: str | Path, encoding: str) -> None:
        """Read the fields of the first objects; raises InvalidInput if the file has no object."""
        self._path, self._encoding, self.absolute = path, encoding, False
        self._clock: Clock | None = None
        self._time, self._sample = '', []
        found: dict[str, str] = {}
        self._name = self._value = self._unit = ''
        for count, (_, item) in enumerate(self._items(None)):
            if count == 0:
                # {"path": "Vehicle.Speed", "value": 12} is one reading, not two fields.
                roles = [next((key for key in item if pattern.match(key)), '') for pattern in (NAME, VALUE, UNIT)]
                if roles[0] and roles[1]:
                    self._name, self._value, self._unit = roles
            if count < SAMPLE:
                self._sample.append(item)
            elif count > MOST_SEARCHED:
                break
            if self._name:
                channel = item.get(self._name, '')
                if channel and not found.get(channel):
                    found[channel] = unit_named(item.get(self._unit, '')) or split_unit(channel).unit
            else:
                for key in item.keys() - found.keys():
                    found[key] = split_unit(key).unit
            if len(found) > MOST_CHANNELS:
                raise InvalidInput(f'{path}: its objects have more than {MOST_CHANNELS} fields; this is no log')
        if not found:
            raise InvalidInput(f'{path}: has no JSON object with fields')
        self.channels = tuple(Channel(*item) for item in sorted(found.items()))

    def use(self, signal_map: SignalMap) -> None:
        """Choose the field of the time; raises InvalidInput if no field is a time."""
        keys = list(dict.fromkeys(key for item in self._sample for key in item))
        rows = [[item.get(key, '') for key in keys] for item in self._sample]
        found = find_time_column(keys, [split_unit(key).unit for key in keys], rows, '.', signal_map)
        if found is None or len(found.columns) != 1:
            raise InvalidInput(f'{self._path}: no field holds the time; the fields are {quoted(", ".join(keys))}; '
                               'give a signal map with time')
        self._clock, self._time, self.absolute = found.clock, keys[found.columns[0]], found.clock.absolute
        self.times = (self._time,)

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted fields; see RawLog."""
        assert self._clock is not None
        if self._clock.remark:
            remarks.add('clock', f'{self._path}: {self._clock.remark}')
        readings: dict[str, tuple[list[int], list[str]]] = {}
        times: list[str] = []
        numbers: list[int] = []
        for number, item in self._items(remarks):
            for name, value in self._readings(item):
                if name in wanted:
                    at, values = readings.setdefault(name, ([], []))
                    at.append(len(times))
                    values.append(value)
            times.append(item.get(self._time, ''))
            numbers.append(number)
            if len(times) >= 50_000:
                yield from self._pieces(times, numbers, readings, remarks)
                times, numbers, readings = [], [], {}
        yield from self._pieces(times, numbers, readings, remarks)

    def _readings(self, item: Item) -> Iterator[tuple[str, str]]:
        if self._name:
            yield item.get(self._name, ''), item.get(self._value, '')
        else:
            yield from item.items()

    def _pieces(self, times: list[str], numbers: list[int], readings: dict[str, tuple[list[int], list[str]]],
                remarks: Remarks) -> Iterator[Piece]:
        if not times:
            return
        assert self._clock is not None
        time_s, places = self._clock.seconds(times), np.array(numbers)
        bad = ~np.isfinite(time_s)
        if bad.any():
            at = int(np.argmax(bad))
            remarks.add('time', f'{self._path}, line {numbers[at]}: {self._time}: {quoted(times[at])} is not a '
                                'time; '
                        'the line is dropped', int(bad.sum()), 'line')
        for name, (at_rows, values) in readings.items():
            yield Piece(name, time_s[at_rows], values, places[at_rows])

    def _items(self, remarks: Remarks | None) -> Iterator[tuple[int, Item]]:
        """Yield line numbers and the objects with flat keys; remark on lines without an object."""
        if _is_array(self._path, self._encoding):
            yield from self._array()
            return
        for first, lines in line_blocks(self._path, self._encoding):
            for number, line in enumerate(lines, start=first):
                text = line.strip().rstrip(',')
                if not text or text in '[]':
                    continue
                try:
                    value = json.loads(text)
                except (ValueError, RecursionError):
                    value = None
                if isinstance(value, dict):
                    for record in records(value):
                        yield number, record
                elif remarks is not None:
                    remarks.add('json', f'{self._path}, line {number}: {quoted(text)} is not a JSON object; the '
                                        'line '
                                'is dropped', noun='line')

    def _array(self) -> Iterator[tuple[int, Item]]:
        if Path(self._path).stat().st_size > LARGEST_ARRAY:
            raise InvalidInput(f'{self._path}: is one array of more than {LARGEST_ARRAY >> 20} MB; write an '
                               'object a '
                               'line')
        try:
            values = json.loads(Path(self._path).read_text(encoding=self._encoding))
        except (ValueError, RecursionError) as error:
            raise InvalidInput(f'{self._path}: is not JSON: {error}') from error
        yield from enumerate(records(values), start=1)


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
            return text in ('{', '{"') or WRAPPED.fullmatch(text) is not None
    return False


def _is_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text.rstrip(',')), dict)
    except (ValueError, RecursionError):
        return False


def open_json_lines(path: str | Path, head: bytes) -> JsonLines | None:
    """Return the open log if a file begins with a JSON object or array, else None."""
    encoding = encoding_of(head)
    if encoding is None:
        return None
    text = head.decode(encoding, 'replace').lstrip()
    if not re.match(r'\[\s*\{|\{\s*"|\{\s*$', text):
        return None
    return JsonLines(path, encoding)
