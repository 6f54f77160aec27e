# SPDX-License-Identifier: Apache-2.0
"""The reference of a heater controller, rule by rule (docs/explanation/safety.md)."""

import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.heater_controller import (
    DOUBT_S,
    HeaterCommand,
    HeaterController,
    HeaterLimits,
    Instant,
    Refusal,
    Verdict,
)

START_S = 1_000_000.0
LIMITS = HeaterLimits(7000.0, longest_lease_s=20.0, clock_tolerance_s=0.5)


def ns(seconds):
    return round(seconds * NS_PER_S)


class Heater:
    """A controller with two clocks that pass together until the test sets one."""

    def __init__(self, limits=LIMITS):
        self.controller, self.clock_s, self.steady_s = HeaterController(limits), START_S, 50.0

    @property
    def now(self):
        return Instant(ns(self.clock_s), ns(self.steady_s))

    def wait(self, seconds):
        self.clock_s += seconds
        self.steady_s += seconds

    def command(self, power_w, lease_s=2.5, stamp_s=None, sender='planner'):
        stamp_s = self.clock_s if stamp_s is None else stamp_s
        self.controller.take(HeaterCommand(power_w, ns(stamp_s), ns(stamp_s + lease_s), sender), self.now)

    def answer(self, **conditions):
        return self.controller.step(self.now, **conditions)

    def power_w(self):
        return self.answer().active_w


def test_valid_command_is_applied_until_its_lease_ends():
    heater = Heater()
    assert heater.answer()[:3] == (0.0, 0.0, Refusal.NO_COMMAND)
    heater.command(2500.0)
    assert heater.answer() == (2500.0, 2500.0, Refusal.NOT_REFUSED, '')
    heater.wait(1.0)
    # The shorter by both clocks.
    for set_by_s, left_s in ((0.0, 1.5), (1.0, 0.5), (-1.0, 1.5), (60.0, 0.0)):
        now = Instant(ns(heater.clock_s + set_by_s), ns(heater.steady_s))
        assert heater.controller.lease_left_s(now) == left_s, set_by_s
    heater.wait(1.499)
    assert heater.power_w() == 2500.0
    heater.wait(0.001)
    assert heater.answer() == (0.0, 0.0, Refusal.NO_COMMAND, 'the lease of the latest command has ended')


@pytest.mark.parametrize('stamped_s, clock_s, steady_s, is_on', [
    (-2.0, 0.49, 0.49, True), (-2.0, 0.51, 0.51, False), (0.4, 2.49, 2.49, True), (0.4, 2.51, 2.51, False),
    (0.0, 3600.0, 0.0, False), (0.0, 0.0, 2.49, True), (0.0, 0.0, 2.5, False), (-2.0, 0.0, 0.51, False)],
    ids=['late, in its rest', 'late', 'stamped ahead, in its lease', 'stamped ahead', 'clock set forward',
         'clock stands, in its lease', 'clock stands', 'late, and the clock stands'])
def test_lease_ends_by_the_earlier_of_both_clocks(stamped_s, clock_s, steady_s, is_on):
    heater = Heater()
    heater.command(2500.0, stamp_s=START_S + stamped_s)
    heater.clock_s += clock_s
    heater.steady_s += steady_s
    assert heater.answer()[1:3] == ((2500.0, Refusal.NOT_REFUSED) if is_on else (0.0, Refusal.NO_COMMAND))


@pytest.mark.parametrize('power_w', [math.nan, math.inf, -math.inf, -1.0, 7000.1])
def test_impossible_power_is_off_and_ends_the_lease_before(power_w):
    heater = Heater()
    heater.command(2500.0)
    heater.command(power_w)
    assert heater.answer() == (0.0, 0.0, Refusal.INVALID_COMMAND, (
        f'battery_heating_power: {power_w:g} W is not allowed; it must be 0 ... 7000 W'))


@pytest.mark.parametrize('stamp_s, lease_s, words', [
    (START_S - 3.0, 2.5, 'valid_until: is 0.500 s in the past'),
    (START_S + 0.6, 2.5, 'header.stamp: is 0.600 s ahead of the clock; at most 0.5 s are allowed'),
    (START_S + 86400.0, 2.5, 'header.stamp: is 86400.000 s ahead'),
    (START_S, 20.6, 'valid_until: a lease of 20.600 s is too long; at most 20 s are allowed'),
    (START_S, 1e9, 'valid_until: a lease of 1000000000.000 s is too long'),
    (START_S - 100.0, 103.0, 'valid_until: a lease of 103.000 s is too long'),
    (0.0, START_S + 2.0, 'header.stamp: is not set'),
    (START_S, 0.0, 'valid_until: is 0.000 s in the past'),
    (START_S, -1.0, 'valid_until: is 1.000 s in the past'),
])
def test_impossible_lease_is_off(stamp_s, lease_s, words):
    heater = Heater()
    heater.command(2500.0, lease_s, stamp_s)
    _, active_w, refusal, sentence = heater.answer()
    assert (active_w, refusal) == (0.0, Refusal.INVALID_LEASE)
    assert sentence.startswith(words)


def test_heater_does_not_flicker_between_valid_and_invalid_commands():
    heater = Heater()
    for _ in range(20):
        heater.command(2500.0)
        heater.command(math.nan)
        heater.wait(0.1)
        heater.command(2500.0)
        assert heater.power_w() == 0.0
    heater.wait(DOUBT_S)
    heater.command(2500.0)
    assert heater.power_w() == 2500.0


def test_older_command_does_not_replace_a_newer_one():
    heater = Heater()
    heater.command(0.0)
    heater.command(5000.0, stamp_s=START_S - 1.0)
    assert heater.answer() == (0.0, 0.0, Refusal.INVALID_LEASE, (
        'header.stamp: is 1.000 s before that of the command in force'))


@pytest.mark.parametrize('back_s', [0.01, 1.0, 3600.0])
def test_clock_set_back_ends_the_lease(back_s):
    heater = Heater()
    heater.command(2500.0)
    heater.wait(1.0)
    assert heater.power_w() == 2500.0
    heater.clock_s -= back_s
    assert heater.answer() == (0.0, 0.0, Refusal.INVALID_LEASE, f'the clock was set back by {back_s:.3f} s')
    heater.command(1000.0)
    assert heater.power_w() == 1000.0


def test_second_commander_switches_off_until_only_one_is_left():
    heater = Heater()
    for _ in range(5):
        heater.command(2500.0, sender='planner')
        heater.wait(0.5)
        heater.command(2500.0, sender='stranger')
        assert heater.answer() == (0.0, 0.0, Refusal.COMMAND_CONFLICT, '2 nodes command the heater')
        heater.wait(0.5)
    heater.wait(1.4)
    heater.command(2500.0, sender='planner')
    assert heater.power_w() == 0.0
    heater.wait(1.0)
    heater.command(2500.0, sender='planner')
    assert heater.power_w() == 2500.0


def test_conflict_that_ends_in_silence_is_over():
    heater = Heater()
    heater.command(2500.0, sender='planner')
    heater.command(2500.0, sender='stranger')
    assert heater.answer().refusal is Refusal.COMMAND_CONFLICT
    heater.wait(2.5)
    assert heater.answer() == (0.0, 0.0, Refusal.NO_COMMAND,
                               'no valid command has arrived since two nodes commanded')


def test_no_command_that_arrived_beside_another_node_is_in_force_later():
    heater = Heater()
    heater.command(2500.0, sender='stranger', lease_s=0.5)
    heater.wait(DOUBT_S - 0.1)
    heater.command(2500.0, lease_s=10.0)
    # The stranger is forgotten before the next step.
    heater.wait(0.2)
    assert heater.answer() == (0.0, 0.0, Refusal.NO_COMMAND,
                               'no valid command has arrived since two nodes commanded')
    heater.command(2500.0)
    assert heater.power_w() == 2500.0


def test_second_commander_counts_although_its_commands_are_invalid():
    heater = Heater()
    heater.command(2500.0)
    heater.command(math.nan, lease_s=-1.0, sender='stranger')
    assert heater.answer().refusal is Refusal.COMMAND_CONFLICT


def test_missed_deadline_ends_the_lease():
    heater = Heater()
    heater.command(2500.0)
    heater.controller.lose_sender('deadline missed')
    assert heater.answer() == (0.0, 0.0, Refusal.NO_COMMAND, 'deadline missed')


def test_power_rises_at_the_limited_rate_and_falls_at_once():
    heater = Heater(HeaterLimits(7000.0, rise_w_per_s=1000.0))
    heater.answer()
    powers_w = []
    for _ in range(4):
        heater.wait(0.5)
        heater.command(1800.0)
        powers_w.append(heater.power_w())
    assert powers_w == [500.0, 1000.0, 1500.0, 1800.0]
    heater.command(200.0)
    assert heater.power_w() == 200.0
    heater.wait(0.1)
    heater.command(7000.0)
    assert heater.answer() == (7000.0, pytest.approx(300.0), Refusal.RATE_LIMITED,
                               'the power rises by at most 1000 W/s')
    heater.wait(3.0)
    assert heater.power_w() == 0.0
    heater.command(7000.0)
    assert heater.power_w() == 0.0


def test_cabin_comes_first():
    heater = Heater()
    heater.command(5000.0)
    assert heater.answer(available_w=1200.0) == (
        5000.0, 1200.0, Refusal.CABIN_FIRST, 'the cabin leaves 1200 W of the heater')
    for nothing_w in (0.0, -300.0, math.nan):
        assert heater.answer(available_w=nothing_w).active_w == 0.0


def test_steps_of_power():
    heater = Heater(HeaterLimits(7000.0, steps_w=(2000.0, 7000.0)))
    for requested_w, active_w in ((7000.0, 7000.0), (6999.0, 2000.0), (2000.0, 2000.0), (1999.0, 0.0)):
        heater.command(requested_w)
        answer = heater.answer()
        assert answer[:2] == (requested_w, active_w)
        assert (answer.refusal is Refusal.STEP_OF_POWER) is (requested_w != active_w)


def test_obstacle_of_the_car_outranks_the_command():
    heater = Heater()
    heater.command(5000.0)
    obstacle = Verdict(Refusal.LOW_CHARGE, 'the battery is at 9 %')
    assert heater.answer(obstacle=obstacle) == (5000.0, 0.0, Refusal.LOW_CHARGE, 'the battery is at 9 %')
    assert heater.power_w() == 5000.0


# Powers and times far outside of the allowed ones, and on their edges.
POWERS_W = st.one_of(st.floats(-1e4, 1e4), st.sampled_from([0.0, 7000.0, math.nan, math.inf, -math.inf, 1e300]))
TIMES_S = st.one_of(st.floats(-30.0, 30.0), st.sampled_from([0.0, 2.5, -2.5, 1e9, -1e9]))
EVENTS = st.one_of(
    st.tuples(st.just('command'), POWERS_W, TIMES_S, TIMES_S, st.sampled_from(['a', 'a', 'a', 'b'])),
    st.tuples(st.just('command'), st.floats(0.0, 7000.0), st.floats(-2.0, 0.5), st.floats(0.0, 20.0),
              st.just('a')),
    st.tuples(st.just('wait'), st.floats(0.0, 5.0)),
    st.tuples(st.just('set clock'), TIMES_S),
    st.tuples(st.just('lost')))


@given(st.lists(EVENTS, max_size=30), st.floats(10.0, 5000.0), st.sampled_from([(), (7000.0,), (1500.0, 4000.0)]))
def test_output_is_never_above_lease_range_rate_and_steps(events, rise_w_per_s, steps_w):
    limits = HeaterLimits(7000.0, rise_w_per_s, steps_w, longest_lease_s=20.0, clock_tolerance_s=0.5)
    heater = Heater(limits)
    # By the test's own account: each command with the instant of its arrival by the steady clock.
    heard, before_w, stepped_s = [], 0.0, heater.steady_s
    continuous_w = heater.power_w()
    for event in events:
        if event[0] == 'command':
            _, power_w, offset_s, lease_s, sender = event
            heater.command(power_w, lease_s, max(heater.clock_s + offset_s, 0.0), sender)
            heard.append((power_w, heater.clock_s + offset_s, lease_s, heater.steady_s, sender))
        elif event[0] == 'wait':
            heater.wait(event[1])
        elif event[0] == 'set clock':
            heater.clock_s = max(1.0, heater.clock_s + event[1])
        else:
            heater.controller.lose_sender('lost')
        answer = heater.answer()
        active_w = answer.active_w
        assert 0.0 <= active_w <= min(answer.requested_w, 7000.0)
        assert not steps_w or active_w in (0.0, *steps_w)
        if not steps_w:
            assert active_w <= before_w + rise_w_per_s * (heater.steady_s - stepped_s) + 1e-6
        before_w, stepped_s = active_w, heater.steady_s
        if active_w > 0.0:
            power_w, stamp_s, lease_s, arrived_s, sender = heard[-1]
            # The latest command alone is in force, inside its lease by both clocks, without a second commander.
            assert power_w == answer.requested_w
            assert heater.clock_s < stamp_s + lease_s + 1e-6
            assert heater.steady_s < arrived_s + min(lease_s, 20.0) + 1e-6
            assert all(other == sender for *_, at_s, other in heard if heater.steady_s - at_s < DOUBT_S - 1e-6)
        else:
            assert answer.refusal is not Refusal.NOT_REFUSED or answer.requested_w == 0.0
    assert continuous_w == 0.0


@given(st.lists(EVENTS, max_size=20))
def test_silence_ends_in_0_w_whatever_came_before(events):
    heater = Heater()
    for event in events:
        if event[0] == 'command':
            heater.command(event[1], event[3], max(heater.clock_s + event[2], 0.0), event[4])
        elif event[0] == 'set clock':
            heater.clock_s = max(1.0, heater.clock_s + event[1])
    heater.steady_s += LIMITS.longest_lease_s
    assert heater.power_w() == 0.0
