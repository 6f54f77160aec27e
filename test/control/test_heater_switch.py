# SPDX-License-Identifier: Apache-2.0
"""The heater's switch: minimum times on and off, the pause after doubt, and the status that is shown meanwhile."""

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.control.command import SteadyStatus
from bev_preheat.control.heater_switch import HeaterSwitch, HeatingPause
from bev_preheat.planning.status import Status
from bev_preheat.tunables import LEAST_STATUS_S as LEAST_S
from bev_preheat.tunables import MOST_SWITCH_ONS

S = 1_000_000_000
FULL_W, LIMIT_W = 5000.0, 5300.0
ON_S, OFF_S = 20.0, 120.0


def asked(switch, now_s, wanted_w, limit_w=LIMIT_W):
    """Return the HeaterSwitch after a request [W] at an instant [s], with the times of this test."""
    return switch.asked(round(now_s * S), wanted_w, limit_w, ON_S, OFF_S)


HEATING = asked(HeaterSwitch(), 1000.0, FULL_W)


# A request below 0 means no heating.
@pytest.mark.parametrize('wanted_w, power_w', [(0.5, 0.5), (0.0, 0.0), (-1.0, 0.0)])
def test_the_least_power_switches_the_heater_on_and_none_does_not(wanted_w, power_w):
    for before in HeaterSwitch(), HEATING:
        switch = asked(before, 1020.0, wanted_w)
        assert (switch.is_on, switch.power_w) == (power_w > 0.0, power_w)


@pytest.mark.parametrize('later_ns, power_w', [
    (0, FULL_W), (1, FULL_W), (20 * S - 1, FULL_W), (20 * S, 0.0), (-1, 0.0)])
def test_the_least_time_on_lasts_from_the_very_instant_to_its_end(later_ns, power_w):
    assert HEATING.asked(1000 * S + later_ns, 0.0, LIMIT_W, ON_S, OFF_S).power_w == power_w


def test_after_twenty_switch_ons_the_next_one_comes_an_hour_after_the_first():
    switch = HeaterSwitch()
    for number in range(20):
        for at_s, power_w in (180 * number, FULL_W), (180 * number + 90, 0.0):
            switch = switch.asked(at_s * S, power_w, LIMIT_W, 0.0, 0.0)
            assert switch.power_w == power_w
    switch = switch.asked(3600 * S - S // 1000, FULL_W, LIMIT_W, 0.0, 0.0)
    assert (switch.power_w, switch.pause.left_s) == (0.0, pytest.approx(0.001))
    assert switch.asked(3600 * S, FULL_W, LIMIT_W, 0.0, 0.0).power_w == FULL_W


WISHES = st.lists(st.tuples(st.floats(0.0, 60.0), st.sampled_from([0.0, 900.0, FULL_W]),
                            st.sampled_from(['ask', 'ask', 'ask', 'force', 'allow'])), max_size=60)


@pytest.mark.costly
@given(preparation_goals=WISHES)
def test_requested_switchings_are_never_closer_than_allowed(preparation_goals):
    switch, now_s, was_on, since_s = HeaterSwitch(), 0.0, False, None
    for later_s, wanted_w, kind in preparation_goals:
        now_s += later_s
        if kind == 'force':
            switch = switch.forced_off()
            was_on, since_s = False, None
        elif kind == 'allow':
            switch = switch.allowed()
            since_s = None
        switch = asked(switch, now_s, wanted_w)
        assert 0.0 <= switch.power_w <= LIMIT_W
        if switch.is_on != was_on:
            least_s = ON_S if was_on else OFF_S
            assert since_s is None or now_s - since_s >= least_s - 1e-6
            assert (wanted_w > 0.0) == switch.is_on
            was_on, since_s = switch.is_on, now_s
        assert (switch.power_w > 0.0) == switch.is_on


class Driven:
    """A HeaterSwitch that always wants heat, asked ten times a second unless something is wrong."""

    def __init__(self, minimum_off_s=OFF_S):
        self.switch, self.tenths, self.minimum_off_s = HeaterSwitch(), 10_000, minimum_off_s

    def step(self, is_wrong=False):
        """Let a tenth of a second pass; return whether it heats."""
        self.tenths += 1
        now_ns = self.tenths * S // 10
        if is_wrong:
            self.switch = self.switch.doubted(now_ns, 'battery_state was refused')
        else:
            self.switch = self.switch.asked(now_ns, FULL_W, FULL_W, 20.0, self.minimum_off_s)
        return self.switch.is_on

    def off_for_s(self):
        """Give valid input until it heats; return the time that took [s]."""
        begun = self.tenths
        while not self.step():
            assert self.tenths - begun < 40_000
        return (self.tenths - begun) / 10.0


@pytest.mark.parametrize('minimum_off_s, wrong', [(0.0, 1), (120.0, 2)])
def test_an_interruption_costs_ten_seconds_the_next_ones_a_minute_and_later_three(minimum_off_s, wrong):
    driven = Driven(minimum_off_s)
    driven.step()
    waited_s = []
    for _ in range(12):
        for _ in range(wrong):
            driven.step(is_wrong=True)
        waited_s.append(driven.off_for_s())
    # Half of the hour's switch-ons come as fast; then one in 3 min, the time on of a tenth of a second included.
    assert waited_s == pytest.approx([10.0] + [60.0] * 8 + [180.0] * 3, abs=0.21)


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
    for _ in range(9):
        driven.step(is_wrong=True)
        driven.off_for_s()
    for wrong in (True, *[False] * 101):
        driven.step(is_wrong=wrong)
    assert driven.switch.pause.sentence == (
        'The heater was switched on 11 times within an hour; the next time is possible in 170 s.')


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
            switch = switch.doubted(now_ns, 'Planning failed')
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


OF_PLAN = [status for status in Status if status.meaning.is_of_plan]
AT_ONCE = [status for status in Status if not status.meaning.is_of_plan]


def shown(*rows):
    """Return the status that is shown after each (second, status, is_on)."""
    steady, seen = SteadyStatus(), []
    for at_s, status, is_on in rows:
        steady = steady.settled(round(at_s * S), status, is_on)
        seen.append(steady.shown)
    return seen


@pytest.mark.parametrize('status', AT_ONCE)
@pytest.mark.parametrize('is_on', [False, True])
def test_what_is_not_the_plans_shows_at_once_and_goes_at_once(status, is_on):
    rows = [(0, Status.HEATING, True), (1, status, is_on), (2, Status.HEATING, True)]
    assert shown(*rows) == [Status.HEATING, status, Status.HEATING]


@pytest.mark.parametrize('back_s', [0, 60])
def test_another_status_of_a_plan_shows_once_it_has_held_for_ten_seconds_of_a_clock_that_may_be_set_back(back_s):
    later = [(at_s - back_s, Status.TARGET_UNREACHABLE, True) for at_s in (105, 114.999, 115)]
    assert shown((100, Status.HEATING, True), (105, Status.TARGET_UNREACHABLE, True), *later) == [
        Status.HEATING] * 4 + [Status.TARGET_UNREACHABLE]


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


@pytest.mark.parametrize('back_s', [0.5, 30.0, 1e6])
def test_a_clock_that_falls_back_does_not_lock_the_heater(back_s):
    begin_ns = round((2_000_004 - back_s) * S)
    pause = HeatingPause().at(2_000_000 * S).doubted('Planning failed', True).at(2_000_004 * S)
    pause = pause.at(begin_ns)
    assert pause.left_s == pytest.approx(6.0)
    assert pause.at(begin_ns + 6 * S).left_s == 0.0


def test_what_is_held_on_keeps_its_power_within_what_there_is():
    held = asked(HEATING, 1005.0, 0.0, limit_w=3000.0)
    assert (HEATING.power_w, held.power_w) == (FULL_W, 3000.0)
    assert asked(held, 1006.0, 0.0).power_w == 3000.0
    assert asked(held, 1007.0, 0.0, limit_w=0.0).power_w == 0.0


def test_an_off_by_plan_starts_the_least_time_off():
    off = HEATING.turned_off(1005 * S).turned_off(1006 * S)
    assert [asked(off, now_s, FULL_W).power_w for now_s in (1124.999, 1125.0)] == [0.0, FULL_W]
