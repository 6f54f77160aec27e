# SPDX-License-Identifier: Apache-2.0
"""The records in a JSON value: flat objects, one an instant, wherever in the value their list is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import math
import re
from typing import Any

from bev_preheat.logs.csv_log import NAME, VALUE

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
