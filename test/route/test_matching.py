# SPDX-License-Identifier: Apache-2.0
"""Positions matched to the route: the true place within its accuracy, and no place for a vehicle off it."""

from collections import Counter
import math

from gps_drives import gnss_errors, NS, on_earth, Road, START_NS
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from bev_preheat.route.line import Cause, Fix, MapLine
from bev_preheat.route.matching import Matcher

SPEED_MPS = 15.0
COUNTRY = Road.winding(13e3, seed=3)
CORNERS = Road.through([(0, 0), (3000, 0), (3000, 3000), (8000, 3000)])
THERE_AND_BACK = Road.through([(0, 0), (6000, 0), (6000, 12), (0, 12)])


class Drive:
    """A vehicle that drives along `path` while `route` is planned; `told` are (s, Match, true distance [m])."""

    def __init__(self, route, path=None, speed_mps=SPEED_MPS, period_s=1.0, seed=1, from_s=0.0, stands_s=0.0,
                 from_start=True, noisy=True):
        path = path or route
        self.route = route
        distance_m = np.arange(from_s * speed_mps, path.length_m, speed_mps * period_s)
        self.true_m = np.concatenate((np.full(round(stands_s / period_s), distance_m[0]), distance_m))
        self.seconds = np.arange(len(self.true_m)) * period_s
        errors = gnss_errors(len(self.true_m), period_s, seed) if noisy else np.zeros((len(self.true_m), 2))
        self.east_m, self.north_m = (plane + errors[:, axis] for axis, plane in enumerate(path.at(self.true_m)))
        self.matcher = Matcher(MapLine(route.line()), from_start)
        self.told = []

    def fix(self, number):
        (latitude_deg,), (longitude_deg,) = on_earth(
            self.east_m[number:number + 1], self.north_m[number:number + 1], self.route.origin)
        return Fix(START_NS + round(self.seconds[number] * NS), latitude_deg, longitude_deg)

    def run(self, without=(), odometer=False):
        """Drive; no fixes in the spans (from, until) [s]."""
        for number, second in enumerate(self.seconds):
            stamp_ns = START_NS + round(second * NS)
            if odometer:
                self.matcher.odometer.read(stamp_ns, 42e6 + 1.02 * self.true_m[number])
            if any(begin_s <= second < end_s for begin_s, end_s in without):
                match = self.matcher.reckon(stamp_ns) if odometer else None
                if match is None:
                    continue
            else:
                match = self.matcher.take(self.fix(number))
            self.told.append((second, match, self.true_m[number]))
        return self

    def places(self, begin_s=0.0, end_s=math.inf):
        """Return (s, error of the place [m]) of each Match with a place."""
        return np.array([(second, match.distance_m - true_m) for second, match, true_m in self.told
                         if match.distance_m is not None and begin_s <= second < end_s]).reshape(-1, 2)

    def errors(self, *span):
        return self.places(*span)[:, 1]

    def causes(self, begin_s=0.0, end_s=math.inf):
        return Counter(match.cause for second, match, _ in self.told if begin_s <= second < end_s)


# On the route


@pytest.mark.parametrize('period_s', [pytest.param(0.1, marks=pytest.mark.deep), 1.0, 10.0])
def test_the_place_is_as_accurate_as_the_fixes(period_s):
    drive = Drive(COUNTRY, period_s=period_s, seed=7, speed_mps=18.0)
    # Outliers of 40 ... 400 m, one in a hundred.
    random = np.random.default_rng(2)
    wrong = random.random(len(drive.seconds)) < 0.01
    drive.east_m[wrong] += random.choice([-1, 1], wrong.sum()) * random.uniform(40.0, 400.0, wrong.sum())
    drive.run(without=[(600.0, 690.0)])
    errors_m = drive.errors()
    # Errors along the road have a standard deviation of 4.3 m.
    assert np.sqrt(np.mean(errors_m**2)) < 6.0
    assert abs(np.mean(errors_m)) < 3.0
    assert np.abs(errors_m).max() < 30.0
    due = len(drive.seconds) - 90.0 / period_s
    assert len(errors_m) > 0.9 * due * min(1.0, period_s / 0.5)


def test_the_deviation_is_an_honest_one():
    ratios = []
    for seed in range(4):
        drive = Drive(COUNTRY, seed=seed, period_s=2.0, from_s=200.0).run()
        ratios += [(match.distance_m - true_m) / match.deviation_m for _, match, true_m in drive.told
                   if match.distance_m is not None]
    assert len(ratios) > 1000
    assert np.mean(np.abs(ratios) < 2.0) > 0.97
    assert np.max(np.abs(ratios)) < 4.0


@settings(max_examples=settings.default.max_examples // 8)
@given(angle=st.floats(0.0, 6.28), latitude_deg=st.floats(-70.0, 70.0), longitude_deg=st.floats(-180.0, 180.0))
def test_turned_and_elsewhere_on_earth_the_places_are_the_same(angle, latitude_deg, longitude_deg):
    short = Road(COUNTRY.east_m[:3000], COUNTRY.north_m[:3000])
    cosine, sine = math.cos(angle), math.sin(angle)
    other = Road(cosine * short.east_m - sine * short.north_m, sine * short.east_m + cosine * short.north_m,
                 (latitude_deg, longitude_deg))
    here = Drive(short, noisy=False).run()
    there = Drive(other, noisy=False).run()
    assert here.causes() == there.causes()
    assert [match.distance_m for _, match, _ in there.told if match.distance_m is not None] == pytest.approx(
        [match.distance_m for _, match, _ in here.told if match.distance_m is not None], abs=0.2)


# Silence


def test_no_place_is_told_without_fixes_and_the_first_one_after_a_tunnel_is_confirmed():
    drive = Drive(COUNTRY, seed=2).run(without=[(200.0, 380.0)])
    assert [cause for cause, _ in drive.causes(380.0, 385.0).most_common()] == [Cause.CONFIRMING]
    assert len(drive.errors(386.0, 500.0)) > 110
    assert np.abs(drive.errors()).max() < 30.0


def test_with_an_odometer_the_place_goes_on_through_the_tunnel():
    drive = Drive(COUNTRY, seed=2).run(without=[(200.0, 290.0)], odometer=True)
    assert drive.causes(200.0, 290.0) == {Cause.RECKONED: 90}
    # The odometer counts 2 % too much: 27 m over 1350 m.
    assert np.abs(drive.errors(200.0, 290.0)).max() < 27.0 + 20.0
    # In a longer one the place becomes too uncertain.
    assert len(Drive(COUNTRY, seed=2).run(without=[(200.0, 500.0)], odometer=True).errors(320.0, 500.0)) == 0


@pytest.mark.parametrize('odometer', [False, True])
def test_a_frozen_receiver_is_told_from_a_standing_vehicle(odometer):
    drive = Drive(CORNERS, noisy=False)
    drive.east_m[100:160], drive.north_m[100:160] = drive.east_m[100], drive.north_m[100]
    drive.run(odometer=odometer)
    assert len(drive.errors(101.0, 160.0)) == 0
    assert drive.causes(104.0, 160.0) == {Cause.FROZEN: 56}
    assert len(drive.errors(168.0)) > 500 and np.abs(drive.errors()).max() < 20.0


def test_a_receiver_that_holds_its_position_is_believed_for_a_while_and_with_an_odometer():
    for odometer, believed_s in ((False, 30.0), (True, 200.0)):
        drive = Drive(CORNERS, noisy=False, from_s=100.0, stands_s=200.0).run(odometer=odometer)
        assert drive.places(0.0, 200.0)[-1, 0] == pytest.approx(believed_s, abs=1.0)


# Off the route


def test_single_outliers_cost_one_place_each():
    drive = Drive(CORNERS, seed=5)
    for number in (100, 150, 220):
        drive.north_m[number] += 200.0
    drive.run()
    assert drive.causes()[Cause.OUTLIER] == 3
    assert len(drive.errors(20.0)) == len(drive.told) - 20 - 3
    assert np.abs(drive.errors()).max() < 30.0


def test_beside_the_route_no_place_is_told():
    drive = Drive(CORNERS, seed=5)
    drive.north_m[:190] += 200.0
    drive.run()
    assert drive.causes(0.0, 185.0) == {Cause.OFF_ROUTE: 185}
    assert len(drive.errors(0.0, 195.0)) == 0


@pytest.mark.parametrize('speed_mps', [pytest.param(4.0, marks=pytest.mark.deep), 12.0, 25.0])
def test_a_vehicle_that_leaves_the_route_and_crosses_it_later_is_off_it(speed_mps):
    path = Road.through([(0, 0), (1000, 0), (1000, -1000), (4000, -1000), (4000, 4500)])
    drive = Drive(CORNERS, path, speed_mps=speed_mps, seed=6).run()
    left_s = 1000.0 / speed_mps
    assert np.abs(drive.errors(0.0, left_s)).max() < 30.0
    # The gate is 33 m wide; beyond it there is no place.
    assert len(drive.errors(left_s + 45.0 / speed_mps + 1.0)) == 0


def test_a_vehicle_that_returns_to_the_route_is_back_after_100_m():
    path = Road.through([(0, 0), (2000, 0), (2000, 1500), (3000, 1500), (3000, 3000), (8000, 3000)])
    drive = Drive(CORNERS, path, seed=6).run()
    left_s, back_s = 2000.0 / SPEED_MPS, 4500.0 / SPEED_MPS
    assert len(drive.errors(left_s + 4.0, back_s + 4.0)) == 0
    # Detour and route are equally long.
    assert len(drive.errors(back_s + 15.0)) > 200 and np.abs(drive.errors(back_s)).max() < 30.0


def test_a_u_turn_is_against_the_direction_until_the_vehicle_turns_again():
    path = Road.through([(0, 0), (2000, 0), (500, 0), (3000, 0)])
    drive = Drive(CORNERS, path, seed=8).run()
    turned_s, again_s = 2000.0 / SPEED_MPS, 3500.0 / SPEED_MPS
    assert len(drive.errors(turned_s + 8.0, again_s)) == 0
    assert drive.causes(turned_s + 10.0, again_s)[Cause.AGAINST] > 80
    told = [match.distance_m - (true_m - 3000.0) for second, match, true_m in drive.told
            if match.distance_m is not None and second > again_s]
    assert len(told) > 100 and np.abs(told).max() < 30.0


def test_beyond_the_end_the_vehicle_has_arrived():
    drive = Drive(CORNERS, Road.through([(0, 0), (3000, 0), (3000, 3000), (8400, 3000)]), seed=9).run()
    assert drive.told[-1][1].cause is Cause.ARRIVED
    assert len(drive.errors(11080.0 / SPEED_MPS)) == 0


# Several passes


@pytest.mark.parametrize('seed', [0, *(pytest.param(seed, marks=pytest.mark.deep) for seed in (1, 2))])
@pytest.mark.parametrize('from_s', [0.0, 100.0, 600.0])
def test_both_directions_of_one_road_are_told_apart(from_s, seed):
    drive = Drive(THERE_AND_BACK, seed=seed, from_s=from_s, stands_s=30.0, from_start=from_s == 0.0).run()
    assert np.abs(drive.errors()).max() < 60.0
    # From a start on the way the vehicle has to move first.
    assert len(drive.errors(45.0)) > 0.95 * (len(drive.told) - 45)
    assert from_s == 0.0 or drive.causes(0.0, 25.0)[Cause.AMBIGUOUS] > 5


@given(st.lists(st.tuples(st.integers(-5, 100), st.floats(-90.0, 90.0), st.floats(-180.0, 180.0),
                          st.one_of(st.none(), st.floats(0.0, 1e6))), max_size=20))
def test_no_fix_on_earth_raises_or_gives_a_place_beyond_the_route(fixes):
    matcher = Matcher(MapLine(CORNERS.line(spacing_m=500.0)), True)
    for second, latitude_deg, longitude_deg, deviation_m in fixes:
        match = matcher.take(Fix(START_NS + second * NS, latitude_deg, longitude_deg, deviation_m))
        assert match.sentence
        assert match.distance_m is None or 0.0 <= match.distance_m <= CORNERS.length_m
