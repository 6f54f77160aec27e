# SPDX-License-Identifier: Apache-2.0
"""The core's own C headers, read: structs, prototypes, and the memory that functions take."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
import re

from bev_preheat.native.interface import Fields, Interface, Room

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
