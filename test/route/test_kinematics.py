# SPDX-License-Identifier: Apache-2.0
"""A drive keeps every limit, on any road."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.route.legs import drive_along, lay_track, leg_starts_m, RoadLeg

LEGS = st.lists(st.builds(
    RoadLeg, length_m=st.floats(5.0, 900.0), speed_limit_mps=st.floats(1.5, 60.0),
    stops=st.integers(0, 6), stop_duration_s=st.sampled_from([0.0, 3.5, 40.0]),
    traffic_slowdown=st.floats(0.0, 0.9), traffic_length_m=st.floats(20.0, 500.0)),
    min_size=1, max_size=6)
ACCELERATIONS_MPS2 = st.floats(0.1, 8.0)


@given(LEGS, ACCELERATIONS_MPS2, ACCELERATIONS_MPS2, st.floats(0.7, 1.4), st.integers(0, 9))
def test_a_drive_keeps_every_limit(legs, up_mps2, down_mps2, pace, seed):
    drive = drive_along(lay_track(legs, seed), up_mps2, down_mps2, pace)
    starts_m = leg_starts_m(legs)
    assert drive.time_s[0] == drive.distance_m[0] == 0.0
    assert drive.speed_mps[0] == drive.speed_mps[-1] == 0.0
    assert drive.distance_m[-1] == pytest.approx(sum(leg.length_m for leg in legs))
    time_s, speed_mps = np.diff(drive.time_s), drive.speed_mps
    assert np.all(time_s > 0.0)
    # Speed and time match the distance.
    np.testing.assert_allclose(0.5 * (speed_mps[1:] + speed_mps[:-1]) * time_s,
                               np.diff(drive.distance_m), atol=1e-6)
    # Squares of speeds, because near a standstill an acceleration is a quotient of rounding errors.
    change = np.diff(speed_mps**2)
    driven_m = np.diff(drive.distance_m)
    assert np.all(change <= 2.0 * up_mps2 * driven_m + 1e-6)
    assert np.all(change >= -2.0 * down_mps2 * driven_m - 1e-6)
    for leg, start_m, end_m in zip(legs, starts_m, starts_m[1:]):
        # Both ends belong to a leg.
        inside = (drive.distance_m >= start_m) & (drive.distance_m <= end_m)
        assert speed_mps[inside].max() <= pace * leg.speed_limit_mps * (1.0 + 1e-9) + 1e-6
    standing_s = time_s[(speed_mps[:-1] == 0.0) & (speed_mps[1:] == 0.0)].sum()
    assert standing_s == pytest.approx(sum(leg.stops * leg.stop_duration_s for leg in legs))


@given(LEGS, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_distance_is_the_integral_of_speed(legs, one, other):
    drive = drive_along(lay_track(legs, 1), 1.1, 1.7)
    start_s, end_s = sorted((one * drive.time_s[-1], other * drive.time_s[-1]))
    # The trapezoidal rule is exact if no instant of the drive is missing.
    between_s = drive.time_s[(drive.time_s > start_s) & (drive.time_s < end_s)]
    instants_s = np.concatenate(([start_s], between_s, [end_s]))
    distance_m, speed_mps = drive.at(instants_s)
    integral_m = 0.5 * (speed_mps[1:] + speed_mps[:-1]) @ np.diff(instants_s)
    assert distance_m[-1] - distance_m[0] == pytest.approx(integral_m, abs=1e-6)
