# SPDX-License-Identifier: Apache-2.0
"""Effects of events on a drive, and the trip planner's news about them."""

from level_car import route_of
import pytest

from bev_preheat.simulation.traffic import clock_offset_s, ClockJump, drive_with_events, Event, Kind

ROUTE = route_of(*[60.0] * 10, power_w=15e3, cabin_w=1200.0)
OTHER = route_of(*[60.0] * 5, power_w=25e3)


def energy_j(route):
    return float(route.propulsion_power_w @ route.duration_s)


def test_a_stop_stands_and_goes_on():
    driven, (news,) = drive_with_events(ROUTE, (Event(Kind.STOP, 90.0, duration_s=200.0),))
    assert driven.total_duration_s == pytest.approx(800.0)
    assert driven.distance_m == pytest.approx(ROUTE.distance_m)
    assert energy_j(driven) == pytest.approx(energy_j(ROUTE))
    standing = driven.segment_at(150.0)
    assert driven.speed_mps[standing] == driven.propulsion_power_w[standing] == 0.0
    # The cabin is still heated.
    assert driven.cabin_heating_power_w[standing] == 1200.0
    # Reported at once: the remaining route.
    assert news.at_s == 90.0
    assert news.route.total_duration_s == pytest.approx(710.0)


def test_a_slower_pace_takes_longer_with_less_power():
    driven, _ = drive_with_events(ROUTE, (Event(Kind.OTHER_PACE, 90.0, duration_s=200.0, factor=2.0),))
    assert driven.total_duration_s == pytest.approx(800.0)
    assert driven.distance_m == pytest.approx(ROUTE.distance_m)
    slow = driven.segment_at(300.0)
    assert driven.speed_mps[slow] == pytest.approx(10.0)
    assert driven.propulsion_power_w[slow] == pytest.approx(15e3 / 4.0)
    assert driven.speed_mps[driven.segment_at(500.0)] == 20.0


def test_a_detour_is_another_route_from_there_on():
    driven, (news,) = drive_with_events(ROUTE, (Event(Kind.DETOUR, 90.0, 30.0, route=OTHER),))
    assert driven.total_duration_s == pytest.approx(390.0)
    assert driven.propulsion_power_w[driven.segment_at(89.0)] == 15e3
    assert driven.propulsion_power_w[driven.segment_at(91.0)] == 25e3
    # Reported half a minute later: the route that then remains.
    assert (news.at_s, news.route.total_duration_s) == (120.0, pytest.approx(270.0))
    assert (news.route.propulsion_power_w == 25e3).all()


def test_a_detour_at_the_start_replaces_the_route():
    assert drive_with_events(ROUTE, (Event(Kind.DETOUR, 0.0, route=OTHER),))[0] is OTHER


def test_arriving_early_ends_the_drive():
    driven, (news,) = drive_with_events(ROUTE, (Event(Kind.ARRIVE_EARLY, 400.0, 20.0),))
    assert driven.total_duration_s == pytest.approx(400.0)
    assert news.route is None and news.charging_planned


def test_a_cancelled_charger_changes_the_goal_and_not_the_drive():
    driven, (news,) = drive_with_events(ROUTE, (Event(Kind.CANCEL_CHARGING, 100.0),))
    assert driven is ROUTE
    assert not news.charging_planned


def test_a_cancelled_charger_stays_cancelled():
    events = (Event(Kind.STOP, 300.0, duration_s=60.0), Event(Kind.CANCEL_CHARGING, 100.0))
    _, news = drive_with_events(ROUTE, events)
    assert [(item.at_s, item.charging_planned) for item in news] == [(100.0, False), (300.0, False)]


@pytest.mark.parametrize('events, duration_s, reported_s', [
    ((Event(Kind.OTHER_PACE, 540.0, duration_s=999.0, factor=2.0),), 660.0, [540.0]),
    ((Event(Kind.ARRIVE_EARLY, 200.0), Event(Kind.STOP, 400.0, duration_s=100.0)), 200.0, [200.0]),
    ((Event(Kind.STOP, 90.0, None, 200.0),), 800.0, [])],
    ids=['a pace to the very end', 'a stop after the end', 'an unreported stop'])
def test_events_end_with_the_drive_and_some_are_not_reported(events, duration_s, reported_s):
    driven, news = drive_with_events(ROUTE, events)
    assert driven.total_duration_s == pytest.approx(duration_s)
    assert [item.at_s for item in news] == reported_s


def test_clock_jumps_add_up():
    jumps = (ClockJump(10.0, 5.0), ClockJump(20.0, -7.0))
    assert [clock_offset_s(jumps, at_s) for at_s in (9.9, 10.0, 20.0)] == [0.0, 5.0, -2.0]
