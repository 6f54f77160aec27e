# SPDX-License-Identifier: Apache-2.0
"""The route's line on the map: distances to it, places along it, and unusable lines."""

from dataclasses import replace
import math

from gps_drives import on_earth, Road
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.errors import InvalidInput
from bev_preheat.route.line import MapLine, offset_m, RouteLine

ROAD = Road.winding(12e3, seed=4)
LINE = MapLine(ROAD.line(speed_mps=16.0, spacing_m=20.0))


def test_the_line_is_as_long_as_the_road_and_takes_its_time():
    assert LINE.length_m == pytest.approx(ROAD.length_m)
    assert LINE.spacing_m <= 4.0
    assert LINE.planned_s(8e3) == pytest.approx(500.0)
    assert LINE.planned_m(np.array([1600.0]), 50.0) == pytest.approx([2400.0])


@pytest.mark.parametrize('origin', [(0.0, 0.0), (48.1, 11.5), (69.6, 18.9), (-54.8, -68.3), (21.3, 179.999)])
@given(east_m=st.floats(-2e3, 2e3), north_m=st.floats(-2e3, 2e3))
def test_a_position_is_as_far_away_as_in_the_plane(origin, east_m, north_m):
    (latitude_deg, other_latitude_deg), (longitude_deg, other_longitude_deg) = on_earth(
        np.array([0.0, east_m]), np.array([0.0, north_m]), origin)
    found = offset_m(latitude_deg, longitude_deg, other_latitude_deg, other_longitude_deg)
    # The plane and the ellipsoid differ by the square of the distance over the radius of the earth.
    assert found == pytest.approx((east_m, north_m), abs=1e-3 + 3e-7 * math.hypot(east_m, north_m)**2)


@given(along=st.floats(0.0, 1.0), aside_m=st.floats(-500.0, 500.0))
def test_the_nearest_point_is_that_of_a_search_over_all(along, aside_m):
    east_m, north_m = ROAD.at(along * ROAD.length_m)
    (latitude_deg,), (longitude_deg,) = on_earth(np.array([east_m + aside_m]), np.array([north_m - aside_m]))
    _, distance_m = LINE.nearest(latitude_deg, longitude_deg)
    truth_m = np.hypot(ROAD.east_m - east_m - aside_m, ROAD.north_m - north_m + aside_m).min()
    # Points are 4 m apart, and the vertices of the line 20 m in bends.
    assert truth_m - 0.5 <= distance_m <= math.hypot(truth_m, 2.1) + 0.5
    near = LINE.near(latitude_deg, longitude_deg, distance_m + 10.0)
    assert near.distance_m.min() == distance_m
    assert (np.diff(near.at) > 0).all() and near.distance_m.max() <= distance_m + 10.0
    for at, near_m in zip(near.at, near.distance_m):
        assert near_m == pytest.approx(math.hypot(*offset_m(
            latitude_deg, longitude_deg, *LINE.position(LINE.along_m[at]))))


def test_a_line_across_the_date_line_is_in_one_piece():
    road = Road.through([(-3e3, 0), (3e3, 0)], origin=(-17.0, 180.0))
    line = road.line()
    assert line.longitude_deg.max() > 179.0 and line.longitude_deg.min() < -179.0
    (latitude_deg,), (longitude_deg,) = on_earth(np.array([1e3]), np.array([5.0]), road.origin)
    at, distance_m = MapLine(line).nearest(latitude_deg, longitude_deg)
    assert distance_m == pytest.approx(5.0, abs=0.6)
    assert MapLine(line).along_m[at] == pytest.approx(4e3, abs=2.1)


GOOD = RouteLine(np.array([48.0, 48.01]), np.array([11.0, 11.0]), np.array([0.0, 1112.0]), np.array([0.0, 60.0]))


@pytest.mark.parametrize('field, values, problem', [
    ('latitude_deg', [48.0, math.nan], r'latitude_deg\[1\] of the line: nan is not allowed; it must be finite'),
    ('latitude_deg', [48.0, 91.0], r'latitude_deg\[1\] of the line: 91 is not allowed; it must be -85 ... 85'),
    ('longitude_deg', [361.0, 11.0], r'longitude_deg\[0\] of the line: 361 is not allowed'),
    ('longitude_deg', [11.0], 'longitude_deg of the line: has 1 values'),
    ('distance_m', [0.0, -5.0], 'distance_m of the line: must not fall'),
    ('distance_m', [0.0, 0.0], 'distance_m of the line: must begin at 0 and end above it'),
    ('distance_m', [10.0, 1122.0], 'distance_m of the line: must begin at 0'),
    ('elapsed_s', [60.0, 0.0], 'elapsed_s of the line: must not fall')])
def test_an_unusable_line_is_refused_by_array_and_place(field, values, problem):
    with pytest.raises(InvalidInput, match=problem):
        MapLine(replace(GOOD, **{field: np.array(values)}))
