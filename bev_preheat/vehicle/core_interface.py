# SPDX-License-Identifier: Apache-2.0
"""
The interface on which C and Python must agree: structs, prototypes, memory and shared constants, and its digest.

The C build computes the digest from the headers, read here, Python from its bindings. Shared constants are defined
in Python modules and converted to C.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import Array, c_double, c_int32, c_void_p, Structure
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
import re
from types import ModuleType
from typing import Any, TypeAlias

from bev_preheat import numerics, tunables

NAMES: Mapping[ModuleType, str] = {
    numerics: 'CERTAIN_DEVIATIONS JOULES_PER_WH LOG_ROOT_2_PI ROOT_2 ROOT_2_OVER_PI',
    tunables: (
        'ABOVE_K ARRIVAL_TOLERANCE_K BELOW_HIGHEST_K BELOW_K BEYOND_PRICE COLDER_BY_K COMPARED_TOLERANCE_K '
        'DEFICIT_WH_PER_K EDGE_SHARE EMPTY_J END_TOLERANCE_W EXPECTED_PASSES FIRST_STEP_K HALVINGS '
        'HEATING_ALLOWANCE HEATING_PRICE HEATING_SHARE HIGHEST_TOLERANCE_K LACK_PRICE LACK_TOLERANCE_W '
        'LAGS_AHEAD LASTING_LAGS LAST_K LAST_STEP_K LEAST_HEATING_W LEAST_MIXED_SHARE LEAST_SAVING_WH '
        'LEAST_SOURCE_W LONGEST_STEP_S LOOK_WH LOST_ABOVE_TARGET_K MOST_LAGS MOST_LOOKS MOST_SPREAD MOST_TRIALS '
        'MOVED_K NARROW_K NARROW_STEP_K NEAR_K NEAR_PRICE NEAR_RESERVE_K NO_WORSE_W OFF_RESOLUTION_S '
        'POWER_TOLERANCE PRICED_K PRICED_SOC ROUNDING_W SHORT_PRICE SOC_DIFFERENCE SOC_TOLERANCE SPARE_SOC '
        'STRETCH_J STRETCH_K SURE_SHARE SWITCH_ON_EXPECTED_WH SWITCH_ON_WH TAIL TEMPERATURE_DIFFERENCE_K '
        'WATCHED_BELOW_K WATCHED_SOC WIDER_DEVIATIONS WIDE_K WIDE_STEP_K')}

# In a checkout; an installed package has no headers.
INCLUDE = Path(__file__).resolve().parents[2] / 'core' / 'include' / 'bev_preheat_core'
FILES = ('core.h', 'estimation.h')
KINDS = {'double': 'D', 'int32_t': 'I'}
STATUS = 'bev_status'
COMMENT = re.compile(r'/\*.*?\*/', re.DOTALL)
DEFINE = re.compile(r'^#define (\w+)(?:\((\w+)\))?[ \t]+(\S.*)$', re.MULTILINE)
ENUM = re.compile(r'\benum \{(.*?)\}', re.DOTALL)
STRUCT = re.compile(r'\btypedef struct \{(.*?)\} (\w+);', re.DOTALL)
FIELD = re.compile(r'(?:const )?(double|int32_t|uint8_t|bev_\w+) (\*?)(\w+)(?:\[(\w+)\])?')
FUNCTION = re.compile(rf'^{STATUS} (\w+)\(([^)]*)\);', re.MULTILINE)
ARGUMENT = re.compile(r'(?:const )?(\w+) (\*?)\w+(\[\d+\])?')

# (name, type, count) of each field: P an address, D a double, I an integer, else the name of a struct.
Fields: TypeAlias = tuple[tuple[str, str, int], ...]
# Memory of a function: for each step, and once.
Room: TypeAlias = tuple[int, int]
TYPES: Mapping[str, type[Any]] = {'P': c_void_p, 'D': c_double, 'I': c_int32}


@dataclass(frozen=True)
class Interface:
    """Number, structs, prototypes (letters as of Fields, one for each argument) and memory."""

    number: int
    structs: Mapping[str, Fields]
    functions: Mapping[str, str]
    memory: Mapping[str, Room]

    def digest(self, constants: Mapping[str, float]) -> int:
        """Return a number of 31 bits that is almost surely unique to this interface and these shared constants."""
        text = repr((self.number, *(sorted(each.items()) for each in (
            self.structs, self.functions, self.memory, constants))))
        return int.from_bytes(sha256(text.encode()).digest()[:4], 'big') >> 1


def fields_of(struct: type[Structure], names: Mapping[type[Any], str]) -> Fields:
    """Return the Fields of a Structure; `names` are those in C of the structs within."""
    found, letters = [], {kind: letter for letter, kind in TYPES.items()}
    declared: Any
    for name, declared, *_ in struct._fields_:
        is_array = issubclass(declared, Array)
        kind, count = (declared._type_, declared._length_) if is_array else (declared, 1)
        found.append((name, letters.get(kind) or names.get(kind, kind.__name__), count))
    return tuple(found)


def constants() -> dict[str, int | float]:
    """Return {name in C: value}."""
    return {f'BEV_{name}': getattr(module, name) for module, names in NAMES.items() for name in names.split()}


def constant_lines() -> list[str]:
    """Return a definition in C for each constant: bit-exact, by the shortest decimal."""
    return [f'#define {name} {value!r}' if value >= 0 else f'#define {name} ({value!r})'
            for name, value in constants().items()]


def memory_of(function: Callable[[int], int]) -> Room:
    """Return the slope per step and the constant of a function of steps; raises ValueError unless it is linear."""
    once, at_one, at_many = map(function, (0, 1, 1000))
    if at_many - once != 1000 * (at_one - once):
        raise ValueError(f'{once}, {at_one} and {at_many} for 0, 1 and 1000 steps are not so much for each step')
    return at_one - once, once


def read_headers(folder: Path = INCLUDE) -> Interface:
    """Return the Interface of the headers in a folder; raises ValueError if they have another format."""
    text = '\n'.join((folder / name).read_text(encoding='utf-8') for name in FILES)
    text = COMMENT.sub('', text).replace('\\\n', ' ')
    macros = read_macros(text)
    return Interface(
        macros['BEV_INTERFACE'],
        {name: _fields(name, body, macros) for body, name in STRUCT.findall(text)},
        {name: _types(name, arguments) for name, arguments in FUNCTION.findall(text)},
        {name: memory_of(macro) for name, macro in macros.items() if callable(macro)})


def read_macros(text: str) -> dict[str, Any]:
    """Return numbers, enumerators and functions of one argument that a text without comments defines."""
    # An expression of integers in C is one in Python, too; a function sees names that are defined below it.
    macros: dict[str, Any] = {}
    for body in ENUM.findall(text):
        following = 0
        for each in filter(None, map(str.strip, body.split(','))):
            name, _, value = map(str.strip, each.partition('='))
            following = eval(value, {}, macros) if value else following
            macros[name] = following
            following += 1
    for name, argument, value in DEFINE.findall(text):
        macros[name] = eval(f'lambda {argument}: {value}' if argument else value, macros)
    return macros


def _fields(struct: str, body: str, macros: Mapping[str, Any]) -> Fields:
    found = []
    for each in filter(None, (' '.join(part.split()) for part in body.split(';'))):
        match = FIELD.fullmatch(each)
        if match is None or (match[1] == 'uint8_t' and not match[2]):
            raise ValueError(f'{struct}: {each}: is no field as it can be read')
        kind, pointer, name, count = match.groups()
        number = 1 if count is None else macros[count] if count in macros else int(count)
        found.append((name, 'P' if pointer else KINDS.get(kind, kind), number))
    return tuple(found)


def _types(function: str, arguments: str) -> str:
    found = ''
    for each in (' '.join(part.split()) for part in arguments.split(',')):
        match = ARGUMENT.fullmatch(each)
        if match is None or not (match[2] or match[3] or match[1] in KINDS):
            raise ValueError(f'{function}: {each}: is no argument as it can be read')
        found += 'P' if match[2] or match[3] else KINDS[match[1]]
    return found
