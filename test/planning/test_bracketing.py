# SPDX-License-Identifier: Apache-2.0
"""Searches in a bracket: they find closed-form roots, with few trials, and never leave the bracket."""

import math

from hypothesis import given
from hypothesis import strategies as st

from bev_preheat.planning.bracketing import close_in, follow_slope, least_of, Trial

ROOTS = st.floats(-50.0, 50.0)
STRETCHES = st.floats(0.05, 20.0)


class Counted:
    """An excess with a known root, which remembers the values tried."""

    def __init__(self, excess):
        self.excess, self.values = excess, []

    def __call__(self, value):
        self.values.append(value)
        return Trial(value, self.excess(value), f'at {value}')


def bent(root, interval, bend):
    """Return a rising function with a root, straight for bend = 0."""
    return lambda value: math.sinh(bend * (value - root) / interval) / bend if bend else (
        (value - root) / interval)


@given(root=ROOTS, width=STRETCHES, bend=st.sampled_from([0.0, 0.3, 2.0]), rises=st.booleans())
def test_closing_in_ends_on_the_side_that_is_enough(root, width, bend, rises):
    sign = 1.0 if rises else -1.0
    attempt = Counted(lambda value: sign * bent(root, width, bend)(value))
    enough, too_little = attempt(root + sign * width), attempt(root - 2.0 * sign * width)
    attempt.values.clear()
    found = close_in(enough, too_little, attempt, 1e-6, most_trials=60)
    assert 0.0 <= found.excess <= 1e-6
    assert found.outcome == f'at {found.value}'
    # One trial for a straight line, and never many.
    assert len(attempt.values) <= (2 if bend == 0.0 else 25)
    low, high = sorted((enough.value, too_little.value))
    assert all(low <= value <= high for value in attempt.values)


def test_closing_in_makes_no_more_trials_than_allowed_and_keeps_the_best_that_is_enough():
    attempt = Counted(lambda value: 1.0 if value > 0.3 else -1e9)
    found = close_in(attempt(1.0), attempt(0.0), attempt, 1e-12, most_trials=5)
    assert len(attempt.values) == 2 + 5
    assert found.excess == 1.0 and found.value == min(
        value for value in attempt.values if value > 0.3)


@given(most=st.floats(-5.0, 5.0), span=STRETCHES, rises=st.booleans(), start=st.floats(0.0, 1.0))
def test_where_the_utmost_is_not_enough_it_is_what_is_found(most, span, rises, start):
    sign = 1.0 if rises else -1.0
    least = most - sign * span
    attempt = Counted(lambda value: sign * (value - most) / span - 0.5)
    found = follow_slope(most, least, attempt(least + start * (most - least)), sign / span, attempt,
                         tolerance=1e-6)
    assert (found.value, found.outcome) == (most, f'at {most}')


def valley(lowest, left, right):
    """Return a function with its minimum at `lowest`, and a different slope on either side."""
    return lambda value: (left * (lowest - value) if value < lowest else right * (value - lowest))


@given(share=st.floats(0.0, 1.0), low=ROOTS, width=STRETCHES,
       left=st.floats(0.01, 100.0), right=st.floats(0.01, 100.0), round_below=st.booleans())
def test_golden_section_finds_the_least(share, low, width, left, right, round_below):
    lowest = low + share * width
    kinked = valley(lowest, left, right)
    attempt = Counted((lambda value: kinked(value)**2) if round_below else kinked)
    found = least_of(low, low + width, attempt, 0.01 * width)
    assert abs(found.value - lowest) <= 0.01 * width * (1.0 + 1e-9)
    assert found.outcome == f'at {found.value}'
    assert all(low <= value <= low + width for value in attempt.values)
    # Each trial leaves 0.618 of the bracket: ten to a hundredth, two to start with, two ends.
    assert len(attempt.values) <= 14
    assert found.excess == min(attempt.excess(value) for value in attempt.values)
