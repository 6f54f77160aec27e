# SPDX-License-Identifier: Apache-2.0
"""Reads a YAML file, checks it against a JSON Schema and explains its errors in plain words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
import math
from pathlib import Path
import re
from typing import Any

import yaml

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import read_text

# A value from a YAML or JSON file; its schema gives the type.
FileData = Any
# Upper limit of all numbers in files, so that every calculation can take them as floats.
LARGEST_INTEGER = 10**300
# An alias repeats a value, and aliases of aliases multiply it; no file of ours has a thousandth of these.
MOST_VALUES = 1_000_000


def load_checked_yaml(path: str | Path, schema_path: Path) -> dict[str, FileData]:
    """Return a YAML file's contents by a schema (draft 7, YAML); InvalidInput names file, key, value and range."""
    return check_yaml(read_text(path), path, schema_path)


def check_yaml(text: str, path: str | Path, schema_path: Path) -> dict[str, FileData]:
    """Return the contents of a YAML text that satisfies a schema; `path` names the text in InvalidInput."""
    try:
        contents = _load(text)
        multiplies = '*' in text and _values_in(contents, {}) > MOST_VALUES
        problems = [] if multiplies else list(_unfit_numbers(contents, ''))
    except RecursionError as error:
        # Thousands of brackets, or an alias within its own value.
        raise InvalidInput(f'{path}: cannot be read: its values are nested too deeply') from error
    except (yaml.YAMLError, ValueError) as error:
        # ValueError: invalid values in the form of a number.
        raise InvalidInput(f'{path}: is not YAML: {_problem_of(error)}') from error
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        # PyYAML gives no details for `!!int ""` and `!!bool maybe`.
        raise InvalidInput(f'{path}: is not YAML: a value does not fit its tag (!!…)') from error
    if multiplies:
        raise InvalidInput(f'{path}: cannot be read: its aliases (*) make more than {MOST_VALUES} values')
    if not isinstance(contents, dict):
        raise InvalidInput(f'{path}: must be a mapping of keys to values')
    problems = problems or _refused(load_schema(schema_path), contents)
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])
    return contents


def _problem_of(error: Exception) -> str:
    """Return the place in the text, and the problem."""
    if isinstance(error, yaml.reader.ReaderError):
        return f'character {error.position + 1}, U+{error.character:04X}: {error.reason}'
    if not isinstance(error, yaml.MarkedYAMLError) or error.problem_mark is None:
        return str(error)
    mark, begun = error.problem_mark, error.context_mark
    within = f'{error.context}{f" from line {begun.line + 1}" if begun else ""}: ' if error.context else ''
    return f'line {mark.line + 1}, column {mark.column + 1}: {within}{error.problem}'


def problems_by(schema: FileData, contents: FileData) -> list[str]:
    """Return a sentence for each value, of a program in the form of a file, that a schema of files refuses."""
    return list(_unfit_numbers(contents, '')) or _refused(schema, contents)


def _refused(schema: FileData, contents: FileData) -> list[str]:
    if surely_obeys(schema, contents):
        return []
    # Imported here, because jsonschema adds 13 % to the run time of `preheat` (0.74 instead of 0.66 s).
    from bev_preheat.files.schema_problems import schema_problems
    return schema_problems(schema, contents)


EXPONENTIAL = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$')
# LibYAML parses six times faster; not every build of PyYAML has it.
_FAST: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def _strict(loader: Any) -> Any:
    """
    Return a loader that refuses duplicate keys (YAML's own takes the last one) and leaves dates as texts.

    It reads 7e3 as a number, as YAML 1.2 and parameter files of ROS; that of YAML 1.1 is 7.0e+3 only.
    """
    class Strict(loader):  # type: ignore[misc]
        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
            seen = set()
            for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key.value in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f'{key.value!r} is a duplicate key', key.start_mark)
                seen.add(key.value)
            return super().construct_mapping(node, deep)

    # Schemas say where a date is allowed, and readers know the zone.
    Strict.add_constructor('tag:yaml.org,2002:timestamp', Strict.construct_scalar)
    Strict.add_implicit_resolver('tag:yaml.org,2002:float', EXPONENTIAL, list('-+.0123456789'))
    return Strict


_LOADER, _FAST_LOADER = _strict(yaml.SafeLoader), _strict(_FAST)

# LibYAML crashes if values are nested about twenty thousand deep. Each level starts with such a character.
_NESTING, HARMLESS_NESTING = '[{-?:', 5000


def _load(text: str) -> FileData:
    if sum(map(text.count, _NESTING)) < HARMLESS_NESTING:
        # Errors are reported in the words of one loader.
        with suppress(yaml.YAMLError):
            return yaml.load(text, Loader=_FAST_LOADER)
    return yaml.load(text, Loader=_LOADER)


@cache
def load_schema(path: Path) -> FileData:
    """Return a schema (YAML), with each `$ref` to another file, relative to its folder, replaced by that file."""
    def whole(node: FileData) -> FileData:
        if isinstance(node, dict):
            if str(node.get('$ref', '#')).endswith('.yaml'):
                return load_schema(path.parent / node['$ref'])
            return {key: whole(item) for key, item in node.items()}
        return [whole(item) for item in node] if isinstance(node, list) else node

    return whole(yaml.load(path.read_text(encoding='utf-8'), Loader=_FAST))


def _values_in(value: FileData, known: dict[int, int]) -> int:
    """Return the number of values with aliases written out; `known` has those of parts by identity."""
    if not isinstance(value, dict | list):
        return 1
    if id(value) not in known:
        items = value.values() if isinstance(value, dict) else value
        known[id(value)] = 1 + sum(_values_in(item, known) for item in items)
    return known[id(value)]


def _unfit_numbers(value: FileData, key: str) -> Iterator[str]:
    """Yield a sentence for each number outside the range of calculations, including keys."""
    # A schema cannot refuse NaN, because every comparison with NaN is false.
    if isinstance(value, float) and not math.isfinite(value):
        yield f'{key}: {value} is not a finite number'
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        # Python does not print integers of more than a few thousand digits.
        yield f'{key}: an integer of {value.bit_length()} bits is too large'
    elif isinstance(value, dict):
        for name, item in value.items():
            unfit = list(_unfit_numbers(name, f'{key}: a key' if key else 'a key'))
            yield from unfit or _unfit_numbers(item, f'{key}.{name}' if key else str(name))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _unfit_numbers(item, f'{key}[{index}]')


# Keywords of schemas that are checked here; others are left to jsonschema.
KEYWORDS = frozenset((
    '$schema', 'definitions', 'description', 'title', 'type', 'properties', 'additionalProperties', 'required',
    'items', 'enum', 'pattern', 'uniqueItems', 'minimum', 'maximum', 'exclusiveMinimum', 'exclusiveMaximum',
    'minLength', 'maxLength', 'minItems', 'maxItems', 'minProperties', 'maxProperties'))
DEFINITIONS = '#/definitions/'
TYPES: dict[str, Callable[[FileData], bool]] = {
    'null': lambda value: value is None,
    'object': lambda value: isinstance(value, dict),
    'array': lambda value: isinstance(value, list),
    'string': lambda value: isinstance(value, str),
    'boolean': lambda value: isinstance(value, bool),
    'integer': lambda value: isinstance(value, int) and not isinstance(value, bool),
    'number': lambda value: isinstance(value, int | float) and not isinstance(value, bool)}


def surely_obeys(schema: FileData, value: FileData, root: FileData = None) -> bool:
    """
    Return whether a value certainly satisfies a schema (draft 7); False if it does not, or may not.

    A process that reads a valid file then need not import jsonschema, which takes longer than reading the file.
    `root` is the schema that holds the definitions, None: `schema` itself.
    """
    root = schema if root is None else root
    if not isinstance(schema, dict):
        return False
    if '$ref' in schema:
        # Draft 7 ignores all keywords next to `$ref`.
        name = schema['$ref'].removeprefix(DEFINITIONS)
        definition = root.get('definitions', {}).get(name)
        return schema['$ref'] == DEFINITIONS + name and surely_obeys(definition, value, root)
    names = schema.get('type', list(TYPES))
    if schema.keys() - KEYWORDS or not any(
            TYPES[name](value) for name in (names if isinstance(names, list) else [names]) if name in TYPES) or (
            'enum' in schema and not (isinstance(value, str) and value in schema['enum'])):
        return False

    def is_within(size: float, low: str, high: str) -> bool:
        return bool(schema.get(low, size) <= size <= schema.get(high, size))

    if isinstance(value, dict):
        own, others = schema.get('properties', {}), schema.get('additionalProperties', {})
        return is_within(len(value), 'minProperties', 'maxProperties') and all(
            name in value for name in schema.get('required', ())) and all(
            surely_obeys(own.get(name, others), item, root) for name, item in value.items())
    if isinstance(value, list):
        return is_within(len(value), 'minItems', 'maxItems') and (not schema.get('uniqueItems') or (
            all(isinstance(item, str) for item in value) and len(set(value)) == len(value))) and all(
            surely_obeys(schema.get('items', {}), item, root) for item in value)
    if isinstance(value, str):
        return is_within(len(value), 'minLength', 'maxLength') and (
            re.search(schema.get('pattern', ''), value) is not None)
    return not TYPES['number'](value) or (is_within(value, 'minimum', 'maximum') and schema.get(
        'exclusiveMinimum', -math.inf) < value < schema.get('exclusiveMaximum', math.inf))
