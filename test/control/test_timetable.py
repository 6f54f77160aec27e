# SPDX-License-Identifier: Apache-2.0
"""The timetable of a trip with a reported position."""

from math import inf, nan

from hypothesis import given
from hypothesis import strategies as st
import pytest
from steady_drives import NOW_NS, ns

from bev_preheat.control.inputs import Leg, Mission, Progress, with_stops
from bev_preheat.control.settings import Settings
from bev_preheat.control.timetable import Timetable
from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.segments import make_route
from bev_preheat.tunables import KNOWN_TO_M

SETTINGS = Settings(route_progress_timeout_s=8.0, clock_tolerance_s=0.5)


def a_leg(durations_s, speeds_mps, **fields):
    return Leg(make_route({
        'duration_s': durations_s, 'speed_mps': speeds_mps, 'propulsion_power_w': [10e3],
        'ambient_temperature_c': [0.0], 'cabin_heating_power_w': [0.0],
        'auxiliary_power_w': [0.0]}, None), **fields)


# 2000 m, 90 s of standing, 3000 m.
LEG = a_leg([100.0, 90.0, 120.0], [20.0, 0.0, 25.0], start_ns=NOW_NS)
MISSION = Mission('home', (LEG,))


class Driven:
    """A Timetable with positions of the vehicle at seconds after the start."""

    def __init__(self, mission=MISSION):
        self.timetable, self._route_id = Timetable.of(mission), mission.route_id

    def tell(self, at_s, distance_m, now_s=None, **fields):
        now_s = at_s if now_s is None else now_s
        self.timetable = self.timetable.at_progress(
            Progress(**{'distance_m': distance_m, 'stamp_ns': NOW_NS + ns(at_s),
                        'route_id': self._route_id, **fields}), NOW_NS + ns(now_s), SETTINGS)
        return self.delay_s

    def refused(self, *where, **how):
        before = vars(self.timetable)
        with pytest.raises(InvalidInput) as refusal:
            self.tell(*where, **how)
        assert vars(self.timetable) == before
        return str(refusal.value)

    @property
    def delay_s(self):
        return self.timetable.delay_ns / NS_PER_S

    def planned_s(self, at_s):
        return (self.timetable.planned_ns(NOW_NS + ns(at_s)) - NOW_NS) / NS_PER_S


@pytest.mark.parametrize('at_s, distance_m, delay_s', [
    # 10 m are 0.5 s at 20 m/s and 0.4 s at 25 m/s.
    (80.0, 1000.0, 80.0 - 50.5), (30.0, 1000.0, 30.0 - 49.5),
    (300.0, 3500.0, 300.0 - 250.4), (200.0, 3500.0, 200.0 - 249.6),
    # At a planned stop the vehicle is late after its departure time, early before its arrival time.
    (250.0, 2000.0, 250.0 - 190.4), (60.0, 2000.0, 60.0 - 99.5),
    # It has not left; it left early; it should have been there long ago.
    (40.0, 0.0, 40.0 - 0.5), (-60.0, 500.0, -60.0 - 24.5), (4000.0, 3500.0, 4000.0 - 250.4),
    # The car arrives early; at the end no delay is left.
    (200.0, 5000.0, 200.0 - 309.6), (4000.0, 5000.0, 0.0), (4000.0, 4991.0, 0.0)])
def test_the_delay_is_that_with_which_the_vehicle_is_where_it_is(at_s, distance_m, delay_s):
    driven = Driven()
    assert driven.tell(at_s, distance_m) == pytest.approx(delay_s)
    assert driven.timetable.mission.legs[0].start_ns == NOW_NS + driven.timetable.delay_ns
    assert driven.timetable.planned is MISSION


# Refusals

@pytest.mark.parametrize('where, how, message', [
    ((50.0, nan), {}, 'distance: nan m is not allowed; it must be 0 ... 5000 m, the length of'),
    ((50.0, inf), {}, 'distance: inf m is not allowed'),
    ((50.0, -0.1), {}, 'distance: -0.1 m is not allowed'),
    ((50.0, 5100.1), {}, 'distance: 5100.1 m is not allowed; it must be 0 ... 5000 m'),
    ((50.0, 1e9), {}, 'distance: 1000000000 m is not allowed; it must be 0 ... 5000 m'),
    ((50.0, 1000.0), {'route_id': 'work'},
     "route_id: 'work' is not the current route, 'home'"),
    ((50.0, 1000.0), {'route_id': ''}, "route_id: '' is not the current route"),
    ((50.0, 1000.0), {'route_start_ns': NOW_NS - ns(2.5)},
     'route_stamp: is not that of the latest route plan, but 2.500 s before it'),
    ((50.0, 1000.0), {'now_s': 58.001},
     'header.stamp: the position is 8.001 s old; at most 8 s are allowed'),
    ((50.0, 1000.0), {'now_s': 49.4}, 'header.stamp: the position is 0.6 s ahead of the clock; at most 0.5 s')])
def test_what_cannot_be_is_refused_by_name(where, how, message):
    assert message in Driven().refused(*where, **how)
    late = Driven()
    late.tell(49.0, 900.0)
    assert message in late.refused(*where, **how)


@pytest.mark.parametrize('where, how', [
    ((50.0, 5100.0), {}), ((50.0, 1000.0), {'route_start_ns': NOW_NS}),
    ((50.0, 1000.0), {'now_s': 58.0}), ((50.0, 1000.0), {'now_s': 49.5})])
def test_what_may_be_is_accepted(where, how):
    Driven().tell(*where, **how)


@pytest.mark.parametrize('at_s, distance_m, message', [
    (49.9, 1000.0, 'header.stamp: the position is 0.100 s older than the previous one'),
    (52.0, 899.0, 'distance: 899 m is 101 m behind the 1000 m that were reached before; it must be at most 100 m '
     'behind: a vehicle that turns back needs a new route plan'),
    # However long ago: it does not drive back.
    (958.1, 100.0, 'distance: 100 m is 900 m behind the 1000 m that were reached before'),
    (52.0, 1301.0, 'distance: 1301 m is 301 m beyond the 1000 m of 2.0 s before; it must be at most 300 m')])
def test_what_does_not_follow_is_refused(at_s, distance_m, message):
    driven = Driven()
    driven.tell(50.0, 1000.0)
    assert message in driven.refused(at_s, distance_m)


@pytest.mark.parametrize('at_s, distance_m', [
    (50.0, 1000.0), (52.0, 901.0), (52.0, 1299.0),
    # The previous position is too old for a pace.
    (58.1, 901.0), (58.1, 4900.0)])
def test_what_may_follow_is_accepted(at_s, distance_m):
    driven = Driven()
    driven.tell(50.0, 1000.0)
    driven.tell(at_s, distance_m)


def test_a_route_along_which_nothing_moves_has_no_places():
    still = Mission('home', (a_leg([60.0], [0.0], start_ns=NOW_NS),))
    assert 'speed is 0 in each segment' in Driven(still).refused(10.0, 0.0)


# Properties

SEGMENTS = st.lists(st.tuples(
    st.floats(5.0, 600.0), st.one_of(st.just(0.0), st.floats(0.5, 50.0))),
    min_size=1, max_size=8).filter(lambda segments: sum(
        duration_s * speed_mps for duration_s, speed_mps in segments) > 50.0)


@given(SEGMENTS, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(-900.0, 3000.0))
def test_who_is_further_arrives_no_later(segments, share, other, at_s):
    mission = Mission('home', (a_leg(*map(list, zip(*segments)), start_ns=NOW_NS),))
    near, far = Driven(mission), Driven(mission)
    length_m = near.timetable.planned.places.length_m
    near_m, far_m = sorted((share * length_m, other * length_m))
    assert far.tell(at_s, far_m) <= near.tell(at_s, near_m)


@given(SEGMENTS, st.lists(st.floats(0.2, 7.9), min_size=1, max_size=30), st.floats(-200.0, 900.0))
def test_time_left_falls_by_the_time_that_passes(segments, steps_s, late_s):
    """Driven as planned, but for a late start: the delay stays, and so does the arrival."""
    mission = Mission('home', (a_leg(*map(list, zip(*segments)), start_ns=NOW_NS),))
    driven, places = Driven(mission), mission.places
    at_s, delays_s = late_s, []
    for step_s in steps_s:
        at_s += step_s
        distance_m = places.distance_at_m(at_s - late_s)
        if distance_m > places.length_m - 2.0 * KNOWN_TO_M:
            break
        # Within 10 m: the remaining error after a start or a stop settles while driving.
        delays_s.append(driven.tell(at_s, distance_m))
        planned_m = places.distance_at_m(at_s - driven.delay_s)
        assert abs(planned_m - distance_m) <= KNOWN_TO_M + 1e-3
    if late_s >= 0.0:
        assert all(after_s >= before_s - 1e-6 for before_s, after_s in zip(delays_s, delays_s[1:]))
        assert all(delay_s <= late_s + 1e-6 for delay_s in delays_s)


# Arrival by charging, without positions

# 100 s of driving, a stop of 60 s, 60 s of driving.
TWO_LEGS = Mission('home', with_stops((a_leg([100.0], [20.0], start_ns=NOW_NS), a_leg([60.0], [20.0])), (60.0,)))


def charged(since_s, recognised_s):
    """Return a Driven that has charged since an instant, recognised later [s], and has arrived thereby."""
    driven, (since_ns, recognised_ns) = Driven(TWO_LEGS), (NOW_NS + ns(at_s) for at_s in (since_s, recognised_s))
    stood = driven.timetable.standing(since_ns, recognised_ns, recognised_ns, is_charged=True)
    driven.timetable = stood.arrived(since_ns, False)
    return driven


def test_the_stop_begins_where_the_vehicle_charges_and_passes_as_planned():
    driven = charged(70.0, 80.0)
    assert (driven.delay_s, driven.timetable.stood_ns, driven.timetable.end) == (-30.0, 0, None)
    # It stands on at its stop, half a minute ahead of the plan.
    now_ns = NOW_NS + ns(110.0)
    driven.timetable = driven.timetable.standing(NOW_NS + ns(70.0), NOW_NS + ns(80.0), now_ns, is_charged=True)
    assert (driven.planned_s(110.0), driven.delay_s) == (140.0, -30.0)


def test_a_charge_recognised_on_the_last_leg_ends_the_trip_though_it_began_before_that_leg():
    driven = charged(155.0, 175.0)
    assert driven.timetable.end.at_ns == NOW_NS + ns(155.0) and driven.timetable.end.is_observed
    # By its own stamp the trip ends after 220 s.
    assert driven.delay_s == 155.0 - 220.0
