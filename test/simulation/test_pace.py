# SPDX-License-Identifier: Apache-2.0
"""Simulated time over real time."""

import pytest

from bev_preheat.simulator.simulated_time import Pace


def test_time_starts_with_the_first_call():
    assert Pace(40.0).follow(1234.5) == 0.0


def test_time_follows_at_the_speed_asked_for():
    pace = Pace(40.0)
    for tick in range(101):
        elapsed_s = pace.follow(700.0 + 0.01 * tick)
    assert elapsed_s == pytest.approx(40.0)
    assert pace.lost_s == 0.0


def test_speed_may_change_on_the_way():
    pace = Pace(40.0)
    pace.follow(700.0)
    pace.follow(700.02)
    pace.speed_up = 10.0
    assert pace.follow(700.07) == pytest.approx(0.8 + 0.5)


def test_late_call_slows_time_down_and_is_counted():
    pace = Pace(40.0)
    pace.follow(700.0)
    assert pace.follow(703.0) == pytest.approx(1.0)
    assert pace.lost_s == pytest.approx(119.0)
    assert pace.follow(703.01) == pytest.approx(1.4)


@pytest.mark.parametrize('speed_up, tick_s', [(1.0, 0.01), (60.0, 0.5 / 60.0), (1000.0, 0.0005)])
def test_ticks_resolve_half_a_simulated_second(speed_up, tick_s):
    assert Pace(speed_up).real_tick_s == pytest.approx(tick_s)
