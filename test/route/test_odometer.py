# SPDX-License-Identifier: Apache-2.0
"""Distances by the odometer, and the place on a route without coordinates."""

import math

import pytest

from bev_preheat.route.line import Cause
from bev_preheat.route.odometer import driven_m, Odometer, OdometerPlace

NS = 1_000_000_000


def an_odometer(*readings):
    odometer = Odometer()
    for second, distance_m in readings:
        odometer.read(round(second * NS), distance_m)
    return odometer


def test_between_two_readings_it_is_interpolated():
    odometer = an_odometer((10, 500.0), (11, 512.0), (12, 530.0))
    assert driven_m(odometer.at(10 * NS), odometer.at(round(11.5 * NS))) == pytest.approx(21.0)
    # A reading is valid for 2 s before and after it.
    assert odometer.at(14 * NS).distance_m == 530.0
    assert odometer.at(15 * NS) is None and odometer.at(7 * NS) is None
    assert driven_m(odometer.at(11 * NS), None) is None


@pytest.mark.parametrize('second, distance_m', [(12, math.nan), (12, math.inf), (11, 520.0), (9, 520.0)])
def test_a_reading_that_is_not_finite_or_not_newer_is_ignored(second, distance_m):
    odometer = an_odometer((10, 500.0), (11, 512.0))
    assert not odometer.read(second * NS, distance_m)
    assert odometer.latest.distance_m == 512.0


@pytest.mark.parametrize('reading_m', [0.0, 9000.0, 440.0])
def test_over_a_reset_or_a_jump_the_distance_is_not_known(reading_m):
    odometer = an_odometer((10, 500.0), (11, 512.0), (12, reading_m), (13, reading_m + 20.0))
    assert driven_m(odometer.at(11 * NS), odometer.at(13 * NS)) is None
    assert driven_m(odometer.at(12 * NS), odometer.at(13 * NS)) == pytest.approx(20.0)


def test_the_place_is_the_distance_since_the_first_reading():
    place = OdometerPlace(8000.0, None)
    assert place.match.cause is Cause.SILENT
    assert place.take(1 * NS, 70_000.0).distance_m == 0.0
    for second in range(2, 62):
        match = place.take(second * NS, 70_000.0 + 25.0 * (second - 1))
    assert (match.cause, match.distance_m) == (Cause.RECKONED, 1500.0)
    assert match.deviation_m == pytest.approx(45.0)


@pytest.mark.parametrize('start_m, reading_m, cause', [
    (70_000.0, 69_000.0, Cause.UNCERTAIN), (70_000.0, 78_500.0, Cause.ARRIVED)])
def test_off_the_route_there_is_no_place(start_m, reading_m, cause):
    match = OdometerPlace(8000.0, start_m).take(1 * NS, reading_m)
    assert (match.cause, match.distance_m) == (cause, None)


def test_a_reset_loses_the_place():
    place = OdometerPlace(8000.0, None)
    place.take(1 * NS, 70_000.0)
    assert place.take(2 * NS, 0.0).cause is Cause.UNCERTAIN
    assert place.take(3 * NS, 20.0).distance_m is None
    assert place.take(4 * NS, math.nan).cause is Cause.OVERTAKEN
