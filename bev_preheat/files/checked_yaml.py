# SPDX-License-Identifier: Apache-2.0
"""Reads a YAML file, checks it against a JSON Schema and explains its errors in plain words."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sized
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
    """
    Return the contents of a YAML file that satisfies a schema (JSON Schema draft 7, itself YAML).

    Raises InvalidInput with one problem per wrong key, naming file, key, value
    and allowed range.
    """
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
        raise InvalidInput(f'{path}: is not YAML: {" ".join(str(error).split())}') from error
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        # PyYAML gives no details for `!!int ""` and `!!bool maybe`.
        raise InvalidInput(f'{path}: is not YAML: a value does not fit its tag (!!…)') from error
    if multiplies:
        raise InvalidInput(f'{path}: cannot be read: its aliases (*) make more than {MOST_VALUES} values')
    if not isinstance(contents, dict):
        raise InvalidInput(f'{path}: must be a mapping of keys to values')
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])
    schema = load_schema(schema_path)
    if not surely_obeys(schema, contents):
        # Imported here, because jsonschema adds 13 % to the run time of `preheat` (0.74 instead of 0.66 s).
        from bev_preheat.files.schema_problems import schema_problems
        problems = schema_problems(schema, contents)
        if problems:
            raise InvalidInput([f'{path}: {problem}' for problem in problems])
    return contents


class _UniqueKeys:
    """Makes a loader refuse duplicate keys in a mapping; YAML's own silently takes the last one."""

    def construct_mapping(self, node: yaml.MappingNode,
                          deep: bool = False) -> dict[Hashable, FileData]:
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                continue
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'{key_node.value!r} is a duplicate key', key_node.start_mark)
            seen.add(key_node.value)
        contents: dict[Hashable, FileData] = super().construct_mapping(  # type: ignore[misc]
            node, deep)
        return contents


# LibYAML parses six times faster; not every build of PyYAML has it.
try:
    from yaml import CSafeLoader as _FastLoader
except ImportError:
    from yaml import SafeLoader as _FastLoader  # type: ignore[assignment]


class _Loader(_UniqueKeys, yaml.SafeLoader):
    pass


class _FastLoaderOfUniqueKeys(_UniqueKeys, _FastLoader):
    pass


def _as_text(loader: Any, node: Any) -> str:
    """Return a date as its text: schemas say where a date is allowed, and readers know the zone."""
    text: str = loader.construct_scalar(node)
    return text


for _each in (_Loader, _FastLoaderOfUniqueKeys):
    _each.add_constructor('tag:yaml.org,2002:timestamp', _as_text)

# LibYAML crashes if values are nested about twenty thousand deep. Each level starts with such a character.
_NESTING, _HARMLESS_NESTING = '[{-?:', 5000


def _load(text: str) -> FileData:
    if sum(map(text.count, _NESTING)) < _HARMLESS_NESTING:
        # Errors are reported in the words of one loader.
        with suppress(yaml.YAMLError):
            return yaml.load(text, Loader=_FastLoaderOfUniqueKeys)
    return yaml.load(text, Loader=_Loader)


@cache
def load_schema(path: Path) -> FileData:
    """Return a schema (YAML), with each `$ref` to another file, relative to its folder, replaced by that file."""
    def whole(node: FileData) -> FileData:
        if isinstance(node, dict):
            if str(node.get('$ref', '#')).endswith('.yaml'):
                return load_schema(path.parent / node['$ref'])
            return {key: whole(item) for key, item in node.items()}
        return [whole(item) for item in node] if isinstance(node, list) else node

    return whole(yaml.load(path.read_text(encoding='utf-8'), Loader=_FastLoader))


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


# A schema or a part of one; a value to check; the setting of a keyword of the schema.
Data = Any
# `rule(allowed, value, schema, root)`: whether a value certainly satisfies a keyword of a schema.
Rule = Callable[[Data, Data, Data, Data], bool]

# Keywords that do not restrict a value.
NOTES = frozenset(('$schema', 'definitions', 'description', 'title'))
DEFINITIONS = '#/definitions/'


def surely_obeys(schema: Data, value: Data, root: Data = None) -> bool:
    """
    Return whether a value certainly satisfies a schema; False if it does not, or may not.

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
    return all(keyword in NOTES or (keyword in RULES and RULES[keyword](allowed, value, schema, root))
               for keyword, allowed in schema.items())


def _is_number(value: Data) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


TYPES: dict[str, Callable[[Data], bool]] = {
    'null': lambda value: value is None,
    'object': lambda value: isinstance(value, dict),
    'array': lambda value: isinstance(value, list),
    'string': lambda value: isinstance(value, str),
    'boolean': lambda value: isinstance(value, bool),
    'integer': lambda value: isinstance(value, int) and not isinstance(value, bool),
    'number': _is_number}


def _is_of_type(allowed: Data, value: Data, schema: Data, root: Data) -> bool:
    names = allowed if isinstance(allowed, list) else [allowed]
    return any(name in TYPES and TYPES[name](value) for name in names)


def _obeys_properties(allowed: Data, value: Data, schema: Data, root: Data) -> bool:
    return not isinstance(value, dict) or all(
        surely_obeys(allowed[name], item, root) for name, item in value.items() if name in allowed)


def _has_known_keys(allowed: Data, value: Data, schema: Data, root: Data) -> bool:
    if 'patternProperties' in schema:
        return False
    if not isinstance(value, dict):
        return True
    others = [item for name, item in value.items() if name not in schema.get('properties', {})]
    return not others or (allowed is not False and all(surely_obeys(allowed, item, root) for item in others))


def _obeys_items(allowed: Data, value: Data, schema: Data, root: Data) -> bool:
    return not isinstance(value, list) or all(surely_obeys(allowed, item, root) for item in value)


def _has_no_twins(allowed: Data, value: Data, schema: Data, root: Data) -> bool:
    if not allowed or not isinstance(value, list):
        return True
    return all(isinstance(item, str) for item in value) and len(set(value)) == len(value)


def _of_numbers(compare: Callable[[Data, Data], bool]) -> Rule:
    return lambda allowed, value, schema, root: not _is_number(value) or compare(value, allowed)


def _of_size(kind: type[Sized], compare: Callable[[int, int], bool]) -> Rule:
    return lambda allowed, value, schema, root: not isinstance(value, kind) or compare(len(value), allowed)


def _least(size: Data, allowed: Data) -> bool:
    return bool(size >= allowed)


def _most(size: Data, allowed: Data) -> bool:
    return bool(size <= allowed)


RULES: dict[str, Rule] = {
    'type': _is_of_type,
    'properties': _obeys_properties,
    'additionalProperties': _has_known_keys,
    'required': lambda allowed, value, schema, root: (
        not isinstance(value, dict) or all(name in value for name in allowed)),
    'items': _obeys_items,
    'enum': lambda allowed, value, schema, root: isinstance(value, str) and value in allowed,
    'pattern': lambda allowed, value, schema, root: (
        not isinstance(value, str) or re.search(allowed, value) is not None),
    'uniqueItems': _has_no_twins,
    'minimum': _of_numbers(_least),
    'maximum': _of_numbers(_most),
    'exclusiveMinimum': _of_numbers(lambda value, allowed: bool(value > allowed)),
    'exclusiveMaximum': _of_numbers(lambda value, allowed: bool(value < allowed)),
    'minLength': _of_size(str, _least),
    'maxLength': _of_size(str, _most),
    'minItems': _of_size(list, _least),
    'maxItems': _of_size(list, _most),
    'minProperties': _of_size(dict, _least),
    'maxProperties': _of_size(dict, _most)}
