# SPDX-License-Identifier: Apache-2.0
"""Explain in plain words why a value violates a JSON Schema; jsonschema is loaded only here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from typing import Any, cast

from jsonschema import Draft7Validator, ValidationError
from jsonschema.validators import extend

# A value from a file, or a schema for it.
Data = Any
RANGES = {'minimum': 'at least', 'exclusiveMinimum': 'above', 'maximum': 'at most', 'exclusiveMaximum': 'below'}
# JSON Schema counts 6.0 as an integer; an index or a seed is refused here.
_TYPES = Draft7Validator.TYPE_CHECKER.redefine(
    'integer', lambda checker, value: isinstance(value, int) and not isinstance(value, bool))
_Validator = extend(Draft7Validator, type_checker=_TYPES)  # type: ignore[no-untyped-call]


def schema_problems(schema: Data, contents: Data) -> list[str]:
    """Return one sentence for each key of `contents` that violates the schema (draft 7)."""
    errors = sorted(_Validator(schema).iter_errors(contents),
                    key=lambda error: [str(part) for part in error.absolute_path])
    return [sentence for error in errors for sentence in _in_words(error)]


def _key(parts: Iterable[str | int]) -> str:
    """Return the place in the file: battery.power_limits.charge.values[2][0]."""
    text = ''
    for part in parts:
        text += f'[{part}]' if isinstance(part, int) else f'.{part}' if text else str(part)
    return text


def _in_words(error: ValidationError) -> Iterator[str]:
    key = _key(error.absolute_path) or 'the file'
    rule, value = error.validator, cast(Data, error.instance)
    allowed = cast(Data, error.validator_value)
    schema: Data = error.schema
    if rule == 'additionalProperties':
        known = list(schema.get('properties', {}))
        for name in value:
            if name not in known:
                near = get_close_matches(str(name), known, n=1)
                hint = f'did you mean {near[0]!r}? ' if near else ''
                yield f'{key}: unknown key {name!r}; {hint}known keys: {", ".join(known)}'
    elif rule == 'required':
        missing = [name for name in allowed if name not in value]
        # jsonschema reports each missing key separately; the first report covers all.
        if missing and repr(missing[0]) in error.message:
            yield f'{key}: missing {", ".join(missing)}'
    elif rule in RANGES:
        ends = [f'{word} {schema[rule]}' for rule, word in RANGES.items() if rule in schema]
        yield f'{key}: {value} is not allowed; it must be {" and ".join(ends)}'
    elif rule == 'type':
        wanted = ' or '.join(allowed) if isinstance(allowed, list) else allowed
        hint = '; put it in quotes' if wanted == 'string' and not isinstance(value, dict | list) else ''
        yield f'{key}: {value!r} is not {"an" if wanted[0] in "aio" else "a"} {wanted}{hint}'
    elif rule == 'enum':
        near = get_close_matches(str(value), [str(item) for item in allowed], n=1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        yield f'{key}: {value!r} is not one of {", ".join(map(str, allowed))}{hint}'
    elif rule == 'pattern':
        yield f'{key}: {value!r} is not allowed; it must be {schema["description"]}'
    elif rule in ('maxLength', 'minItems', 'maxItems') or (
            rule in ('minProperties', 'maxProperties') and 'properties' not in schema):
        parts = 'characters' if rule == 'maxLength' else 'values'
        word = 'at least' if rule.startswith('min') else 'at most'
        yield f'{key}: has {len(value)} {parts}; it must have {word} {allowed}'
    elif rule == 'uniqueItems':
        twice = next(item for index, item in enumerate(value) if item in value[:index])
        yield f'{key}: contains {twice!r} twice'
    elif rule in ('minProperties', 'maxProperties'):
        word = 'at least' if rule == 'minProperties' else 'only'
        yield f'{key}: must have {word} {allowed} of: {", ".join(schema["properties"])}'
    else:
        yield f'{key}: {error.message}'
