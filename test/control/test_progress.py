# SPDX-License-Identifier: Apache-2.0
"""The planner with a reported position on the route."""

from math import nan

import pytest
from steady_drives import NOW_NS, ns, steady_leg, VEHICLE
from stepwise import Stepwise

from bev_preheat.control.events import (
    BatteryStateArrived,
    ProgressArrived,
    ProgressUnreadable,
    RefusedRoute,
    RouteUnreadable,
)
from bev_preheat.control.inputs import Measurement, Mission, Progress, with_stops
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status

START_NS = NOW_NS
MEASURED = Settings(estimation=False, minimum_on_time_s=0.0, minimum_off_time_s=0.0)
FULL_POWER_W = 5500.0
LENGTH_M = 20.0 * 600.0


def a_leg(duration_s=600.0, **fields):
    return steady_leg(duration_s, propulsion_power_w=[18e3], ambient_temperature_c=[-5.0], **fields)


class Drive:
    """A Stepwise supervisor at seconds after the start of its route."""

    def __init__(self, mission=None, settings=MEASURED):
        self.supervisor = Stepwise(VEHICLE, settings)
        self.supervisor.run(START_NS)
        self.supervisor.accept_mission(mission or Mission('home', (a_leg(start_ns=START_NS),)))

    def tell(self, at_s, distance_m):
        """Take in a position."""
        now_ns = START_NS + ns(at_s)
        self.supervisor.run(now_ns, ProgressArrived(Progress(distance_m, now_ns, 'home')))

    def feed(self, at_s, temperature_c=-7.0):
        """Take in a battery state; return (command [W], reason) and how long the plan still lasts [s]."""
        now_ns = START_NS + ns(at_s)
        self.supervisor.accept_battery(
            Measurement(BatteryState(temperature_c, 0.8), now_ns), now_ns)
        command, plan = self.supervisor.state.latest_command, self.supervisor.state.decision.plan
        return (pytest.approx(command.battery_heating_power_w), command.reason,
                None if plan is None else pytest.approx(plan.arrival_time_s))


HEATS, OFF = FULL_POWER_W, 0.0
COLD = Status.TARGET_UNREACHABLE


# Late, early, on time

def test_a_late_vehicle_is_heated_for_as_long_as_it_drives():
    drive = Drive()
    drive.tell(599.0, LENGTH_M - 3000.0 - 10.0)
    assert drive.feed(599.5) == (HEATS, COLD, 149.5)
    drive.tell(605.0, LENGTH_M - 2880.0 - 10.0)
    # By time it arrived 7 s ago.
    assert drive.feed(607.0) == (HEATS, COLD, 142.0)
    drive.tell(748.0, LENGTH_M)
    assert drive.feed(750.0)[1] is Status.ARRIVED


@pytest.mark.parametrize('settings', [MEASURED, Settings()], ids=['measured', 'estimated'])
def test_on_time_commands_and_plans_are_the_same_to_the_last_bit(settings):
    def said(tells_position):
        drive, said = Drive(settings=settings), []
        for at_s in range(200, 612, 9):
            if tells_position:
                # The distance is off by up to 9 m.
                drive.tell(at_s, max(0.0, min(20.0 * at_s, LENGTH_M) + (at_s * 7) % 19 - 9.0))
            drive.feed(at_s, 20.5 + at_s / 150.0)
            output = drive.supervisor.output
            plan = output.decision.plan if output.decision else None
            said.append((output.command, output.decision and output.decision.status,
                         plan and (plan.battery_temperature_c.tolist(), plan.time_s.tolist(),
                                   plan.hvch_battery_power_w.tolist())))
        assert {status for _, status, _ in said} >= {Status.HEATING, Status.ARRIVED}
        return said

    assert said(True) == said(False)


@pytest.mark.parametrize('distance_m', [LENGTH_M, 7000.0])
def test_a_distance_that_nobody_has_driven_yet_is_refused(distance_m):
    # A navigation that sends the distance left, or an odometer: the trip was over at its first position.
    drive = Drive()
    with pytest.raises(InvalidInput, match=f'^distance: {distance_m:.0f} m have been driven within 2.0 s; '):
        drive.tell(2.0, distance_m)
    assert drive.feed(2.0) == (HEATS, COLD, 598.0)
    # Positions that go on from there are wrong for as long, in either direction.
    for at_s, moved_m in ((50.0, -900.0), (99.0, -1800.0)):
        with pytest.raises(InvalidInput, match=f'^distance: {distance_m + moved_m:.0f} m '):
            drive.tell(at_s, distance_m + moved_m)
    # An update counts from its own start.
    drive.tell(100.0, 2000.0)
    drive.supervisor.run(START_NS + ns(105.0))
    drive.supervisor.accept_mission(Mission('home', (a_leg(510.0, start_ns=START_NS + ns(105.0)),)))
    with pytest.raises(InvalidInput, match='within 1.0 s; at most 200 m'):
        drive.tell(106.0, 2100.0)
    assert drive.supervisor.state.mission.arrival_ns == START_NS + ns(615.0)


@pytest.mark.parametrize('route_id', ['home', 'another'])
@pytest.mark.parametrize('ahead_s, heats', [(60.0, True), (90.0, False)])
def test_an_update_that_starts_within_a_minute_does_not_stop_the_heater(route_id, ahead_s, heats):
    # A navigation that rounds up to the next minute; the vehicle drives on.
    drive = Drive()
    assert drive.feed(100.0)[0] == HEATS
    drive.supervisor.run(START_NS + ns(101.0))
    drive.supervisor.accept_mission(Mission(route_id, (a_leg(start_ns=START_NS + ns(101.0 + ahead_s)),)))
    power_w, _, left_s = drive.feed(102.0)
    assert (power_w, left_s) == ((HEATS, 599.0) if heats else (OFF, 600.0))


def test_a_vehicle_that_left_before_its_route_plan_is_where_it_is():
    drive = Drive(Mission('home', (a_leg(start_ns=START_NS + ns(300.0)),)))
    drive.tell(50.0, 1010.0)
    assert drive.feed(50.0) == (HEATS, COLD, 550.0)


def test_a_position_without_a_route_says_nothing():
    supervisor = Stepwise(VEHICLE, MEASURED)
    supervisor.run(START_NS, ProgressArrived(Progress(100.0, START_NS, 'home')))
    assert (supervisor.state.inbox.timetable, supervisor.state.inbox.refused_progress) == (None, None)


# Refused, too old

@pytest.mark.parametrize('event', [
    ProgressArrived(Progress(nan, START_NS + ns(101.0), 'home'), 'look at the clocks'),
    ProgressArrived(Progress(0.0, START_NS + ns(101.0), 'work'), 'look at the clocks'),
    ProgressUnreadable(InvalidInput(['distance: 0 counts as not given', 'look at the clocks']))])
def test_a_refused_position_is_told_and_leaves_the_heater_alone(event):
    drive = Drive()
    drive.tell(100.0, 0.0)
    drive.feed(100.0)
    now_ns = START_NS + ns(101.0)
    drive.supervisor.step_through(now_ns, event)
    refusal, = drive.supervisor.output.refusals
    assert refusal.source == 'route_progress'
    assert refusal.error.problems[-1] == 'look at the clocks'
    assert drive.supervisor.state.inbox.refused_progress == f'route_progress refused: {refusal.error}'
    # The previous place holds.
    assert drive.feed(101.0) == (HEATS, COLD, 598.5)
    drive.tell(102.0, 0.0)
    assert drive.supervisor.state.inbox.refused_progress is None


def test_a_place_that_is_too_old_is_driven_on_from_by_time():
    drive = Drive()
    drive.tell(300.0, 0.0)
    for after_s in (1.0, 10.0, 10.1, 100.0, 598.0):
        assert drive.feed(300.0 + after_s) == (HEATS, COLD, 599.5 - after_s)
    assert drive.feed(900.0)[1] is Status.ARRIVED


# Standing

def stood(drive, until_s):
    """
    Let the vehicle stand from 100 s on, and return the command at the end.

    It is early, and its place is accurate to 10 m, so it counts as driving for the first second.
    """
    for at_s in range(100, until_s, 5):
        drive.tell(float(at_s), 6010.0)
    return drive.feed(until_s - 5.0)


@pytest.mark.parametrize('until_s, expected', [
    (400, (HEATS, COLD, 299.0)), (1005, (HEATS, COLD, 299.0)), (1010, (OFF, Status.WAITING, None)),
    (3000, (OFF, Status.WAITING, None))])
def test_who_stands_is_kept_warm_for_a_quarter_of_an_hour(until_s, expected):
    assert stood(Drive(), until_s) == expected


def test_who_drives_on_is_heated_again_at_once():
    drive = Drive()
    assert stood(drive, 2000)[0] == OFF
    assert drive.supervisor.state.decision.explanation == (
        'The vehicle has stood for 31:34 min although its route has no stop here (the position has not moved for '
        '1894 s): no heating until it drives on.')
    drive.tell(2001.0, 6030.0)
    assert drive.feed(2001.0)[0] == HEATS


def test_a_late_stop_ends_later():
    drive = Drive(Mission('home', with_stops(
        (a_leg(start_ns=START_NS), a_leg(departure=BatteryState(24.0, 0.7))), (300.0,))))
    drive.tell(700.0, LENGTH_M - 1010.0)
    assert drive.feed(700.0) == (HEATS, COLD, 50.0)
    drive.tell(750.0, LENGTH_M)
    drive.feed(760.0)
    assert drive.feed(1049.0)[1] is Status.CHARGING
    later, = drive.supervisor.state.mission.legs[1:]
    assert later.start_ns == START_NS + ns(1050.0)
    assert drive.feed(1051.0) == (HEATS, COLD, 599.0)


@pytest.mark.parametrize('arrives_s, goes_on', [(699.0, False), (701.0, True)])
def test_a_refused_update_is_held_against_the_arrival_by_place(arrives_s, goes_on):
    drive = Drive()
    drive.tell(100.5, 0.0)
    drive.supervisor.step_through(START_NS + ns(101.0), RouteUnreadable(
        InvalidInput('speed: -1'), RefusedRoute('home', True, (START_NS + ns(arrives_s),))))
    drive.feed(102.0)
    assert (drive.supervisor.state.mission is not None) is goes_on


def test_events_of_one_instant_are_all_planned_for():
    drive = Drive()
    now_ns = START_NS + ns(100.0)
    drive.supervisor.run(
        now_ns, ProgressArrived(Progress(0.0, now_ns, 'home')),
        BatteryStateArrived(Measurement(BatteryState(-7.0, 0.8), now_ns)))
    assert drive.supervisor.state.decision.plan.arrival_time_s == pytest.approx(599.5)
