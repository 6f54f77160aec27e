# SPDX-License-Identifier: Apache-2.0
"""The mean magnitude against SciPy's distribution, and properties for every mean and variance."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.numerics import mean_magnitude

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
