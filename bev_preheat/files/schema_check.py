# SPDX-License-Identifier: Apache-2.0
"""
Quick check of a value against a JSON Schema (draft 7), without jsonschema.

A process that reads a valid file then need not import that package, which takes longer than reading the file.
Doubtful cases are left to jsonschema: see `schema_problems`.
"""

from __future__ import annotations

from collections.abc import Callable, Sized
import re
from typing import Any

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
