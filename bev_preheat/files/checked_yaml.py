# SPDX-License-Identifier: Apache-2.0
"""Reads a YAML file against a JSON Schema and says in plain words what is wrong with it."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator
from contextlib import suppress
from difflib import get_close_matches
from functools import cache
import math
from pathlib import Path
from typing import Any, cast

from jsonschema import Draft7Validator, ValidationError
import yaml

from bev_preheat.errors import InvalidInput

# A value out of a YAML or JSON file; a schema says its type.
FileData = Any


def load_checked_yaml(path: str | Path, schema_path: Path) -> dict[str, FileData]:
    """
    Return the contents of a YAML file that obeys a schema (JSON Schema draft 7, itself YAML).

    Raises InvalidInput with one problem for each key that is wrong, each naming file, key, value
    and what is allowed.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'is not UTF-8 text'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
    try:
        contents = _load(text)
        problems = list(_numbers_that_are_not_finite(contents, ''))
    except RecursionError as error:
        # Thousands of brackets, or an alias within the very value that it stands for.
        raise InvalidInput(f'{path}: cannot be read: its values are nested too deeply') from error
    except (yaml.YAMLError, ValueError) as error:
        # ValueError: what looks like a date or a number but is none, such as 2024-13-45.
        raise InvalidInput(f'{path}: is not YAML: {" ".join(str(error).split())}') from error
    if not isinstance(contents, dict):
        raise InvalidInput(f'{path}: must be a mapping of keys to values')
    errors = sorted(_validator(schema_path).iter_errors(contents),
                    key=lambda error: [str(part) for part in error.absolute_path])
    problems += [sentence for error in errors for sentence in _in_words(error)]
    if problems:
        raise InvalidInput([f'{path}: {problem}' for problem in problems])
    return contents


class _UniqueKeys:
    """Makes a loader refuse a duplicate key in a mapping; YAML's own take the last silently."""

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


# LibYAML parses six times as fast; not every build of PyYAML has it.
try:
    from yaml import CSafeLoader as _FastLoader
except ImportError:
    from yaml import SafeLoader as _FastLoader  # type: ignore[assignment]


class _Loader(_UniqueKeys, yaml.SafeLoader):
    pass


class _FastLoaderOfUniqueKeys(_UniqueKeys, _FastLoader):
    pass


# LibYAML ends the process where values are nested some twenty thousand deep. Each level takes one of these.
_NESTING, _HARMLESS_NESTING = '[{-?:', 5000


def _load(text: str) -> FileData:
    if sum(map(text.count, _NESTING)) < _HARMLESS_NESTING:
        # What is wrong with a file is told in the words of one loader.
        with suppress(yaml.YAMLError):
            return yaml.load(text, Loader=_FastLoaderOfUniqueKeys)
    return yaml.load(text, Loader=_Loader)


@cache
def _validator(schema_path: Path) -> Draft7Validator:
    return Draft7Validator(load_schema(schema_path))


def load_schema(path: Path) -> FileData:
    """Return a schema (YAML); a `$ref` to another file, seen from its folder, is replaced by it."""
    def whole(node: FileData) -> FileData:
        if isinstance(node, dict):
            if str(node.get('$ref', '#')).endswith('.yaml'):
                return load_schema(path.parent / node['$ref'])
            return {key: whole(item) for key, item in node.items()}
        return [whole(item) for item in node] if isinstance(node, list) else node

    return whole(yaml.load(path.read_text(encoding='utf-8'), Loader=_FastLoader))


def _key(parts: Iterable[str | int]) -> str:
    """Where in the file: battery.power_limits.charge.values[2][0]."""
    text = ''
    for part in parts:
        text += f'[{part}]' if isinstance(part, int) else f'.{part}' if text else str(part)
    return text


def _numbers_that_are_not_finite(value: FileData, key: str) -> Iterator[str]:
    # A schema cannot refuse NaN: every comparison with it is false.
    if isinstance(value, float) and not math.isfinite(value):
        yield f'{key}: {value} is not a finite number'
    elif isinstance(value, dict):
        for name, item in value.items():
            yield from _numbers_that_are_not_finite(item, f'{key}.{name}' if key else str(name))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from _numbers_that_are_not_finite(item, f'{key}[{index}]')


def _in_words(error: ValidationError) -> Iterator[str]:
    key = _key(error.absolute_path) or 'the file'
    rule, value = error.validator, cast(FileData, error.instance)
    allowed = cast(FileData, error.validator_value)
    schema: FileData = error.schema
    if rule == 'additionalProperties':
        known = [name for name, rules in schema.get('properties', {}).items()
                 if 'not' not in rules]
        for name in value:
            if name not in schema.get('properties', {}):
                near = get_close_matches(str(name), known, n=1)
                hint = f'did you mean {near[0]!r}? ' if near else ''
                yield f'{key}: unknown key {name!r}; {hint}known keys: {", ".join(known)}'
    elif rule == 'required':
        missing = [name for name in allowed if name not in value]
        # jsonschema reports each missing key by itself; the first report speaks for all.
        if missing and repr(missing[0]) in error.message:
            yield f'{key}: missing {", ".join(missing)}'
    elif rule in ('minimum', 'exclusiveMinimum', 'maximum', 'exclusiveMaximum'):
        yield f'{key}: {value} is not allowed; it must be {_range_in_words(schema)}'
    elif rule == 'type':
        wanted = ' or '.join(allowed) if isinstance(allowed, list) else allowed
        yield f'{key}: {value!r} is not {"an" if wanted[0] in "aio" else "a"} {wanted}'
    elif rule == 'enum':
        near = get_close_matches(str(value), [str(item) for item in allowed], n=1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        yield f'{key}: {value!r} is not one of {", ".join(map(str, allowed))}{hint}'
    elif rule == 'not':
        # A key of an earlier format; the schema says where its contents belong today.
        yield f'{key}: {schema["description"]}'
    elif rule == 'pattern':
        yield f'{key}: {value!r} is not allowed; it must be {schema["description"]}'
    elif rule == 'maxLength':
        yield f'{key}: has {len(value)} characters; it must have at most {allowed}'
    elif rule in ('minItems', 'maxItems'):
        word = 'at least' if rule == 'minItems' else 'at most'
        yield f'{key}: has {len(value)} values; it must have {word} {allowed}'
    elif rule == 'uniqueItems':
        twice = next(item for index, item in enumerate(value) if item in value[:index])
        yield f'{key}: holds {twice!r} twice'
    elif rule in ('minProperties', 'maxProperties'):
        word = 'at least' if rule == 'minProperties' else 'only'
        names = ', '.join(schema.get('properties', {}))
        yield f'{key}: must have {word} {allowed} of: {names}'
    else:
        yield f'{key}: {error.message}'


def _range_in_words(schema: dict[str, FileData]) -> str:
    parts = []
    for rule, word in (('minimum', 'at least'), ('exclusiveMinimum', 'above'),
                       ('maximum', 'at most'), ('exclusiveMaximum', 'below')):
        if rule in schema:
            parts.append(f'{word} {schema[rule]}')
    return ' and '.join(parts)
