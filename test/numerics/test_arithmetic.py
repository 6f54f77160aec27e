# SPDX-License-Identifier: Apache-2.0
"""Functions of arrays: equal numbers give equal bits, regardless of memory layout."""

import math

import numpy as np
import pytest

from bev_preheat.numerics import array_exp, array_log

FUNCTIONS = [(array_exp, math.exp), (array_log, math.log)]
VALUES = np.random.default_rng(7).uniform(0.2, 3.0, (40, 6))


def laid_out(offset, stride):
    """VALUES as a view into a larger block, `offset` floats from its start, every `stride`-th."""
    block = np.full(offset + VALUES.size * stride + 8, 7.0)
    view = block[offset:offset + VALUES.size * stride:stride].reshape(VALUES.shape)
    view[...] = VALUES
    return view


@pytest.mark.parametrize(('function', 'of_a_float'), FUNCTIONS)
def test_value_is_that_of_the_function_of_floats(function, of_a_float):
    expected = [[of_a_float(value) for value in row] for row in VALUES.tolist()]
    np.testing.assert_allclose(function(VALUES), expected, rtol=1e-15)


@pytest.mark.parametrize(('function', 'of_a_float'), FUNCTIONS)
def test_bits_do_not_depend_on_where_the_numbers_lie(function, of_a_float):
    expected = function(VALUES)
    for offset in range(8):
        for stride in (1, 2, 3, 12):
            assert np.array_equal(function(laid_out(offset, stride)), expected)
    assert np.array_equal(function(VALUES.T), expected.T)
    assert np.array_equal(function(VALUES[..., 2]), function(VALUES[..., 2].copy()))


@pytest.mark.parametrize(('function', 'of_a_float'), FUNCTIONS)
def test_shape_is_kept_and_a_number_gives_a_number(function, of_a_float):
    assert function(VALUES[:, :0]).shape == (40, 0)
    assert np.ndim(function(0.5)) == 0
    assert float(function(0.5)) == pytest.approx(of_a_float(0.5), rel=1e-15)
