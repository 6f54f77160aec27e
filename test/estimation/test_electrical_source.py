# SPDX-License-Identifier: Apache-2.0
"""One battery, or two on one topic."""

import random

import pytest

from bev_preheat.estimation.electrical_source import SeenState, SourceWatch

TRACTION, AUXILIARY = (5.0, 0.8, 400.0), (20.0, 0.5, 24.0)


def feed(states, period_s=1.0):
    """Return (number of states until the doubt, the doubt at the end) of (deg C, 0 ... 1, V, name)."""
    watch, named = SourceWatch(), None
    for number, state in enumerate(states):
        watch = watch.seen(SeenState(100.0 + period_s * number, *state))
        if watch.doubt and named is None:
            named = number + 1
    return named, watch.doubt


@pytest.mark.parametrize('pattern', ['at', 'aat', 'attt', 'aaaat'])
def test_two_batteries_in_turn_contradict_each_other(pattern):
    states = [AUXILIARY if letter == 'a' else TRACTION for letter in pattern * 20]
    named, doubt = feed(states)
    assert named <= 20
    assert doubt.startswith('battery_state comes from two batteries: ')
    assert 'contradict the one before' in doubt and '24 V' in doubt and '400 V' in doubt


def test_two_batteries_of_one_voltage_differ_in_temperature():
    states = [(1.0, 0.6, 400.0), (24.0, 0.6, 400.0)] * 20
    named, doubt = feed(states)
    assert named == 4
    # It may be a noisy sensor, too.
    assert doubt.startswith('battery_state comes from two batteries, or its temperature jumps: ')
    assert feed([(1.0, 0.6, None), (24.0, 0.6, None)] * 20)[0] == 4


def test_names_tell_them_apart():
    named, doubt = feed([(5.0, 0.8, None, 'front'), (5.0, 0.8, None, 'rear')] * 5)
    assert named == 4
    assert "'front' and 'rear'" in doubt or "'rear' and 'front'" in doubt


def test_a_single_outlier_is_no_second_battery():
    states = [TRACTION] * 50
    states[20], states[40] = AUXILIARY, AUXILIARY
    # There and back: two jumps each, 20 states apart.
    assert feed(states[:39])[0] is None


def test_noise_charging_and_heating_are_one_battery():
    drawn = random.Random(4)
    states = [(5.0 + 0.02 * second + drawn.gauss(0.0, 0.7), 0.4 + 4e-4 * second + drawn.gauss(0.0, 0.004),
               380.0 + drawn.gauss(0.0, 15.0)) for second in range(900)]
    assert feed(states)[0] is None


def test_one_battery_again_ends_the_doubt():
    assert feed([AUXILIARY, TRACTION] * 20 + [TRACTION] * 60)[1] == ''


def test_a_night_between_two_states_is_no_contradiction():
    assert feed([TRACTION, AUXILIARY] * 6, 32400.0) == (None, '')


def test_a_name_without_end_is_shortened():
    _, doubt = feed([(5.0, 0.5, 400.0, ''), (5.0, 0.5, 400.0, 'x' * 100_000)] * 3)
    assert doubt.startswith('battery_state comes from two batteries: ')
    assert 'one without a name' in doubt
    assert len(doubt) < 300
