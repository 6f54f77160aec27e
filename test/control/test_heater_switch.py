# SPDX-License-Identifier: Apache-2.0
"""Minimum times on and off: the switchings that they delay, and those that they must not delay."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.control.heater_switch import HeaterSwitch

S = 1_000_000_000
FULL_W, LIMIT_W = 5000.0, 5300.0
ON_S, OFF_S = 20.0, 120.0


class Watched:
    """A HeaterSwitch with the times of this test."""

    def __init__(self):
        self.switch = HeaterSwitch()

    @property
    def is_on(self):
        return self.switch.is_on

    def at(self, now_s, wanted_w, limit_w=LIMIT_W):
        self.switch = self.switch.asked(round(now_s * S), wanted_w, limit_w, ON_S, OFF_S)
        return self.switch.power_w

    def become(self, change, *given):
        self.switch = getattr(self.switch, change)(*given)


@pytest.fixture
def heating():
    switch = Watched()
    assert switch.at(1000.0, FULL_W) == FULL_W
    return switch


def test_the_first_request_is_granted_at_once(heating):
    assert heating.is_on


def test_off_waits_for_the_least_time_on(heating):
    assert heating.at(1019.999, 0.0) == FULL_W
    assert heating.at(1020.0, 0.0) == 0.0


def test_on_waits_for_the_least_time_off(heating):
    heating.at(1030.0, 0.0)
    assert heating.at(1149.999, FULL_W) == 0.0
    assert heating.at(1150.0, FULL_W) == FULL_W


def test_what_is_held_on_keeps_its_power_within_what_there_is(heating):
    assert heating.at(1005.0, 0.0, limit_w=3000.0) == 3000.0
    assert heating.at(1006.0, 0.0) == 3000.0
    assert heating.at(1007.0, 0.0, limit_w=0.0) == 0.0


def test_a_request_for_another_power_is_granted_at_once(heating):
    assert heating.at(1001.0, 700.0) == 700.0


def test_a_request_withdrawn_in_time_is_no_switching(heating):
    heating.at(1010.0, 0.0)
    assert heating.at(1012.0, FULL_W) == FULL_W
    assert heating.at(1020.0, 0.0) == 0.0


def test_an_off_by_plan_starts_the_least_time_off(heating):
    heating.become('turned_off', 1005 * S)
    heating.become('turned_off', 1006 * S)
    assert heating.at(1124.999, FULL_W) == 0.0
    assert heating.at(1125.0, FULL_W) == FULL_W


def test_force_off_does_not_wait_and_leaves_no_wait_behind(heating):
    heating.become('forced_off')
    assert not heating.is_on
    assert heating.at(1001.0, FULL_W) == FULL_W


def test_allow_lets_the_next_request_through(heating):
    heating.at(1030.0, 0.0)
    heating.become('allowed')
    assert heating.at(1031.0, FULL_W) == FULL_W


def test_asking_twice_at_one_instant_gives_the_same(heating):
    for now_s, wanted_w in ((1001.0, 0.0), (1020.0, 0.0), (1021.0, FULL_W), (1140.0, FULL_W)):
        assert heating.at(now_s, wanted_w) == heating.at(now_s, wanted_w)


def test_a_clock_that_was_set_back_holds_nothing(heating):
    assert heating.at(3.0, 0.0) == 0.0


WISHES = st.lists(st.tuples(st.floats(0.0, 60.0), st.sampled_from([0.0, 900.0, FULL_W]),
                            st.sampled_from(['ask', 'ask', 'ask', 'force', 'allow'])), max_size=60)


@pytest.mark.costly
@given(preparation_goals=WISHES)
def test_requested_switchings_are_never_closer_than_allowed(preparation_goals):
    switch, now_s, was_on, since_s = Watched(), 0.0, False, None
    for later_s, wanted_w, kind in preparation_goals:
        now_s += later_s
        if kind == 'force':
            switch.become('forced_off')
            was_on, since_s = False, None
        elif kind == 'allow':
            switch.become('allowed')
            since_s = None
        power_w = switch.at(now_s, wanted_w)
        assert 0.0 <= power_w <= LIMIT_W
        if switch.is_on != was_on:
            least_s = ON_S if was_on else OFF_S
            assert since_s is None or now_s - since_s >= least_s - 1e-6
            assert (wanted_w > 0.0) == switch.is_on
            was_on, since_s = switch.is_on, now_s
        assert (power_w > 0.0) == switch.is_on
