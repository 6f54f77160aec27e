# SPDX-License-Identifier: Apache-2.0
"""A state of charge on a scale of 100 that falls below 1."""

import pytest

from bev_preheat.estimation.electrical import PercentScale


def never():
    return False


def scale_after(*refused):
    scale = PercentScale()
    for second, percentage in enumerate(refused):
        scale = scale.refused(100.0 + second, percentage)
    return scale


def doubts(scale, *seen):
    """Return the sentences on (instant [s], state of charge, whether the voltage vouches for it)."""
    sentences = []
    for instant_s, soc, is_vouched_for in seen:
        scale, sentence = scale.seen(instant_s, soc, is_vouched_for)
        sentences.append(sentence)
    return sentences


def test_a_value_below_1_after_values_above_it_is_on_their_scale():
    first, *later = doubts(
        scale_after(3.4, 1.6, 1.2), (110.0, 0.8, never), (300.0, 0.6, never), (800.0, 0.3, never))
    assert first == 'percentage: 0.8 follows 1.2, which is on a scale of 100; expected 0 ... 1: 0.008?'
    assert all(later)


def test_the_voltage_may_vouch_for_it():
    assert doubts(scale_after(1.2), (110.0, 0.8, lambda: True), (111.0, 0.8, never)) == ['', '']


def test_a_stray_value_among_valid_ones_changes_nothing():
    scale, sentence = PercentScale().seen(100.0, 0.79, never)
    assert sentence == ''
    assert doubts(scale.refused(101.0, 1.2), (102.0, 0.79, never)) == ['']


@pytest.mark.parametrize('refused', [-0.3, 1.0, 655.35, float('nan')])
def test_values_of_no_scale_of_100_say_nothing(refused):
    assert doubts(scale_after(refused), (110.0, 0.8, never)) == ['']


def test_it_is_forgotten_after_a_while():
    assert doubts(scale_after(1.2), (100.0 + 601.0, 0.8, never)) == ['']
