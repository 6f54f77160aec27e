# SPDX-License-Identifier: Apache-2.0
"""
Compiles an integrator's step of the model into straight-line Python for plain floats.

The equations stand once, in `model` and `vehicle.curves`, as functions that call functions; run some
thousand times for each plan, a good part of the time goes into the calls. So the step is called once
with symbols that note what is done to them, and what they noted is compiled, operation by operation
in the same order, so the numbers are the same to the last bit. Only arithmetic can be noted: a
branch on a symbol raises TypeError.

Python's compiler takes longer than all else here, and the estimation corrects the vehicle's numbers
every few seconds. So numbers stay out of the source, and the same equations are compiled once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from types import CodeType
from typing import Any, TypeAlias

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, CurveFunction, FLOATS

ARGUMENTS = ('soc', 'temperature_c', 'duration_s', 'power_w', 'variance_w2', 'heat_w',
             'leakage_w_per_k')
# The kinds of equations that vehicle files, integrators and arithmetics make, with room to spare.
KEPT_SOURCES = 32
Operand: TypeAlias = '_Symbol | float'
# What `compile_step` returns.
StepOfStates = Callable[[float, float, float, float, float, float, float], tuple[float, float]]
Roll = Callable[[float, float, Iterable[Sequence[float]]], tuple[list[float], list[float]]]
# A step of `vehicle.model` or `vehicle.heat_path`, whose first results are the states at its end.
AnyStep = Callable[..., Sequence[AnyNumber]]


class _Symbol:
    """An operation and what it is done to; arithmetic on it makes another one."""

    def __init__(self, form: str, *operands: Operand) -> None:
        """`form` is the operation's text, with {} for each operand."""
        self.form, self.operands = form, operands

    def __add__(self, other: Operand) -> _Symbol:
        return _Symbol('({} + {})', self, other)

    def __radd__(self, other: Operand) -> _Symbol:
        return _Symbol('({} + {})', other, self)

    def __sub__(self, other: Operand) -> _Symbol:
        return _Symbol('({} - {})', self, other)

    def __rsub__(self, other: Operand) -> _Symbol:
        return _Symbol('({} - {})', other, self)

    def __mul__(self, other: Operand) -> _Symbol:
        return _Symbol('({} * {})', self, other)

    def __rmul__(self, other: Operand) -> _Symbol:
        return _Symbol('({} * {})', other, self)

    def __truediv__(self, other: Operand) -> _Symbol:
        return _Symbol('({} / {})', self, other)

    def __rtruediv__(self, other: Operand) -> _Symbol:
        return _Symbol('({} / {})', other, self)

    def __neg__(self) -> _Symbol:
        return _Symbol('(-{})', self)

    def __bool__(self) -> bool:
        raise TypeError('a branch cannot be noted as straight-line code')


def compile_step(make_step: Callable[[Arithmetic[AnyNumber]], AnyStep],
                 floats: Arithmetic[float]) -> tuple[StepOfStates, Roll]:
    """
    Return (step, roll) for plain floats.

    `make_step(arithmetic)` returns a step of `model` (its first two results are the states at its
    end); `floats` is the Arithmetic for floats that it is compiled for. `step(*ARGUMENTS)` returns
    (soc, temperature [deg C]); `roll(soc, temperature_c, columns)` makes a step for each row of the
    columns (those of ARGUMENTS after the states) and returns the lists of states, one longer.
    """
    step: StepOfStates
    roll: Roll
    step, roll = compile_states(make_step, floats, ARGUMENTS, states=2, results=2)
    return step, roll


def compile_states(make_step: Callable[[Arithmetic[AnyNumber]], AnyStep],
                   floats: Arithmetic[float], arguments: Sequence[str],
                   states: int, results: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """
    Return (step, roll) for plain floats, of a step whose first `arguments` are states.

    As `compile_step` does for the model's two states; the step returns its first `results`.
    """
    names: dict[str, Any] = {
        'root': floats.root, 'log': floats.log, 'exp': floats.exp, 'maximum': floats.maximum,
        'minimum': floats.minimum, 'share': floats.share}

    def opaque(function: CurveFunction[float]) -> CurveFunction[AnyNumber]:
        name = f'table_{len(names)}'
        names[name] = function
        return lambda soc, temperature_c: _Symbol(f'{name}({{}}, {{}})', soc, temperature_c)

    symbols = Arithmetic(
        root=lambda value: _Symbol('root({})', value),
        log=lambda value: _Symbol('log({})', value),
        exp=lambda value: _Symbol('exp({})', value),
        maximum=lambda a, b: _Symbol('maximum({}, {})', a, b),
        minimum=lambda a, b: _Symbol('minimum({}, {})', a, b),
        opaque=opaque,
        share=lambda value: value if floats.share is FLOATS.share else _Symbol(
            'share({})', value))
    lines, ends, numbers = _written_out(
        make_step(symbols)(*(_Symbol(name) for name in arguments))[:results])
    names.update(numbers)
    # As defaults they are local variables, which Python reads faster than global ones.
    own = ', '.join(f'{name}={name}' for name in names)
    state_names, inputs = arguments[:states], arguments[states:]
    source = '\n'.join([
        f'def step({", ".join(arguments)}, *, {own}):',
        *(f'    {line}' for line in lines),
        f'    return {", ".join(ends)}',
        '',
        f'def roll({", ".join(state_names)}, columns, *, {own}):',
        *(f'    all_{name} = [{name}]' for name in state_names),
        f'    for {", ".join(inputs)} in zip(*columns):',
        *(f'        {line}' for line in lines),
        f'        {", ".join(state_names)} = {", ".join(ends[:states])}',
        *(f'        all_{name}.append({name})' for name in state_names),
        f'    return {", ".join(f"all_{name}" for name in state_names)}',
    ])
    exec(_compiled(source), names)
    return names['step'], names['roll']


@lru_cache(maxsize=KEPT_SOURCES)
def _compiled(source: str) -> CodeType:
    return compile(source, '<the model, written out>', 'exec')


def _written_out(results: Sequence[Operand]) -> tuple[list[str], list[str], dict[str, float]]:
    """
    Lines of assignments, the texts of the results, and the numbers in both by name.

    What is used once stands in its place.
    """
    uses: dict[_Symbol, int] = {}
    order: list[_Symbol] = []

    def visit(value: Operand) -> None:
        if isinstance(value, _Symbol):
            uses[value] = uses.get(value, 0) + 1
            if uses[value] == 1:
                for operand in value.operands:
                    visit(operand)
                order.append(value)

    for result in results:
        visit(result)
    texts: dict[Operand, str] = {}
    lines: list[str] = []
    numbers: dict[str, float] = {}

    def text_of(operand: Operand) -> str:
        if isinstance(operand, _Symbol):
            return texts[operand]
        name = f'n{len(numbers)}'
        numbers[name] = float(operand)
        return name

    for value in order:
        text = value.form.format(*map(text_of, value.operands))
        if value.operands and uses[value] > 1:
            name = f'v{len(lines)}'
            lines.append(f'{name} = {text}')
            text = name
        texts[value] = text
    return lines, [texts[result] for result in results], numbers
