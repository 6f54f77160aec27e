# SPDX-License-Identifier: Apache-2.0
"""Simulated time over real time."""

import pytest

from bev_preheat.nodes.simulated_time import Pace


def test_time_follows_at_the_speed_asked_for():
    pace = Pace(40.0)
    for tick in range(101):
        elapsed_s = pace.follow(700.0 + 0.01 * tick)
    assert elapsed_s == pytest.approx(40.0)
    assert pace.lost_s == 0.0
