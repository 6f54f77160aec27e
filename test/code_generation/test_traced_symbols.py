# SPDX-License-Identifier: Apache-2.0
"""What symbols note, and the C that it becomes."""

import pytest

from bev_preheat.code_generation.symbols import Field, Symbol, written_out

X, Y = Symbol('x'), Symbol('y')


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
