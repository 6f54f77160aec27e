# SPDX-License-Identifier: Apache-2.0
"""
Symbols that record operations: an equation called with them becomes lines of C.

The equations are defined once, in `vehicle`, as functions that call functions. Called with symbols they
record their arithmetic, operation by operation in the same order, so the numbers of the resulting C are
bit-identical. Only arithmetic can be recorded: a branch on a symbol raises TypeError. The only
exception is a Field, a number that the vehicle has: equations leave out the parts that a vehicle does
not have, and a vehicle with such a part gets another function.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from bev_preheat.numerics import AnyNumber, Arithmetic

Operand: TypeAlias = 'Symbol | float'
# A value with a longer text gets a name of its own.
LONGEST_EXPRESSION = 70


class Symbol:
    """An operation and its operands; arithmetic on a Symbol makes another Symbol."""

    def __init__(self, form: str, *operands: Operand) -> None:
        """`form` is the operation in C, with {} for each operand."""
        self.form, self.operands = form, operands

    def __add__(self, other: Operand) -> Symbol:
        return Symbol('({} + {})', self, other)

    def __radd__(self, other: Operand) -> Symbol:
        return Symbol('({} + {})', other, self)

    def __sub__(self, other: Operand) -> Symbol:
        return Symbol('({} - {})', self, other)

    def __rsub__(self, other: Operand) -> Symbol:
        return Symbol('({} - {})', other, self)

    def __mul__(self, other: Operand) -> Symbol:
        # A factor of one changes no bit.
        if isinstance(other, float) and other == 1.0:
            return self
        return Symbol('({} * {})', self, other)

    def __rmul__(self, other: Operand) -> Symbol:
        return Symbol('({} * {})', other, self)

    def __truediv__(self, other: Operand) -> Symbol:
        return Symbol('({} / {})', self, other)

    def __rtruediv__(self, other: Operand) -> Symbol:
        return Symbol('({} / {})', other, self)

    def __neg__(self) -> Symbol:
        return Symbol('(-{})', self)

    def __bool__(self) -> bool:
        raise TypeError('a branch cannot be noted as straight-line code')


class Field(Symbol):
    """A number that the vehicle has: it is true if equations test for its presence."""

    def __bool__(self) -> bool:
        return True

    def __gt__(self, other: float) -> bool:
        if other != 0.0:
            raise TypeError('a branch cannot be noted as straight-line code')
        return True


# `saturating` is an argument of every generated function, not 0 if powers saturate.
SYMBOLS: Arithmetic[AnyNumber] = Arithmetic(
    root=lambda value: Symbol('bev_root({}, saturating)', value),
    log=lambda value: Symbol('log({})', value),
    exp=lambda value: Symbol('exp({})', value),
    maximum=lambda a, b: Symbol('bev_maximum({}, {})', a, b),
    minimum=lambda a, b: Symbol('bev_minimum({}, {})', a, b),
    share=lambda value: Symbol('bev_share({}, saturating)', value))


def written_out(results: Sequence[Operand]) -> tuple[list[str], list[str]]:
    """Return (lines, texts): declarations in C, and the results; short values used once are in place."""
    uses: dict[Symbol, int] = {}
    order: list[Symbol] = []

    def visit(value: Operand) -> None:
        if isinstance(value, Symbol):
            uses[value] = uses.get(value, 0) + 1
            if uses[value] == 1:
                for operand in value.operands:
                    visit(operand)
                order.append(value)

    for result in results:
        visit(result)
    texts: dict[Symbol, str] = {}
    lines: list[str] = []

    def text_of(operand: Operand) -> str:
        # The shortest decimal that is read as the same number.
        return texts[operand] if isinstance(operand, Symbol) else repr(float(operand))

    for value in order:
        text = value.form.format(*map(text_of, value.operands))
        if value.operands and (uses[value] > 1 or len(text) > LONGEST_EXPRESSION):
            name = f'v{len(lines)}'
            lines.append(f'const double {name} = {without_parentheses(text)};')
            text = name
        texts[value] = text
    return lines, [without_parentheses(text_of(result)) for result in results]


def without_parentheses(text: str) -> str:
    """Return an expression without parentheses that enclose the whole expression."""
    if not text.startswith('('):
        return text
    depth = 0
    for at, letter in enumerate(text):
        depth += (letter == '(') - (letter == ')')
        if depth == 0:
            return text[1:-1] if at == len(text) - 1 else text
    raise ValueError(f'{text}: parentheses do not match')
