# SPDX-License-Identifier: Apache-2.0
"""A plan's status is shown for 10 s at least; doubt, the driver and the heater's switching show at once."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.control.command import SteadyStatus
from bev_preheat.planning.status import Status
from bev_preheat.tunables import LEAST_STATUS_S as LEAST_S

S = 1_000_000_000
OF_PLAN = [status for status in Status if status.meaning.is_of_plan]
AT_ONCE = [status for status in Status if not status.meaning.is_of_plan]


def shown(*rows):
    """Return the status that is shown after each (second, status, is_on)."""
    steady, seen = SteadyStatus(), []
    for at_s, status, is_on in rows:
        steady = steady.settled(round(at_s * S), status, is_on)
        seen.append(steady.shown)
    return seen


def test_another_status_of_a_plan_shows_when_it_has_held_for_ten_seconds():
    rows = [(0, Status.WAITING, False), (1, Status.NOT_NEEDED, False), (10.9, Status.NOT_NEEDED, False),
            (11, Status.NOT_NEEDED, False)]
    assert shown(*rows) == [Status.WAITING] * 3 + [Status.NOT_NEEDED]


def test_a_status_that_comes_and_goes_is_never_shown():
    rows = [(second, Status.TARGET_UNREACHABLE if second % 9 else Status.HEATING, True) for second in range(100)]
    assert set(shown(*rows)) == {Status.HEATING}


@pytest.mark.parametrize('status', AT_ONCE)
def test_what_is_not_the_plans_shows_at_once_and_goes_at_once(status):
    rows = [(0, Status.HEATING, True), (1, status, False), (2, Status.HEATING, True)]
    assert shown(*rows) == [Status.HEATING, status, Status.HEATING]


def test_the_heaters_switching_shows_at_once():
    rows = [(0, Status.WAITING, False), (1, Status.HEATING, True), (2, Status.NOT_NEEDED, False)]
    assert shown(*rows) == [status for _, status, _ in rows]


def test_a_clock_that_is_set_back_begins_the_time_again():
    rows = [(100, Status.WAITING, False), (101, Status.NOT_NEEDED, False), (50, Status.NOT_NEEDED, False),
            (59.9, Status.NOT_NEEDED, False), (60, Status.NOT_NEEDED, False)]
    assert shown(*rows) == [Status.WAITING] * 4 + [Status.NOT_NEEDED]


def test_after_something_new_was_asked_for_it_shows_at_once():
    steady = SteadyStatus().settled(0, Status.WAITING, False)
    assert steady.shown is Status.WAITING
    assert steady.forgotten().settled(S, Status.NOT_NEEDED, False).shown is Status.NOT_NEEDED


@given(st.lists(st.tuples(st.floats(0.01, 8.0), st.sampled_from(OF_PLAN)), min_size=2, max_size=60))
def test_no_status_of_a_plan_is_shown_for_less_than_ten_seconds_while_the_heater_is_not_switched(steps):
    steady, now_s, changes_s, before = SteadyStatus(), 0.0, [], None
    for later_s, status in steps:
        now_s += later_s
        steady = steady.settled(round(now_s * S), status, False)
        now = steady.shown
        if now is not before:
            changes_s.append(now_s)
        before = now
    assert all(later - earlier >= LEAST_S - 1e-6 for earlier, later in zip(changes_s, changes_s[1:]))
