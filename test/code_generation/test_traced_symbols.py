# SPDX-License-Identifier: Apache-2.0
"""What symbols note, and the C that it becomes."""

import pytest

from bev_preheat.code_generation.symbols import Field, Symbol, SYMBOLS, without_parentheses, written_out

X, Y = Symbol('x'), Symbol('y')


@pytest.mark.parametrize('noted, text', [
    (X + Y, 'x + y'), (2.0 - X, '2.0 - x'), (X - 2.0, 'x - 2.0'), (3 + X, '3.0 + x'),
    (X * 0.1, 'x * 0.1'), (1e-6 * X, '1e-06 * x'), (X / Y, 'x / y'), (1.0 / X, '1.0 / x'), (-X, '-x'),
    ((X + Y) * (X - Y), '(x + y) * (x - y)'), (SYMBOLS.root(X), 'bev_root(x, saturating)'),
    (SYMBOLS.exp(-X), 'exp((-x))'), (SYMBOLS.maximum(X, 0.5), 'bev_maximum(x, 0.5)'), (7.0, '7.0')])
def test_arithmetic_is_noted_in_its_order(noted, text):
    assert written_out([noted]) == ([], [text])


def test_what_is_used_twice_is_worked_out_once():
    total = X + Y
    lines, ends = written_out([total * total, total])
    assert (lines, ends) == (['const double v0 = x + y;'], ['v0 * v0', 'v0'])


def test_a_branch_cannot_be_noted():
    with pytest.raises(TypeError, match='a branch'):
        max(X, Y) if X else Y
    with pytest.raises(TypeError):
        bool(X > 0.0)


def test_a_number_of_the_vehicle_is_there():
    lag_s = Field('vehicle->lag')
    assert lag_s and lag_s > 0.0 and lag_s != 0.0
    with pytest.raises(TypeError, match='a branch'):
        bool(lag_s > 1.0)


@pytest.mark.parametrize('text, bare', [
    ('(x + y)', 'x + y'), ('(x) + (y)', '(x) + (y)'), ('x', 'x'), ('((x) + (y))', '(x) + (y)')])
def test_only_parentheses_around_everything_are_left_out(text, bare):
    assert without_parentheses(text) == bare
