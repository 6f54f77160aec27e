# SPDX-License-Identifier: Apache-2.0
"""A trip that has ended stays ended; only a new route begins another: drawn days, and the contract of its end."""

from drawn_days import CONSUMERS_W, DAYS, DRIVE_W, SPEED_MPS, violations_of, World
from hypothesis import example, given
import pytest

from bev_preheat.control.events import BatteryStateArrived, ProgressArrived
from bev_preheat.control.inputs import Measurement, Progress
from bev_preheat.estimation.signal_checks import CURRENT
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.planning.status import Status


@example([(None, 8, [('detour', 5), ('drive', 0.5, 1.25, True), ('again',)], (1.0, True), None, [], '')])
@example([(17, 5, [('replan',)], (0.5, True), 26, [('clock', -801), ('restart',), ('home', 45, False)], 'home')])
@given(DAYS)
def test_no_watt_after_arrival_and_no_way_back(day):
    assert violations_of(day) == []


# The contract, case by case (docs/reference/topics.md)

class Trip(World):
    """A world on a trip of 6 min that it has driven half of, with positions."""

    def __init__(self, has_position=True, minutes=6):
        super().__init__()
        self.trips = 1
        self.send_route('home', 60.0 * minutes * SPEED_MPS)
        self.drive(0.5, 1.0, has_position)

    @property
    def status(self):
        return self.planner.state.decision.status

    def heats(self, steps=36):
        """Drive on without a word of the navigation for 3 min; return for how long it heats [s]."""
        self.said_arrived = self.is_over = False
        before_s = self.heated_on_the_way_s
        for number in range(steps):
            self.step(DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
        return self.heated_on_the_way_s - before_s


def arrived_early():
    """Return a Trip whose position reached the end 2 min before its time."""
    trip = Trip()
    trip.drive(1.0, 2.0, True)
    trip.step(0.0, CONSUMERS_W)
    assert trip.status is Status.ARRIVED
    return trip


def test_a_destination_entered_while_the_car_stands_is_heated_for_and_ends():
    trip = World()
    trip.do('stand', 24, False)
    trip.send_route('home', 360.0 * SPEED_MPS)
    trip.drive(1.0, 1.0, True)
    assert trip.heated_on_the_way_s >= 340
    trip.step(0.0, CONSUMERS_W)
    trip.is_over = True
    # 3 min of charging, a minute of standing, and home: no positions.
    for piece in (('charge', 36), ('stand', 12, False), ('home', 60, False)):
        trip.do(*piece)
    assert trip.violations == [] and trip.planner.state.decision.status is Status.ARRIVED


def test_a_destination_entered_while_the_car_charges_begins_a_trip():
    trip = arrived_early()
    trip.do('charge', 60)
    # A short one, which begins less than a quarter of an hour before its end.
    trip.send_route('next', 360.0 * SPEED_MPS)
    trip.do('charge', 60)
    assert trip.status is Status.CHARGING
    assert trip.heats() >= 170


@pytest.mark.parametrize('restarts', [False, True])
@pytest.mark.parametrize('route', ['again', 'older', 'nowhere'])
def test_a_route_plan_of_the_trip_that_has_ended_begins_no_other(route, restarts):
    trip = arrived_early()
    if restarts:
        trip.do('restart')
    route_id, stamp_ns, length_m = trip.route
    trip.route = {'again': trip.route, 'older': (route_id, stamp_ns + NS_PER_S, length_m),
                  'nowhere': (route_id, trip.clock_ns, 60.0)}[route]
    trip.send_again()
    assert (trip.heats(), trip.status) == (0, Status.ARRIVED)


@pytest.mark.parametrize('route_id', ['home', 'another', ''])
@pytest.mark.parametrize('restarts', [False, True])
def test_a_new_route_plan_begins_another_trip(route_id, restarts):
    trip = arrived_early()
    if restarts:
        trip.do('restart')
    trip.send_route(route_id, 300.0 * SPEED_MPS)
    # After a restart the heater waits for a moment.
    assert trip.heats() >= (60 if restarts else 170)


@pytest.mark.parametrize('set_by_s', [-100, -400, -4000, 500])
def test_a_clock_that_is_set_begins_nothing(set_by_s):
    trip = arrived_early()
    trip.is_over = True
    trip.offset_s += set_by_s
    for number in range(30):
        trip.step(DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
    assert (trip.violations, trip.status) == ([], Status.ARRIVED)
    words = trip.planner.state.decision.explanation
    assert words.startswith('The route has ended') and '-' not in words


@pytest.mark.parametrize('restarts', [False, True])
@pytest.mark.parametrize('order', ['clock, state, route', 'clock, route, state', 'route, clock, state'])
def test_a_simulation_that_starts_again_drives_the_same_route_again(order, restarts):
    trip = arrived_early()
    if restarts:
        trip.restart()
    trip.here_m = 0.0
    for message in order.split(', '):
        if message == 'clock':
            trip.offset_s -= trip.now_s - trip.route[1] // NS_PER_S - 2
        elif message == 'state':
            trip.step(0.0, CONSUMERS_W)
        else:
            trip.send_again()
    # After a restart the heater waits for a moment.
    assert trip.heats(30) >= (60 if restarts else 120)


@pytest.mark.parametrize('set_to_s', [61, 120, 200])
def test_a_route_received_again_begins_nothing_if_the_clock_is_set_to_the_way(set_to_s):
    trip = arrived_early()
    trip.send_again()
    trip.offset_s -= trip.now_s - trip.route[1] // NS_PER_S - set_to_s
    assert (trip.heats(), trip.status) == (0, Status.ARRIVED)
    assert trip.planner.state.decision.explanation.startswith('The route has ended; only a new route plan')
    # Once more, to the start: the same route plan begins a trip there.
    trip.offset_s -= trip.clock_ns // NS_PER_S - trip.route[1] // NS_PER_S - 2
    trip.here_m = 0.0
    assert trip.heats() >= 170


def test_a_car_that_parks_beside_the_end_has_arrived():
    # The charger is 60 m beside the place to which the navigation leads.
    trip = Trip()
    trip.route, there = (*trip.route[:2], trip.route[2] - 60.0), trip.route
    trip.drive(1.0, 1.0, True)
    trip.route = there
    for _ in range(20):
        trip.step(0.0, CONSUMERS_W)
        trip.report()
    assert trip.status is Status.ARRIVED
    trip.is_over = True
    trip.do('home', 60, False)
    assert trip.violations == []


def test_a_stand_with_positions_and_then_without_stays_at_its_place():
    trip = Trip(minutes=20)
    trip.do('stand', 100, True)
    before_s = trip.planner.state.decision.plan.arrival_time_s
    trip.do('stand', 10, False)
    assert trip.planner.state.decision.plan.arrival_time_s == pytest.approx(before_s, abs=6.0)
    assert trip.violations == []


def test_a_navigation_that_plans_again_every_minute_does_not_keep_a_parked_car_warm():
    trip = Trip(minutes=30)
    for _ in range(25):
        trip.do('replan')
        for _ in range(12):
            trip.step(0.0, CONSUMERS_W)
            trip.report()
    assert (trip.command_w, trip.status) == (0.0, Status.WAITING)
    assert 'has stood for' in trip.planner.state.decision.explanation


def test_a_frozen_position_is_refused_until_it_moves_and_the_vehicle_drives_on_by_the_battery():
    trip, refusals = Trip(minutes=60), []
    for number in range(200):
        trip.step(DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
        trip.report()
        refusals.append(str(trip.planner.state.inbox.refused_progress))
    assert f'has stayed at {1800.0 * SPEED_MPS:.0f} m for minutes, although the battery drives' in refusals[-1]
    # From five minutes after it froze.
    assert refusals.count('None') == pytest.approx(60, abs=2)
    assert trip.planner.state.decision.plan.arrival_time_s == pytest.approx(1800.0 - 1000.0, abs=6.0)
    trip.here_m += 1000.0 * SPEED_MPS
    trip.report()
    assert trip.planner.state.inbox.refused_progress is None
    assert trip.planner.state.decision.plan.arrival_time_s == pytest.approx(1800.0 - 1000.0, abs=6.0)


# The fridge of a trailer and heated seats; the cabin's thermostat: 2 of 3 times 7 kW.
@pytest.mark.parametrize('unplanned_w', [(5000.0,), (7000.0, 7000.0, 0.0)])
def test_a_vehicle_that_stands_with_consumers_on_no_plan_stays_at_its_place(unplanned_w):
    trip = Trip(minutes=60)
    for number in range(480):
        trip.step(0.0, CONSUMERS_W + unplanned_w[number % len(unplanned_w)])
        trip.report()
    assert (trip.planner.state.inbox.refused_progress, trip.status) == (None, Status.WAITING)
    assert trip.planner.state.inbox.timetable.delay_ns == pytest.approx(2400 * NS_PER_S, abs=NS_PER_S)
    # It drives on, and the next position follows.
    trip.step(DRIVE_W, CONSUMERS_W + 5000.0)
    trip.here_m += SPEED_MPS * 5.0
    trip.report()
    trip.step(DRIVE_W, CONSUMERS_W + 5000.0)
    assert trip.planner.state.inbox.timetable.delay_ns == pytest.approx(2400 * NS_PER_S, abs=5 * NS_PER_S)


def test_a_charge_that_is_frozen_does_not_make_a_driving_vehicle_stand():
    trip = Trip(has_position=False, minutes=120)
    for number in range(480):
        trip.soc = 0.6
        trip.step(DRIVE_W * (1.1 if number % 2 else 0.9), CONSUMERS_W)
    assert [verdict.signal for verdict in trip.planner.state.signal_verdicts] == [CURRENT]
    assert trip.planner.state.decision.plan.arrival_time_s == pytest.approx(3600.0 - 2400.0, abs=6.0)


def test_a_source_that_hangs_heats_nothing_until_its_values_change():
    trip, doubted_s = Trip(has_position=False, minutes=60), []
    for at_s in range(5, 605, 5):
        trip.now_s += 5
        trip.tell(BatteryStateArrived(Measurement(BatteryState(4.5, 0.7), trip.clock_ns, 380.0, 50.0)))
        if trip.planner.state.signal_verdicts:
            doubted_s.append(at_s)
            assert (trip.command_w, trip.status) == (0.0, Status.INVALID_INPUT)
    assert doubted_s == list(range(305, 605, 5))
    trip.step(DRIVE_W, CONSUMERS_W)
    assert trip.planner.state.signal_verdicts == ()


def test_a_position_on_its_way_during_an_update_counts_for_the_route_before():
    trip = Trip(minutes=20)
    stamp_ns, distance_m = trip.clock_ns, trip.here_m
    trip.now_s += 1
    trip.do('replan')
    trip.tell(ProgressArrived(Progress(distance_m, stamp_ns, 'home')))
    assert trip.planner.state.inbox.timetable.latest is None
    trip.step(DRIVE_W, CONSUMERS_W)
    trip.here_m += SPEED_MPS * 6.0
    trip.tell(ProgressArrived(Progress(trip.here_m, trip.clock_ns, 'home')))
    assert trip.planner.state.inbox.timetable.latest.distance_m == trip.here_m


def test_positions_after_the_end_are_no_fault_and_count_no_more():
    trip = arrived_early()
    trip.is_over = True
    for distance_m in (7000.0, 6900.0, 3000.0, 0.0):
        trip.step(DRIVE_W, CONSUMERS_W)
        trip.send_position(distance_m)
    assert (trip.violations, trip.planner.state.inbox.refused_progress) == ([], None)
    assert trip.planner.state.inbox.timetable.end is not None


def test_a_late_trip_that_has_ended_by_time_goes_on_with_an_update():
    trip = Trip(has_position=False)
    for number in range(80):
        trip.step(DRIVE_W * (0.3 if number % 2 else 0.6), CONSUMERS_W)
    assert (trip.status, trip.command_w) == (Status.ARRIVED, 0.0)
    # No position and no charging showed an arrival.
    assert ': by its times the vehicle arrived ' in trip.planner.state.decision.explanation
    assert ': arrived ' in arrived_early().planner.state.decision.explanation
    # Of a moment before the end, which was assumed only.
    route_id, stamp_ns, length_m = trip.route
    trip.route = route_id, stamp_ns + 300 * NS_PER_S, length_m
    trip.here_m, trip.fixed_m = 0.0, None
    trip.send_again()
    # 80 s of its time are left.
    assert 70 <= trip.heats(30) <= 80
