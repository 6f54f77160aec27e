# SPDX-License-Identifier: Apache-2.0
"""A current and a state of charge that move different charges."""

import pytest

from bev_preheat.estimation.current_sample import CurrentSample
from bev_preheat.estimation.current_scale import CurrentScale
from bev_preheat.estimation.readings import Resolution, SOC_STEPS

CAPACITY_AS = 100.0 * 3600.0


def named_after(scale=1.0, seconds=3000, step=0.0, current_a=50.0, from_soc=0.8, soc_share=1.0, jump=0.0):
    """Return when a doubt is first raised [s], None: never, and the doubt at the end of a steady drive."""
    watch, steps, soc, named_s = CurrentScale(), Resolution(SOC_STEPS), from_soc, None
    for second in range(seconds):
        soc -= soc_share * current_a / CAPACITY_AS + (jump if second == 1000 else 0.0)
        said = round(soc / step) * step if step else soc
        steps = steps.seen(said)
        watch = watch.seen(CurrentSample(1000.0 + second, 400.0, scale * current_a, said), steps.step, CAPACITY_AS)
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
        soc -= 50.0 / CAPACITY_AS
        watch = watch.seen(
            CurrentSample(second + 1.0, 400.0, 500.0 if second < 1000 else 50.0, soc), 0.0, CAPACITY_AS)
        if second == 999:
            assert watch.doubt
    assert watch.doubt == ''
