# SPDX-License-Identifier: Apache-2.0
"""Planned places of the vehicle on a route over time, and back."""


from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.route.segments import make_route, Places


def a_route(durations_s, speeds_mps):
    return make_route({
        'duration_s': durations_s, 'speed_mps': speeds_mps, 'propulsion_power_w': [10e3],
        'ambient_temperature_c': [0.0], 'cabin_heating_power_w': [0.0],
        'auxiliary_power_w': [0.0]}, None)


SEGMENTS = st.lists(st.tuples(
    st.floats(0.5, 900.0), st.one_of(st.just(0.0), st.floats(0.01, 60.0))), min_size=1, max_size=12)


@given(SEGMENTS, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_further_is_never_earlier(segments, share, other):
    places = Places.of_route(a_route(*map(list, zip(*segments))))
    near_m, far_m = sorted((share * places.length_m, other * places.length_m))
    assert places.earliest_s(near_m) <= places.earliest_s(far_m)
    assert places.latest_s(near_m) <= places.latest_s(far_m)
    assert places.earliest_s(near_m) <= places.latest_s(near_m)


@given(SEGMENTS, st.floats(0.0, 1.0))
def test_each_time_lies_within_those_of_its_place(segments, share):
    places = Places.of_route(a_route(*map(list, zip(*segments))))
    time_s = share * places.time_s[-1]
    # Rounding of the distance is noticeable time on a slow segment.
    slack_m = 1e-9 * max(1.0, places.length_m)
    distance_m = places.distance_at_m(time_s)
    assert places.earliest_s(distance_m - slack_m) <= time_s + 1e-9
    assert places.latest_s(distance_m + slack_m) >= time_s - 1e-9
    # An independent sum of the distance driven by then.
    driven_m = sum(max(0.0, min(duration_s, time_s - began_s)) * speed_mps
                   for (duration_s, speed_mps), began_s in zip(
                       segments, np.cumsum([0.0] + [duration_s for duration_s, _ in segments])))
    assert distance_m == pytest.approx(driven_m, abs=1e-6)
