# SPDX-License-Identifier: Apache-2.0
"""The power of mean speeds against that of the same drive sampled each second."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.route.legs import drive_along, lay_track, RoadLeg
from bev_preheat.route.road_load import (
    compare_averages,
    CORRELATION_TIME_S,
    elevation_of_slope,
    Motion,
    propulsion_columns,
    speed_changes,
)
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import RoadLoad

VEHICLE = load_vehicle('small_car')
CAR = replace(VEHICLE, road_load=RoadLoad(1500.0, 2.0, 0.3, 0.01), drivetrain=replace(
    VEHICLE.drivetrain, efficiency=0.8, maximum_regeneration_power_w=40e3))


def test_the_share_within_segments_is_that_of_an_ornstein_uhlenbeck_process():
    def within(duration_s):
        """Return 1 minus the variance of a segment's mean: the mean correlation of its pairs of instants."""
        at_s = np.linspace(0.0, duration_s, 2000)
        return 1.0 - np.exp(-np.abs(at_s[:, None] - at_s) / CORRELATION_TIME_S).mean()

    def found(duration_s):
        # At high speed the deviation has its highest value; a drive without changes of its own has the usual ones.
        changes = speed_changes(np.full(400, duration_s), np.full(400, 30.0), np.full(401, 30.0))
        return changes.kinetic_power_variance[0]

    for duration_s in (5.0, 30.0, 100.0):
        assert found(duration_s) / found(1e4) == pytest.approx(within(duration_s) / within(1e4), rel=0.01)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(0.5, 600.0), st.floats(0.0, 60.0), st.floats(-0.1, 0.1)),
                min_size=1, max_size=30),
       st.floats(-40.0, 40.0))
def test_mean_magnitude_and_rms_are_ordered_and_kinetic_energy_is_conserved(segments, ambient_c):
    duration_s, speed_mps, slope = map(np.array, zip(*segments))
    motion = Motion(duration_s, speed_mps, elevation_of_slope(duration_s, speed_mps, slope))
    columns = propulsion_columns(CAR, motion, np.full(len(segments), ambient_c))
    mean_w, rms_w, magnitude_w = (columns[f'propulsion_power{end}_w'] for end in ('', '_rms', '_magnitude'))
    rounding = 1.0 + 1e-9
    assert (np.abs(mean_w) <= magnitude_w * rounding).all() and (magnitude_w <= rms_w * rounding).all()
    changes = speed_changes(duration_s, speed_mps)
    assert (changes.boundary_speed_mps <= speed_mps.max() + 1e-9).all()
    assert (mean_w[speed_mps == 0.0] == 0.0).all()


def test_mean_speeds_of_a_road_with_stops_have_nearly_its_energy():
    """A drive along legs with 1 m/s^2, sampled each second, against its mean speeds over 30 s."""
    legs = [RoadLeg(4000.0, 14.0, stops=9, stop_duration_s=20.0), RoadLeg(8000.0, 22.0, traffic_slowdown=0.4),
            RoadLeg(6000.0, 14.0, stops=8, stop_duration_s=25.0), RoadLeg(25000.0, 33.0, traffic_slowdown=0.3)]
    drive = drive_along(lay_track(legs, 3), 1.0, 1.0)
    distance_m, speed_mps = drive.at(np.arange(0.0, drive.time_s[-1], 1.0))
    motion = Motion(np.ones(len(speed_mps) - 1), np.diff(distance_m), np.zeros(len(speed_mps)), speed_mps)
    exact, estimated, plain = compare_averages(motion, VEHICLE, np.zeros(len(speed_mps) - 1), 30.0)
    assert estimated.energy_wh == pytest.approx(exact.energy_wh, rel=0.03)
    assert plain.energy_wh < 0.96 * exact.energy_wh
    assert estimated.magnitude_w == pytest.approx(exact.magnitude_w, rel=0.1)
