# SPDX-License-Identifier: Apache-2.0
"""Checks XML and reads JSON; messages name line, place and value."""

from __future__ import annotations

import json
import math
from typing import Any, TYPE_CHECKING
from xml.parsers import expat

import numpy as np

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_NUMBER = 1e15


def parse_json(text: bytes) -> Any:
    """Return the contents of a JSON text; raise InvalidInput naming line and problem."""
    def refuse(name: str) -> Any:
        raise ValueError(f'{name} is not a number in JSON')

    try:
        return json.loads(text.decode('utf-8-sig'), parse_constant=refuse)
    except json.JSONDecodeError as error:
        raise InvalidInput(f'line {error.lineno}: is not JSON: {error.msg} (column {error.colno}); is the file '
                           'complete?') from error
    except UnicodeDecodeError as error:
        raise InvalidInput(f'is not UTF-8 text (byte {error.start})') from error
    except RecursionError as error:
        raise InvalidInput('is not JSON: its values are nested too deeply') from error
    except ValueError as error:
        raise InvalidInput(f'is not JSON: {error}') from error


def number(node: Any, key: str, place: str, low: float = 0.0, high: float = MOST_NUMBER) -> float:
    """Return the number of a key of an object; raise InvalidInput naming place and key."""
    if not isinstance(node, dict):
        raise InvalidInput(f'{place}: must be an object, not {in_words(node)}')
    if key not in node:
        raise InvalidInput(f'{place}: missing {key}')
    return checked(node[key], f'{place}.{key}', low, high)


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


# Deeper nesting is no route.
MOST_DEPTH = 50


class _Refusal(Exception):
    """Ends the parser."""


def check_xml(text: bytes, on_element: Callable[[str, dict[str, str], int], None] | None = None) -> None:
    """
    Raise InvalidInput naming the line if a text is not well-formed XML, or has a document type.

    `on_element` gets the name (without namespace), the attributes and the line of each element.
    """
    parser = expat.ParserCreate()
    depth = 0

    def refuse(*_: object) -> None:
        raise _Refusal('has a document type (<!DOCTYPE …>); delete it: routes need none')

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MOST_DEPTH:
            raise _Refusal(f'elements are nested more than {MOST_DEPTH} deep')
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
    except _Refusal as error:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: {error}') from error
    except expat.ExpatError as error:
        raise InvalidInput(f'line {error.lineno}: is not XML: {expat.ErrorString(error.code)}; is the file '
                           'complete?') from error
    except InvalidInput:
        raise
    except (ValueError, LookupError) as error:
        raise InvalidInput(f'line {parser.CurrentLineNumber}: is not XML: {error}') from error
