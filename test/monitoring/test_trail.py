# SPDX-License-Identifier: Apache-2.0
"""The history of the page: bounded, recent points whole, older ones further apart."""

from hypothesis import given
from hypothesis import strategies as st

from bev_preheat.monitoring.board import Trail


def test_a_day_at_one_hertz_stays_small_and_keeps_its_latest_minutes_whole():
    trail = Trail(most=1000)
    for second in range(100_000):
        trail.add((float(second), 2.0 * second))
        assert len(trail) <= 1000
    times = [at_s for at_s, _ in trail.since(0)]
    assert times[-60:] == [float(second) for second in range(100_000 - 60, 100_000)]
    # Not only the latest: hours back without a large gap, but not beyond the horizon.
    assert 100_000 - 86400 - 200 <= times[0] < 100_000 - 80_000
    # On a screen a gap of 6 % of the age is a few points wide.
    assert all(after - before <= 1.0 + 0.06 * (100_000 - before) for before, after in zip(times, times[1:]))
    assert all(value == 2.0 * at_s for at_s, value in trail.since(0))


@given(st.lists(st.floats(0.0, 1e6, allow_nan=False), max_size=300), st.integers(4, 50))
def test_instants_rise_and_the_size_is_bounded_whatever_comes(instants, most):
    trail = Trail(most=most, horizon_s=1e5)
    for at_s in instants:
        trail.add((at_s,))
        rows = list(trail.since(0))
        assert rows[-1] == (at_s,) and len(rows) <= most
        assert all(before < after for before, after in zip(rows, rows[1:]))


@given(st.lists(st.floats(0.0, 1e4, allow_nan=False), max_size=200))
def test_a_reader_that_heeds_the_generation_has_all(instants):
    trail, known, generation = Trail(most=20), [], 0
    for at_s in instants:
        trail.add((at_s,))
        if trail.generation != generation:
            known, generation = [], trail.generation
        known += trail.since(len(known))
        assert known == list(trail.since(0))
