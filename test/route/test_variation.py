# SPDX-License-Identifier: Apache-2.0
"""Cycles within segments preserve the segment's power figures."""

import numpy as np
import pytest

from bev_preheat.route import load_route
from bev_preheat.route.variation import CYCLES, with_cycles

CITY = load_route('city_stop_and_go', None)


@pytest.mark.parametrize('name', ['city_stop_and_go', 'alpine_pass', 'motorway_3h'])
def test_each_segment_keeps_its_mean_its_square_and_its_magnitude(name):
    route = load_route(name, None)
    driven = with_cycles(route)
    at = np.searchsorted(route.time_s[1:-1], driven.time_s[:-1] + 0.5 * driven.duration_s, 'right')
    for power_w, expected_w in (
            (driven.propulsion_power_w, route.propulsion_power_w),
            (driven.propulsion_power_w**2, route.propulsion_power_rms_w**2),
            (np.abs(driven.propulsion_power_w), route.propulsion_power_magnitude_w)):
        sums = np.bincount(at, driven.duration_s * power_w, len(route))
        assert sums / route.duration_s == pytest.approx(expected_w, rel=1e-9, abs=1e-6)
    assert driven.total_duration_s == pytest.approx(route.total_duration_s, rel=1e-12)
    assert driven.distance_m == pytest.approx(route.distance_m, rel=1e-12)


def test_within_a_piece_nothing_varies():
    driven = with_cycles(CITY)
    assert (driven.propulsion_power_variance_w2 == 0.0).all()
    assert len(driven) > 2 * CYCLES * len(CITY)


def test_what_does_not_vary_stays_as_it_is():
    route = CITY.without_variation()
    driven = with_cycles(route)
    assert driven.duration_s.tolist() == route.duration_s.tolist()
    assert driven.propulsion_power_w == pytest.approx(route.propulsion_power_w)
