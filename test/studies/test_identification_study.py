# SPDX-License-Identifier: Apache-2.0
"""The figures of identified synthetic cars."""

import pytest

from bev_preheat_studies.identification.study import Outcome, pooled_coverage, summary


def test_figures_by_parameter():
    def outcome(error, is_covered, name='leakage'):
        return Outcome(name, error, is_covered, True, 'one mass', 0.2, 1.0)

    cars = [[outcome(0.1, True), outcome(0.0, True, 'capacity')], [outcome(-0.3, False)], [outcome(0.2, True)]]
    leakage, capacity = summary(cars)
    assert (leakage.name, leakage.cars, capacity.cars) == ('leakage', 3, 1)
    assert leakage.median == pytest.approx(0.1) and leakage.most == pytest.approx(0.29)
    assert leakage.covered == pytest.approx(2.0 / 3.0) and pooled_coverage(cars) == 0.75
