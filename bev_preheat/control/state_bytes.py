# SPDX-License-Identifier: Apache-2.0
"""
The whole State as bytes, and back, to the last digit.

The bytes are a line with format and version, then compressed JSON: a table of classes with their fields, and a
table of objects, each after those that it refers to. An object that occurs twice is written once, and is one
object again when it is read: a Mission and its delayed copy share their routes. Only values can be written:
numbers, texts, enums, tuples, NumPy arrays, frozen dataclasses and NamedTuples of this package, time zones and
times of day, and the sentences of a plan. Reading makes no other objects, and calls nothing.
"""

from __future__ import annotations

from base64 import b64decode, b64encode
from dataclasses import fields, is_dataclass
from datetime import time, tzinfo
from enum import Enum
from functools import cache, partial
from importlib import import_module
import json
from typing import Any, TYPE_CHECKING
import zlib

import numpy as np

from bev_preheat.control.departures import zone_of
from bev_preheat.control.forecast_plan import in_words
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import version
from bev_preheat.planning.explanation import explain

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.control.state import State

STATE_FORMAT = 1
HEAD = b'bev_preheat state'
# Classes are of these rooms: others have no values of a State, and reading must not load them.
ROOMS = tuple(f'bev_preheat.{room}.' for room in (
    'charging', 'control', 'estimation', 'numerics', 'planning', 'route', 'vehicle'))
# The functions that make a plan's sentence.
SENTENCES: dict[str, Callable[..., str]] = {'explain': explain, 'in_words': in_words}
# First elements of objects that are of no class.
TUPLE, ARRAY, DICTIONARY, PARTIAL, FUNCTION, ZONE, CLOCK = 't', 'a', 'd', 'p', 'f', 'z', 'c'
LARGEST_STATE_BYTES = 50_000_000


def state_bytes(state: State) -> bytes:
    """Return a State as bytes."""
    writer = _Writer()
    root = writer.put(state)
    text = json.dumps({'classes': writer.classes, 'objects': writer.objects, 'root': root}, separators=(',', ':'))
    return b'%s %d %s\n' % (HEAD, STATE_FORMAT, version().encode()) + zlib.compress(text.encode(), 1)


def state_of(contents: bytes) -> State:
    """Return the State of bytes; raise InvalidInput if they are damaged, or of a version with other fields."""
    head, _, body = contents.partition(b'\n')
    if not head.startswith(HEAD):
        raise InvalidInput('no state of the planner')
    number, _, written_by = head[len(HEAD):].strip().decode(errors='replace').partition(' ')
    if number != str(STATE_FORMAT):
        raise InvalidInput(f'the state has format {quoted(number)} of version {quoted(written_by)}; this version '
                           f'reads format {STATE_FORMAT}')
    try:
        # A bomb would fill the memory.
        values = json.loads(zlib.decompressobj().decompress(body, LARGEST_STATE_BYTES))
        state: State = _read(values['classes'], values['objects'], values['root'])
    except _OtherFieldsError as error:
        raise InvalidInput(f'the state is of version {quoted(written_by)}, and {error}; this is version '
                           f'{quoted(version())}') from error
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError,
            zlib.error) as error:
        raise InvalidInput(f'the state is damaged: {type(error).__name__}: {error}') from error
    return state


class _OtherFieldsError(Exception):
    """A class of the state is not, or has other fields, in this version."""


class _Writer:
    """Puts values into tables of classes and objects."""

    def __init__(self) -> None:
        self.classes: list[list[Any]] = []
        self.objects: list[list[Any]] = []
        self._number_of: dict[type, int] = {}
        # By identity; the values themselves, so that no other object takes the identity meanwhile.
        self._put: dict[int, tuple[Any, list[int]]] = {}

    def put(self, value: Any) -> Any:
        """Return a value as JSON has it: itself, or [its place among the objects]."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        known = self._put.get(id(value))
        if known is None:
            self.objects.append(self._parts(value))
            known = self._put[id(value)] = value, [len(self.objects) - 1]
        return known[1]

    def _parts(self, value: Any) -> list[Any]:
        put, kind = self.put, type(value)
        if kind is tuple:
            return [TUPLE, *map(put, value)]
        if kind is dict:
            return [DICTIONARY, put(tuple(value.items()))]
        if isinstance(value, Enum):
            return [self._class(kind, ()), value.name]
        if isinstance(value, tuple):
            return [self._class(kind, kind._fields), *map(put, value)]
        if is_dataclass(value):
            names = _field_names(value.__class__)
            return [self._class(kind, names), *(put(getattr(value, name)) for name in names)]
        if isinstance(value, np.ndarray | np.generic):
            array = np.asarray(value)
            if array.dtype.kind not in 'biuf':
                raise TypeError(f'an array of {array.dtype} cannot be written')
            return [ARRAY, array.dtype.str, [*array.shape], b64encode(array.tobytes()).decode()]
        if isinstance(value, tzinfo):
            return [ZONE, str(value)]
        if isinstance(value, time):
            return [CLOCK, value.isoformat()]
        if isinstance(value, partial):
            return [PARTIAL, put(value.func), put(value.args), put(tuple(value.keywords.items()))]
        name = next((name for name, function in SENTENCES.items() if function is value), None)
        if name is None:
            raise TypeError(f'{kind.__module__}.{kind.__qualname__} is no value: it cannot be written')
        return [FUNCTION, name]

    def _class(self, kind: type, names: tuple[str, ...]) -> int:
        number = self._number_of.get(kind)
        if number is None:
            if not kind.__module__.startswith(ROOMS):
                raise TypeError(f'{kind.__module__}.{kind.__qualname__} is of no room with values')
            number = self._number_of[kind] = len(self.classes)
            self.classes.append([kind.__module__, kind.__qualname__, list(names)])
        return number


# They are asked for with each object.
@cache
def _field_names(kind: Any) -> tuple[str, ...]:
    if not kind.__dataclass_params__.frozen:
        raise TypeError(f'{kind.__module__}.{kind.__qualname__} is not frozen: it cannot be written')
    return tuple(field.name for field in fields(kind))


def _read(classes: list[list[Any]], objects: list[list[Any]], root: Any) -> Any:
    kinds = [_class_of(*entry) for entry in classes]
    made: list[Any] = []

    def get(value: Any) -> Any:
        return made[value[0]] if type(value) is list else value

    def function_with(function: Any, arguments: Any, keywords: Any) -> Any:
        return partial(get(function), *get(arguments), **dict(get(keywords)))

    def array_of(kind: str, shape: list[int], contents: str) -> Any:
        array = np.frombuffer(b64decode(contents), dtype=np.dtype(kind)).reshape(shape)
        return array if shape else array[()]

    makers: dict[Any, Callable[..., Any]] = {
        TUPLE: lambda *values: tuple(map(get, values)), DICTIONARY: lambda items: dict(get(items)),
        ARRAY: array_of, PARTIAL: function_with, FUNCTION: SENTENCES.__getitem__, ZONE: zone_of,
        CLOCK: time.fromisoformat}
    for first, *rest in objects:
        made.append(makers[first](*rest) if first in makers else _instance(kinds[first], rest, get))
    return get(root)


def _instance(kind: Any, values: list[Any], get: Callable[[Any], Any]) -> Any:
    if issubclass(kind, Enum):
        return kind[values[0]]
    if issubclass(kind, tuple):
        return tuple.__new__(kind, tuple(map(get, values)))
    made = object.__new__(kind)
    vars(made).update(zip(_field_names(kind), map(get, values)))
    return made


def _class_of(module: str, name: str, names: list[str]) -> Any:
    """Return the class of an entry; raise _OtherFieldsError if it is another one in this version."""
    if not module.startswith(ROOMS):
        raise ValueError(f'{quoted(module)} has no values')
    try:
        kind: Any = import_module(module)
        for part in name.split('.'):
            kind = getattr(kind, part)
    except (ImportError, AttributeError) as error:
        raise _OtherFieldsError(f'has {quoted(name)}, which this version has not') from error
    if isinstance(kind, type) and issubclass(kind, Enum):
        return kind
    if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, '_fields'):
        present = list(kind._fields)
    elif isinstance(kind, type) and is_dataclass(kind):
        present = list(_field_names(kind))
    else:
        raise ValueError(f'{quoted(name)} is no class of values')
    if present != names:
        raise _OtherFieldsError(f'its {quoted(name)} has other fields')
    return kind
