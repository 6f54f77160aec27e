# SPDX-License-Identifier: Apache-2.0
"""Sign and scale of the current, from voltage and state of charge."""

import random

import pytest

from bev_preheat.estimation.current_check import CurrentSample, CurrentScale, CurrentSign, Sign
from bev_preheat.estimation.readings import Resolution, SOC_STEPS

CAPACITY_AS = 60.0 * 3600.0


def signs(samples):
    """Return the CurrentSign after each of samples (V, A, 0 ... 1), one a second."""
    watch, steps, found = CurrentSign(), Resolution(SOC_STEPS), []
    for second, sample in enumerate(samples):
        steps = steps.seen(sample[-1])
        watch = watch.seen(CurrentSample(1000.0 + second, *sample), steps.step, CAPACITY_AS)
        found.append(watch)
    return found


def drive(sign, deviation_a=25.0, soc_step=0.0, seed=1):
    """
    Return (instant of the first proof [s], Sign at the end) of a drive.

    The cell is U = 360 + 40 s, R = 0.11 ohm; the current varies about 45 A.
    """
    drawn, samples, soc, wander = random.Random(seed), [], 0.7, 0.0
    for _ in range(600):
        wander += -0.3 * wander + 0.7 * deviation_a * drawn.gauss(0.0, 1.0)
        current_a = 45.0 + wander
        soc -= current_a / CAPACITY_AS
        voltage_v = 360.0 + 40.0 * soc - 0.11 * current_a + drawn.gauss(0.0, 0.2)
        samples.append((voltage_v, sign * current_a, round(soc / soc_step) * soc_step if soc_step else soc))
    found = [watch.sign for watch in signs(samples)]
    return next((second for second, sign in enumerate(found) if sign is not Sign.UNKNOWN), None), found[-1]


@pytest.mark.parametrize('sign, expected', [(1.0, Sign.RIGHT), (-1.0, Sign.REVERSED)])
@pytest.mark.parametrize('seed', range(5))
def test_voltage_proves_the_sign_within_half_a_minute(sign, expected, seed):
    proven_s, found = drive(sign, soc_step=0.01, seed=seed)
    assert found is expected
    assert proven_s <= 30


@pytest.mark.parametrize('sign, expected', [(1.0, Sign.RIGHT), (-1.0, Sign.REVERSED)])
def test_the_charge_proves_it_where_the_current_is_steady(sign, expected):
    # 0.25 % at 45 A of 60 Ah takes 12 s.
    proven_s, found = drive(sign, deviation_a=0.0)
    assert (found, proven_s) == (expected, pytest.approx(13, abs=2))


@pytest.mark.parametrize('soc_step', [0.0, 0.005, 0.01])
def test_the_offset_of_a_parked_car_s_current_is_no_reversed_sign(soc_step):
    # It takes 0.3 A; the sensor, of hundreds of amperes, reads 0.6 A less.
    samples, soc = [], 0.7
    for _ in range(5 * 3600):
        soc -= 0.3 / CAPACITY_AS
        samples.append((380.0, -0.3, round(soc / soc_step) * soc_step if soc_step else soc))
    assert {watch.sign for watch in signs(samples)} == {Sign.UNKNOWN}


@pytest.mark.parametrize('jump', [-0.1, 0.02, 0.1])
@pytest.mark.parametrize('soc_step', [0.0, 0.005])
def test_a_charge_that_jumps_once_says_nothing_of_the_current(jump, soc_step):
    soc, samples = 0.7, []
    for second in range(600):
        soc -= 45.0 / CAPACITY_AS - (jump if second == 300 else 0.0)
        samples.append((380.0, 45.0, round(soc / soc_step) * soc_step if soc_step else soc))
    found = [watch.sign for watch in signs(samples)]
    assert Sign.REVERSED not in found
    assert found[-1] is Sign.RIGHT


def test_noise_proves_no_reversed_sign():
    drawn = random.Random(6)
    of_power = [(380.0 + drawn.gauss(0.0, 0.5), 5.0 + drawn.gauss(0.0, 3.0), 0.6) for _ in range(20000)]
    of_charge = [(380.0, 45.0, 0.6 - second * 45.0 / CAPACITY_AS + drawn.gauss(0.0, 0.003))
                 for second in range(2000)]
    for samples in of_power, of_charge:
        assert all(watch.sign is not Sign.REVERSED for watch in signs(samples))


SCALE_AS = 100.0 * 3600.0


def named_after(scale=1.0, seconds=3000, step=0.0, current_a=50.0, from_soc=0.8, soc_share=1.0, jump=0.0):
    """Return when a doubt is first raised [s], None: never, and the doubt at the end of a steady drive."""
    watch, steps, soc, named_s = CurrentScale(), Resolution(SOC_STEPS), from_soc, None
    for second in range(seconds):
        soc -= soc_share * current_a / SCALE_AS + (jump if second == 1000 else 0.0)
        said = round(soc / step) * step if step else soc
        steps = steps.seen(said)
        watch = watch.seen(CurrentSample(1000.0 + second, 400.0, scale * current_a, said), steps.step, SCALE_AS)
        if watch.doubt and named_s is None:
            named_s = second
    return named_s, watch.doubt


@pytest.mark.parametrize('step', [0.0, 0.005, 0.01])
@pytest.mark.parametrize('scale', [10.0, -10.0, 1000.0])
def test_a_current_that_is_too_large_is_named_within_minutes(scale, step):
    named_s, doubt = named_after(scale, step=step)
    assert named_s <= 300
    assert doubt.startswith('current: it moved ')


@pytest.mark.parametrize('step, within_s', [(0.0, 150), (0.01, 300)])
def test_a_current_that_is_too_small_is_named_after_the_change_of_the_charge(step, within_s):
    # 50 A move 1 % of 100 Ah in 72 s.
    assert named_after(0.1, step=step)[0] <= within_s


@pytest.mark.parametrize('case', [
    {}, {'step': 0.01}, {'scale': 0.5}, {'scale': 2.0, 'step': 0.01},
    {'jump': 0.1}, {'jump': -0.1, 'step': 0.005}, {'current_a': -50.0, 'from_soc': 0.2},
    {'current_a': 0.3, 'scale': 0.0, 'seconds': 40000},
    # The display stays at 100 %.
    {'from_soc': 1.0, 'soc_share': 0.0, 'seconds': 5000}], ids=str)
def test_what_cars_do_is_no_doubt(case):
    assert named_after(**case) == (None, '')


def test_agreement_ends_the_doubt():
    watch, soc = CurrentScale(), 0.9
    for second in range(2000):
        soc -= 50.0 / SCALE_AS
        watch = watch.seen(
            CurrentSample(second + 1.0, 400.0, 500.0 if second < 1000 else 50.0, soc), 0.0, SCALE_AS)
        if second == 999:
            assert watch.doubt
    assert watch.doubt == ''
