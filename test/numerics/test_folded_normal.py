# SPDX-License-Identifier: Apache-2.0
"""The mean magnitude against SciPy's distribution, and properties for every mean and variance."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics.folded_normal import mean_magnitude

POWERS_W = st.floats(-3e5, 3e5)
DEVIATIONS_W = st.floats(0.0, 3e5)


@pytest.mark.parametrize(('mean', 'deviation'), [
    (0.0, 1.0), (1.0, 1.0), (-1.0, 1.0), (5.0, 1.0), (-8.9, 1.0), (12e3, 18e3), (-7e3, 400.0)])
def test_it_is_that_of_the_folded_normal_distribution(mean, deviation):
    from scipy.stats import foldnorm
    assert mean_magnitude(mean, deviation**2) == pytest.approx(
        foldnorm(abs(mean) / deviation, scale=deviation).mean(), rel=1e-12)


def test_it_is_that_of_many_draws():
    drawn = np.random.default_rng(5).normal(3e3, 9e3, 400_000)
    assert mean_magnitude(3e3, 81e6) == pytest.approx(np.abs(drawn).mean(), rel=5e-3)


@given(POWERS_W)
def test_where_nothing_varies_it_is_the_magnitude_of_the_mean(mean):
    assert mean_magnitude(mean, 0.0) == abs(mean)


@given(POWERS_W, DEVIATIONS_W)
def test_it_lies_between_the_magnitude_of_the_mean_and_the_root_mean_square(mean, deviation):
    magnitude = mean_magnitude(mean, deviation**2)
    assert abs(mean) * (1.0 - 1e-12) <= magnitude <= np.hypot(mean, deviation) * (1.0 + 1e-12)


@given(POWERS_W, DEVIATIONS_W)
def test_the_sign_of_the_mean_does_not_matter(mean, deviation):
    assert mean_magnitude(-mean, deviation**2) == mean_magnitude(mean, deviation**2)


def test_arrays_are_taken_one_by_one():
    means, variances = np.array([[-2.0], [5.0]]), np.array([0.0, 4.0, 100.0])
    together = mean_magnitude(means, variances)
    assert together.tolist() == [[float(mean_magnitude(mean, variance)) for variance in variances]
                                 for mean in means[:, 0]]
