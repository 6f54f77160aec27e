# SPDX-License-Identifier: Apache-2.0
"""The simplex method against SciPy's solver, and against answers by hand."""

import numpy as np
import pytest

from bev_preheat.numerics.linear_program import maximise


def test_what_gains_most_for_what_it_uses_is_taken_first():
    # 1.0, 0.9 and 0.8 of gain for 1.0, 0.5 and 0.9 of use: all of the second, then part of the first.
    found = maximise(np.array([1.0, 0.9, 0.8]), np.array([[1.0, 0.5, 0.9]]), [2.0], np.array([5.0, 2.0, 7.0]))
    assert found == pytest.approx([1.0, 2.0, 0.0])


def test_without_gain_nothing_is_moved():
    assert (maximise(np.array([-1.0, 0.0]), np.array([[1.0, -1.0]]), [1.0], np.ones(2)) == 0.0).all()


def test_a_row_that_lacks_is_met_whatever_it_costs_and_as_far_as_it_can_be():
    gains, uses, most = np.array([-1.0, -0.5]), np.array([[-1.0, -0.25]]), np.array([1.0, 8.0])
    assert maximise(gains, uses, [-0.5], most) == pytest.approx([0.5, 0.0])
    assert maximise(gains, uses, [-9.0], most) == pytest.approx([1.0, 8.0])


@pytest.mark.needs('scipy')
@pytest.mark.parametrize('seed', range(60))
def test_it_finds_what_another_solver_finds(seed):
    from scipy.optimize import linprog
    random = np.random.default_rng(seed)
    rows, count = int(random.integers(1, 8)), int(random.integers(1, 120))
    gains, uses = random.uniform(-1.0, 1.0, count), random.uniform(-1.0, 1.0, (rows, count))
    uses[-1] = 1.0
    most = random.uniform(0.0, 5.0, count)
    # Some rows have a deficit at first, which can be met.
    left = uses @ (most * random.uniform(0.0, 0.6, count)) + random.uniform(0.0, 0.2, rows)
    found = maximise(gains, uses, left.tolist(), most)
    other = linprog(-gains, A_ub=uses, b_ub=left, bounds=list(zip(np.zeros(count), most)))
    assert other.status == 0
    assert gains @ found == pytest.approx(-other.fun, abs=1e-7 * count)
    assert ((found >= 0.0) & (found <= most)).all()
    assert (uses @ found <= left + 1e-9 * count).all()
