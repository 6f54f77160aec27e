# SPDX-License-Identifier: Apache-2.0
"""Checks of signals: one battery, its voltage and charge, the scale of the percentage, the steps of sensors."""


from hypothesis import given
from hypothesis import strategies as st
import pytest

from bev_preheat.estimation.readings import Resolution, TEMPERATURE_STEPS_K
from bev_preheat.estimation.signal_checks import electrical_check, PercentScale, SeenState, SourceWatch
from bev_preheat.vehicle import load_vehicle

TRACTION, AUXILIARY = (5.0, 0.8, 400.0), (20.0, 0.5, 24.0)


def feed(states):
    """Return (number of states until the doubt, the doubt at the end) of (deg C, 0 ... 1, V, name)."""
    watch, named = SourceWatch(), None
    for number, state in enumerate(states):
        watch = watch.seen(SeenState(100.0 + number, *state))
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


def test_names_tell_them_apart():
    named, doubt = feed([(5.0, 0.8, None, 'front'), (5.0, 0.8, None, 'rear')] * 5)
    assert named == 4
    assert "'front' and 'rear'" in doubt or "'rear' and 'front'" in doubt


def test_a_name_that_is_given_now_and_then_is_no_second_battery():
    assert feed([(5.0, 0.8, 400.0, 'WBY' if number % 10 == 0 else '') for number in range(100)]) == (None, '')
    # One without a name shows in the values.
    assert feed([(5.0, 0.8, 400.0, 'front'), (20.0, 0.5, 24.0, '')] * 5)[0] == 4


def test_a_single_outlier_is_no_second_battery():
    states = [TRACTION] * 50
    states[20], states[40] = AUXILIARY, AUXILIARY
    # There and back: two jumps each, 20 states apart.
    assert feed(states[:39])[0] is None


# U = 365 + 75 s + 15 s^3 [V], R = 4.3125 / (T + 45) [ohm].
CHECK = electrical_check(load_vehicle('reference'))


def voltage_v(soc, temperature_c, current_a):
    """Return the terminal voltage [V] by hand."""
    return 365.0 + 75.0 * soc + 15.0 * soc**3 - 4.3125 / (temperature_c + 45.0) * current_a


@pytest.mark.parametrize('volts', [12.6, 16.0, 24.0, 65.535, 300.0, 640.0])
def test_a_voltage_of_another_battery_is_named(volts):
    doubt = CHECK.voltage_doubt(volts, 45.0, 5.0, 0.8)
    assert doubt.startswith(
        f'voltage: {volts:g} V is not that of this battery: 429 V are expected at 80.0 % and 45 A')


@pytest.mark.parametrize('current_a', [-300.0, 0.0, 45.0, 600.0])
@pytest.mark.parametrize('temperature_c', [-30.0, 5.0, 45.0])
@pytest.mark.parametrize('soc', [0.05, 0.5, 1.0])
@pytest.mark.parametrize('share', [0.85, 1.0, 1.15])
def test_a_pack_that_is_near_its_file_is_believed(soc, temperature_c, current_a, share):
    volts = share * voltage_v(soc, temperature_c, 0.0) - (4.3125 / (temperature_c + 45.0)) * current_a
    assert CHECK.voltage_doubt(volts, current_a, temperature_c, soc) == ''


def test_a_charge_of_0_contradicts_the_voltage_of_a_fuller_battery():
    assert CHECK.charge_doubt(394.5, 47.0, 5.0, 0.0) == (
        'percentage: 0.0 % contradicts 394.5 V: an empty battery has 360.9 V; the field may not be set')
    for soc, contradicts in ((0.0, False), (0.05, False), (0.2, True), (0.6, True), (1.0, True)):
        assert bool(CHECK.charge_doubt(voltage_v(soc, 5.0, 47.0), 47.0, 5.0, 0.0)) is contradicts
    # An unset field reads 0.
    assert CHECK.charge_doubt(394.5, 47.0, 5.0, 0.02) == ''


def test_the_voltage_vouches_for_a_charge_or_for_its_hundredth():
    full, empty = voltage_v(0.8, 5.0, 47.0), voltage_v(0.008, 5.0, 47.0)
    assert CHECK.is_nearer(full, 47.0, 5.0, 0.8, 0.008)
    assert not CHECK.is_nearer(empty, 47.0, 5.0, 0.8, 0.008)


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


def test_a_stray_value_among_valid_ones_changes_nothing():
    scale, sentence = PercentScale().seen(100.0, 0.79, never)
    assert sentence == ''
    assert doubts(scale.refused(101.0, 1.2), (102.0, 0.79, never)) == ['']


@pytest.mark.parametrize('refused', [-0.3, 1.0, 655.35, float('nan')])
def test_values_of_no_scale_of_100_say_nothing(refused):
    assert doubts(scale_after(refused), (110.0, 0.8, never)) == ['']


def found(values):
    resolution = Resolution(TEMPERATURE_STEPS_K)
    for value in values:
        resolution = resolution.seen(value)
    return resolution.step


@pytest.mark.parametrize('values, step', [
    ([], 1.0), ([-7.0, -6.0, -3.0], 1.0), ([-7.0, -6.5], 0.5), ([-7.0, -6.75], 0.25),
    ([-7.0, -6.8], 0.2), ([-7.0, -6.9], 0.1), ([-7.0, -6.998], 0.0), ([-7.5, -6.8], 0.1)])
def test_steps_of_a_temperature(values, step):
    assert found(values) == step


@given(st.lists(st.integers(-40, 60), min_size=1, max_size=80), st.sampled_from([1.0, 0.5, 0.25]))
def test_a_rounded_signal_is_never_taken_for_a_finer_one(counts, step):
    assert found([count * step for count in counts]) >= step
