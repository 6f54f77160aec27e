# SPDX-License-Identifier: Apache-2.0
"""The pause after doubt: short after one fault, long after many, and always finite."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.control.heater_switch import HeaterSwitch, HeatingPause
from bev_preheat.tunables import MOST_SWITCH_ONS

S = 1_000_000_000
FULL_W = 5000.0
MINIMUM_OFF_S = 120.0


class Driven:
    """A HeaterSwitch that always wants heat, asked ten times a second unless something is wrong."""

    def __init__(self, minimum_off_s=MINIMUM_OFF_S):
        self.switch, self.tenths, self.minimum_off_s = HeaterSwitch(), 10_000, minimum_off_s
        self.switch_ons_s = []

    def step(self, is_wrong=False):
        """Let a tenth of a second pass; return whether it heats."""
        self.tenths += 1
        was_on, now_ns = self.switch.is_on, self.tenths * S // 10
        if is_wrong:
            self.switch = self.switch.doubted(now_ns, 'battery_state was refused', self.minimum_off_s)
        else:
            self.switch = self.switch.asked(now_ns, FULL_W, FULL_W, 20.0, self.minimum_off_s)
        if self.switch.is_on and not was_on:
            self.switch_ons_s.append(self.tenths / 10.0)
        return self.switch.is_on

    def off_for_s(self):
        """Give valid input until it heats; return the time that took [s]."""
        begun = self.tenths
        while not self.step():
            assert self.tenths - begun < 40_000
        return (self.tenths - begun) / 10.0


def test_one_bad_state_costs_ten_seconds():
    driven = Driven()
    assert driven.step()
    assert not driven.step(is_wrong=True)
    assert driven.off_for_s() == pytest.approx(10.0, abs=0.11)


@pytest.mark.parametrize('minimum_off_s, longest_s', [(0.0, 120.0), (120.0, 120.0), (300.0, 300.0)])
def test_each_further_one_within_ten_minutes_costs_twice_as_much(minimum_off_s, longest_s):
    driven = Driven(minimum_off_s)
    driven.step()
    waited_s = []
    for _ in range(6):
        driven.step(is_wrong=True)
        waited_s.append(driven.off_for_s())
    assert waited_s == pytest.approx([min(each_s, longest_s) for each_s in (
        10.0, 20.0, 40.0, 80.0, 160.0, 320.0)], abs=0.11)


def test_after_ten_good_minutes_all_is_forgotten():
    driven = Driven()
    driven.step()
    for _ in range(3):
        driven.step(is_wrong=True)
        driven.off_for_s()
    for _ in range(6000):
        driven.step()
    driven.step(is_wrong=True)
    assert driven.off_for_s() == pytest.approx(10.0, abs=0.11)


def test_one_bad_state_among_good_ones_ten_times_a_second_does_not_relay():
    driven = Driven()
    driven.step()
    heated = sum(driven.step(is_wrong=number % 2 == 0) for number in range(10_000))
    assert (heated, len(driven.switch_ons_s)) == (0, 1)


def test_a_bad_state_a_minute_does_not_relay_for_ever():
    # It waits for 10, 20 and 40 s of each minute; 80 s never pass without a fault.
    driven = Driven()
    driven.step()
    for number in range(36_000):
        driven.step(is_wrong=number % 600 == 599)
    assert len(driven.switch_ons_s) <= 5
    assert driven.switch_ons_s[-1] < 1000.0 + 5 * 60.0
    assert driven.off_for_s() == pytest.approx(80.0, abs=0.11)


def test_doubt_while_nothing_was_heated_costs_nothing():
    driven = Driven()
    for _ in range(100):
        driven.step(is_wrong=True)
    assert driven.step()


def test_a_new_route_does_not_end_the_pause():
    driven = Driven()
    driven.step()
    driven.step(is_wrong=True)
    driven.switch = driven.switch.allowed().forced_off()
    assert not driven.step()


def test_the_sentence_says_why_and_until_when():
    driven = Driven()
    driven.step()
    driven.step(is_wrong=True)
    for _ in range(41):
        driven.step()
    assert driven.switch.pause.sentence == (
        'battery_state was refused 4 s ago; heating resumes after 10 s of valid input.')
    driven.off_for_s()
    assert driven.switch.pause.sentence == ''
    driven.step(is_wrong=True)
    driven.step()
    assert driven.switch.pause.sentence.endswith('20 s of valid input (interruption 2 in 10 min).')


@pytest.mark.parametrize('back_s', [0.5, 30.0, 1e6])
def test_a_clock_that_falls_back_does_not_lock_the_heater(back_s):
    begin_ns = round((2_000_004 - back_s) * S)
    pause = HeatingPause().at(2_000_000 * S).doubted('Planning failed', True, MINIMUM_OFF_S).at(2_000_004 * S)
    pause = pause.at(begin_ns)
    assert pause.left_s == pytest.approx(6.0)
    assert pause.at(begin_ns + 6 * S).left_s == 0.0


STEPS = st.lists(st.tuples(
    st.floats(0.0, 700.0), st.sampled_from([
        'on', 'on', 'on', 'off', 'doubt', 'force', 'by plan', 'allow', 'back'])), max_size=300)


def test_a_plan_that_changes_its_mind_each_second_heats_half_of_the_time_to_the_end():
    switch, on_s = HeaterSwitch(), []
    for at_s in range(3600):
        switch = switch.asked(at_s * S, FULL_W * (at_s % 2 == 0), FULL_W, 0.0, 0.0)
        if switch.power_w > 0.0:
            on_s.append(at_s)
    # Half of the hour's switchings take 20 s. Then it is 90 s on and 90 s off, or a second longer.
    assert sum(second - first > 1 for first, second in zip([-2, *on_s], on_s)) <= MOST_SWITCH_ONS
    for minute in range(1, 29):
        assert 85 <= sum(60 * minute <= at_s < 60 * minute + 180 for at_s in on_s) <= 95


@pytest.mark.costly
@given(steps=STEPS, minimum_off_s=st.sampled_from([0.0, 120.0]), scale=st.sampled_from([1.0, 0.05, 0.001]))
def test_whatever_comes_in_switch_ons_are_bounded_and_the_heater_is_never_locked(steps, minimum_off_s, scale):
    switch, now_s, passed_s, switch_ons_s = HeaterSwitch(), 1e6, 0.0, []
    for later_s, kind in steps:
        if kind == 'back':
            now_s -= later_s
        else:
            now_s += scale * later_s
            passed_s += scale * later_s
        now_ns, was_on = round(now_s * S), switch.is_on
        if kind == 'doubt':
            switch = switch.doubted(now_ns, 'Planning failed', minimum_off_s)
        elif kind == 'force':
            switch = switch.forced_off()
        elif kind == 'by plan':
            switch = switch.turned_off(now_ns)
        elif kind == 'allow':
            switch = switch.allowed()
        switch = switch.asked(now_ns, 0.0 if kind in ('off', 'doubt', 'force') else FULL_W, FULL_W, 0.0,
                              minimum_off_s)
        if kind == 'doubt':
            assert switch.power_w == 0.0
        if switch.is_on and (not was_on or kind in ('force', 'by plan')):
            switch_ons_s.append(passed_s)
    for first_s, beyond_s in zip(switch_ons_s, switch_ons_s[MOST_SWITCH_ONS:]):
        assert beyond_s - first_s >= 3600.0 - 1e-3
    # After an hour without faults it heats.
    switch = switch.asked(round((now_s + 3600.0) * S), FULL_W, FULL_W, 0.0, minimum_off_s)
    assert switch.asked(round((now_s + 7300.0) * S), FULL_W, FULL_W, 0.0, minimum_off_s).power_w == FULL_W
