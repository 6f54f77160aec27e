# SPDX-License-Identifier: Apache-2.0
"""
The interface on which C and Python must agree: structs, prototypes, memory and shared constants, and its digest.

The C build computes the digest from the headers, read here, Python from its bindings. Shared constants are defined
in Python modules and converted to C.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from ctypes import Array, c_double, c_int32, c_void_p, Structure
from dataclasses import dataclass, field
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
OPERATORS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b}

# (name, type, count) of each field: P an address, D a double, I an integer, else the name of a struct.
Fields: TypeAlias = tuple[tuple[str, str, int], ...]
# Memory of a function: for each step, and once.
Room: TypeAlias = tuple[int, int]
LETTERS = {c_void_p: 'P', c_double: 'D', c_int32: 'I'}


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
    found = []
    declared: Any
    for name, declared, *_ in struct._fields_:
        is_array = issubclass(declared, Array)
        kind, count = (declared._type_, declared._length_) if is_array else (declared, 1)
        found.append((name, LETTERS.get(kind) or names.get(kind, kind.__name__), count))
    return tuple(found)


def constants() -> dict[str, int | float]:
    """Return {name in C: value}."""
    return {f'BEV_{name}': getattr(module, name) for module, names in NAMES.items() for name in names.split()}


def constant_lines() -> list[str]:
    """Return a definition in C for each constant: bit-exact, by the shortest decimal."""
    return [f'#define {name} {value!r}' if value >= 0 else f'#define {name} ({value!r})'
            for name, value in constants().items()]


@dataclass
class Macros:
    """Numbers and functions of one argument that headers define, with the enumerators."""

    numbers: dict[str, str | int] = field(default_factory=dict)
    functions: dict[str, tuple[str, str]] = field(default_factory=dict)

    def value(self, text: str | int, **known: int) -> int:
        """Return the value of an expression of integers; raises ValueError for any other expression."""
        return text if isinstance(text, int) else self._value(ast.parse(text, mode='eval').body, known)

    def room(self, name: str) -> Room:
        """Return the slope per step and the constant of a function; raises ValueError unless it is linear."""
        argument, text = self.functions[name]
        once, at_one, at_many = (self.value(text, **{argument: steps}) for steps in (0, 1, 1000))
        if at_many - once != 1000 * (at_one - once):
            raise ValueError(f'{name}: is not so much for each step')
        return at_one - once, once

    def _value(self, node: ast.expr, known: dict[str, int]) -> int:
        if isinstance(node, ast.Constant) and isinstance(node.value, int):
            return node.value
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return -self._value(node.operand, known)
        if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            return OPERATORS[type(node.op)](self._value(node.left, known), self._value(node.right, known))
        if isinstance(node, ast.Name):
            return known[node.id] if node.id in known else self.value(self.numbers[node.id])
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            argument, text = self.functions[node.func.id]
            return self.value(text, **{argument: self._value(node.args[0], known)})
        raise ValueError(f'{ast.unparse(node)}: is no expression of integers')


def read_headers(folder: Path = INCLUDE) -> Interface:
    """Return the Interface of the headers in a folder; raises ValueError if they have another format."""
    text = '\n'.join((folder / name).read_text(encoding='utf-8') for name in FILES)
    text = COMMENT.sub('', text).replace('\\\n', ' ')
    macros = read_macros(text)
    return Interface(
        macros.value(macros.numbers['BEV_INTERFACE']),
        {name: _fields(name, body, macros) for body, name in STRUCT.findall(text)},
        {name: _types(name, arguments) for name, arguments in FUNCTION.findall(text)},
        {name: macros.room(name) for name in macros.functions})


def read_macros(text: str) -> Macros:
    """Return the Macros of a text without comments and continued lines."""
    macros = Macros()
    for name, argument, value in DEFINE.findall(text):
        if argument:
            macros.functions[name] = argument, value
        else:
            macros.numbers[name] = value
    for body in ENUM.findall(text):
        following = 0
        for each in filter(None, map(str.strip, body.split(','))):
            name, _, value = map(str.strip, each.partition('='))
            following = macros.value(value) if value else following
            macros.numbers[name] = following
            following += 1
    return macros


def _fields(struct: str, body: str, macros: Macros) -> Fields:
    found = []
    for each in filter(None, (' '.join(part.split()) for part in body.split(';'))):
        match = FIELD.fullmatch(each)
        if match is None or (match[1] == 'uint8_t' and not match[2]):
            raise ValueError(f'{struct}: {each}: is no field as it can be read')
        kind, pointer, name, count = match.groups()
        found.append((name, 'P' if pointer else KINDS.get(kind, kind), macros.value(count) if count else 1))
    return tuple(found)


def _types(function: str, arguments: str) -> str:
    found = ''
    for each in (' '.join(part.split()) for part in arguments.split(',')):
        match = ARGUMENT.fullmatch(each)
        if match is None or not (match[2] or match[3] or match[1] in KINDS):
            raise ValueError(f'{function}: {each}: is no argument as it can be read')
        found += 'P' if match[2] or match[3] else KINDS[match[1]]
    return found
