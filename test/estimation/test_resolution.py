# SPDX-License-Identifier: Apache-2.0
"""The step of a signal, found from its values."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.estimation.readings import Resolution, SOC_STEPS, TEMPERATURE_STEPS_K


def found(values, steps=TEMPERATURE_STEPS_K):
    resolution = Resolution(steps)
    for value in values:
        resolution = resolution.seen(value)
    return resolution.step


@pytest.mark.parametrize('values, step', [
    ([], 1.0), ([-7.0, -6.0, -3.0], 1.0), ([-7.0, -6.5], 0.5), ([-7.0, -6.75], 0.25),
    ([-7.0, -6.8], 0.2), ([-7.0, -6.9], 0.1), ([-7.0, -6.998], 0.0), ([-7.5, -6.8], 0.1)])
def test_steps_of_a_temperature(values, step):
    assert found(values) == step


def test_single_precision_hides_no_step():
    assert found([float(np.float32(value)) for value in (-7.1, -6.9, 12.3, 59.9)]) == 0.1


def test_steps_of_a_state_of_charge():
    assert found([0.9, 0.895, 0.89], SOC_STEPS) == 0.005


@given(st.lists(st.integers(-40, 60), min_size=1, max_size=80), st.sampled_from([1.0, 0.5, 0.25]))
def test_a_rounded_signal_is_never_taken_for_a_finer_one(counts, step):
    assert found([count * step for count in counts]) >= step
