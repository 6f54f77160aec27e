# SPDX-License-Identifier: Apache-2.0
"""Functions of arrays, the mean magnitude and the truncated normal distribution: closed forms, laws, and bits."""

from math import exp, log, pi

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import array_exp, array_log, mean_magnitude, truncated_moments

# --- Functions of arrays: equal numbers give equal bits, regardless of memory layout ---

FUNCTIONS = [(array_exp, exp), (array_log, log)]
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


# --- The mean magnitude ---

POWERS_W = st.floats(-3e5, 3e5)
DEVIATIONS_W = st.floats(0.0, 3e5)


@pytest.mark.parametrize(('mean', 'deviation'), [
    (0.0, 1.0), (1.0, 1.0), (-1.0, 1.0), (5.0, 1.0), (-8.9, 1.0), (12e3, 18e3), (-7e3, 400.0)])
def test_it_is_that_of_the_folded_normal_distribution(mean, deviation):
    from scipy.stats import foldnorm
    assert mean_magnitude(mean, deviation**2) == pytest.approx(
        foldnorm(abs(mean) / deviation, scale=deviation).mean(), rel=1e-12)


@given(POWERS_W, DEVIATIONS_W)
def test_it_lies_between_the_magnitude_of_the_mean_and_the_root_mean_square(mean, deviation):
    magnitude = mean_magnitude(mean, deviation**2)
    assert abs(mean) * (1.0 - 1e-12) <= magnitude <= np.hypot(mean, deviation) * (1.0 + 1e-12)


# --- Truncated normal moments ---


def trapezoid(values, x):
    return 0.5 * ((values[1:] + values[:-1]) * np.diff(x)).sum()


def integrated(mean, variance, low, high):
    """Return moments by the trapezoidal rule on a fine grid within the interval."""
    x = np.linspace(low, high, 400_001)
    log_density = -0.5 * (x - mean)**2 / variance - 0.5 * log(2.0 * pi * variance)
    # Relative to the largest, which may be tiny.
    density = np.exp(log_density - log_density.max())
    mass = trapezoid(density, x)
    first = trapezoid(density * x, x) / mass
    return first, trapezoid(density * (x - first)**2, x) / mass, log(mass) + log_density.max()


@pytest.mark.parametrize('mean, variance, low, high', [
    (0.3, 0.04, -0.5, 0.5), (2.7, 1.9, 2.5, 3.5), (-6.0, 0.25, -7.5, -6.5), (4.0, 0.3, 2.0, 2.5),
    (1.0, 9.0, 0.9, 1.1)])
def test_moments_are_those_of_integration(mean, variance, low, high):
    assert truncated_moments(mean, variance, low, high) == pytest.approx(
        integrated(mean, variance, low, high), rel=1e-6, abs=1e-9)


@given(mean=st.floats(-100.0, 100.0), variance=st.floats(1e-4, 100.0),
       low=st.floats(-100.0, 100.0), width=st.floats(0.01, 5.0))
def test_moments_lie_where_they_can(mean, variance, low, width):
    seen, kept, log_probability = truncated_moments(mean, variance, low, low + width)
    assert low - 1e-6 <= seen <= low + width + 1e-6
    # No distribution on an interval has a standard deviation above half its width, nor a larger one than before.
    assert 0.0 <= kept <= min(0.25 * width**2, variance) * (1.0 + 1e-6) + 1e-12
    assert log_probability <= 1e-12


@pytest.mark.parametrize('low, width', [(9.0, 0.125), (8.5, 3.0), (12.0, 1e-7), (20.0, 5.0)])
@pytest.mark.parametrize('side', [1.0, -1.0])
def test_moments_in_the_tails_are_those_of_integration(low, width, side):
    """Up to the tail's deviation from an exponential: 2/d^2 of the mean, 6/d^2 of the variance."""
    edges = (low, low + width) if side > 0.0 else (-low - width, -low)
    mean, variance, log_mass = integrated(0.0, 1.0, *edges)
    seen, kept, log_probability = truncated_moments(0.0, 1.0, *edges)
    assert abs(seen) - low == pytest.approx(abs(mean) - low, rel=2.5 / low**2)
    assert kept == pytest.approx(variance, rel=7.0 / low**2, abs=0.0)
    assert log_probability == pytest.approx(log_mass, abs=0.02)
