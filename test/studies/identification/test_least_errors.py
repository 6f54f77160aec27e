# SPDX-License-Identifier: Apache-2.0
"""The Cramer-Rao bound of noisy, rounded readings, and the figures over all cars, against their definitions."""

import numpy as np
import pytest

pytestmark = [pytest.mark.needs('casadi'), pytest.mark.needs('scipy')]


def test_the_information_of_a_rounded_reading_is_the_variance_of_its_score():
    from bev_preheat_studies.identification.bound import reading_information
    generator, at_c, change_k = np.random.default_rng(2), np.array([3.0, 3.3, 3.48, -7.6]), 0.02
    noise_k = generator.normal(0.0, 0.2, 400_000)
    for temperature_c, information in zip(at_c.tolist(), reading_information(at_c).tolist()):
        # d/dT of the probabilities of each value, from counts of the same noise.
        shares = []
        for side in (-change_k, 0.0, change_k):
            values, counts = np.unique(np.round(temperature_c + side + noise_k), return_counts=True)
            shares.append(dict(zip(values.tolist(), (counts / len(noise_k)).tolist())))
        low, now, high = shares
        expected = sum(((high.get(value, 0.0) - low.get(value, 0.0)) / (2.0 * change_k))**2 / share
                       for value, share in now.items() if share > 1e-3)
        assert information == pytest.approx(expected, rel=0.05, abs=0.3)


def test_a_boundary_tells_most():
    from bev_preheat_studies.identification.bound import reading_information
    middle, boundary = reading_information(np.array([4.0, 4.5]))
    # At the boundary the value is the sign of the noise: density^2 / (1/2 * 1/2).
    assert boundary == pytest.approx(4.0 / (2.0 * np.pi * 0.2**2), rel=1e-3)
    assert middle < 0.2 * boundary


def test_figures_are_those_of_all_cars():
    from bev_preheat_studies.identification.study import Outcome, pooled_coverage, summary
    cars = [[Outcome('leakage', 0.01 * number, 0.02, number < 9, True, 'one mass', 0.3, 1.0),
             Outcome('capacity', -0.001, None, True, number > 0, 'one mass', 0.3, 1.0)] for number in range(11)]
    leakage, capacity = summary(cars)
    assert (leakage.name, leakage.cars, leakage.median) == ('leakage', 11, pytest.approx(0.05))
    assert leakage.most == pytest.approx(0.095)
    assert leakage.bound == pytest.approx(1.96 * 0.02)
    assert leakage.covered == pytest.approx(9 / 11)
    assert (capacity.bound, capacity.covered, capacity.identified) == (None, 1.0, pytest.approx(10 / 11))
    assert pooled_coverage(cars) == pytest.approx(20 / 22)
