# SPDX-License-Identifier: Apache-2.0
"""`route_publisher`: a route file as route_plan, fixes as route_progress, and the planner that follows."""

import math
import re

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from gps_drives import gpx, NS, on_earth, Road
import numpy as np
from planner_car import LATCHED, set_parameters, state_at
import pytest
from rcl_interfaces.srv import SetParametersAtomically
from refusals import problems_of
from sensor_msgs.msg import BatteryState, NavSatFix, NavSatStatus

from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fix import fix_from_message
from bev_preheat.messages.route_offer import load_offer
from bev_preheat.nodes.route_publisher_node import PARAMETERS
from bev_preheat.nodes.simulated_drive import departure
from bev_preheat.nodes.simulated_drive import PARAMETERS as SIMULATOR_PARAMETERS
from bev_preheat_msgs.msg import PreheatPlan, RoutePlan, RouteProgress

START_S, SPEED_MPS = 1_700_000_000, 15.0
ROAD = Road.through([(0, 0), (6000, 0), (6000, 9000)])
AMBIENT = ('-p', 'ambient_temperature:=-6.5')


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp('route') / 'to_the_sea.gpx'
    path.write_text(gpx(ROAD, SPEED_MPS))
    return path


def a_fix(east_m, north_m, second=START_S, **changed):
    (latitude_deg,), (longitude_deg,) = on_earth(np.array([east_m]), np.array([north_m]), ROAD.origin)
    message = NavSatFix(latitude=float(latitude_deg), longitude=float(longitude_deg), **changed)
    message.status.status = NavSatStatus.STATUS_FIX
    message.header.stamp = Time(sec=int(second), nanosec=round(second % 1 * NS))
    return message


# The messages

def read(message):
    return fix_from_message(message, START_S * NS, 5.0, 1.0)


@pytest.mark.parametrize('kind, covariance, deviation_m', [
    (0, [9.0] * 9, None), (2, [16.0, 0, 0, 0, 9.0, 0, 0, 0, 900.0], 4.0),
    # Turned by 45 degrees: 25 along one diagonal and 1 along the other.
    (3, [13.0, 12.0, 0, 12.0, 13.0, 0, 0, 0, 1.0], 5.0),
    (2, [0.0] * 9, None), (2, [math.nan] * 9, None), (1, [-1.0, 0, 0, 0, 4.0, 0, 0, 0, 1.0], None)])
def test_its_deviation_is_that_of_the_worst_horizontal_direction(kind, covariance, deviation_m):
    message = a_fix(0.0, 0.0, position_covariance_type=kind)
    message.position_covariance = [float(value) for value in covariance]
    assert read(message).deviation_m == (None if deviation_m is None else pytest.approx(deviation_m))


@pytest.mark.parametrize('change, problem', [
    (lambda m: setattr(m, 'latitude', math.nan), 'latitude: nan is not allowed; it must be -90 ... 90 deg'),
    (lambda m: setattr(m, 'longitude', 181.0), 'longitude: 181 is not allowed'),
    (lambda m: setattr(m, 'longitude', math.inf), 'longitude: inf is not allowed'),
    (lambda m: (setattr(m, 'latitude', 0.0), setattr(m, 'longitude', 0.0)), 'latitude, longitude: 0, 0 means no'),
    (lambda m: setattr(m.status, 'status', -1), 'status.status: -1 means no fix'),
    (lambda m: setattr(m.status, 'status', -2), 'status.status: -2 means not known'),
    (lambda m: setattr(m.header, 'stamp', Time()), 'header.stamp: is 0'),
    (lambda m: setattr(m.header, 'stamp', Time(sec=START_S - 6)), 'header.stamp: the position is 6 s old'),
    (lambda m: setattr(m.header, 'stamp', Time(sec=START_S + 2)), 'header.stamp: the position is 2 s ahead')])
def test_a_fix_that_is_none_is_refused_by_its_field(change, problem):
    message = a_fix(0.0, 0.0)
    change(message)
    refused = problems_of(read, message)
    assert [found for found in refused if found.startswith(problem)], refused


def values(**changed):
    return {**{parameter.name: parameter.default for parameter in PARAMETERS}, **changed}


def test_the_route_plan_carries_what_the_parameters_say(file):
    offer = load_offer(values(
        route=str(file), ambient_temperature=-6.5, target_battery_temperature=21.0, minimum_arrival_soc=0.25,
        charger_power=150e3, charging_departure_soc=0.75, standing_time=7200.0))
    plan = offer.route_plan(START_S * NS)
    assert (plan.route_id, plan.header.stamp.sec) == ('to_the_sea', START_S)
    assert (plan.target_battery_temperature, plan.has_target_battery_temperature) == (21.0, True)
    assert (plan.minimum_arrival_soc, plan.charger_power, plan.charging_departure_soc) == (0.25, 150e3, 0.75)
    assert (plan.standing_time, plan.charging_planned) == (7200.0, True)
    assert set(plan.ambient_temperature) == {-6.5}
    assert np.dot(plan.segment_duration, plan.speed) == pytest.approx(ROAD.length_m, rel=0.01)
    assert offer.on_route_m(offer.line.length_m) == pytest.approx(offer.length_m)


@pytest.mark.parametrize('changed, unused', [
    ({'charger_power': 150e3, 'charging_departure_soc': 0.8, 'target_battery_temperature': 20.0}, []),
    ({'charging_planned': False, 'target_battery_temperature': 0.0}, []),
    ({'charging_departure_soc': 0.8}, [
        'charging_departure_soc: 0.8 is not used, because charger_power is not given']),
    ({'charging_planned': False, 'charger_power': 150e3, 'charging_departure_soc': 0.8,
      'target_battery_temperature': 20.0, 'maximum_arrival_temperature': 30.0}, [
          f'{given} is not used, because charging_planned is false' for given in (
              'target_battery_temperature: 20', 'maximum_arrival_temperature: 30', 'charger_power: 150000',
              'charging_departure_soc: 0.8')])])
def test_a_parameter_of_the_goal_without_effect_is_named(file, changed, unused):
    given = values(route=str(file), ambient_temperature=0.0, **changed)
    assert [warning for warning in load_offer(given).warnings if 'not used' in warning] == unused
    simulated = {parameter.name: parameter.default for parameter in SIMULATOR_PARAMETERS}
    assert list(departure({**simulated, **changed})[2]) == unused


@pytest.mark.parametrize('changed, problem', [
    ({}, r'has no ambient temperature; give it \[degC\], such as: parameter ambient_temperature:=-5.0'),
    ({'ambient_temperature': -59.0}, 'ambient temperature: -59 is not allowed; it must be at least -40'),
    ({'ambient_temperature': 0.0, 'target_battery_temperature': -55.0}, 'target battery temperature: -55'),
    ({'ambient_temperature': 0.0, 'route_id': 'x' * 300}, 'route_id: .* it must have at most 256 characters')])
def test_a_route_that_cannot_be_published_is_refused(file, changed, problem):
    with pytest.raises(InvalidInput, match=problem):
        load_offer(values(route=str(file), **changed))


def test_the_range_of_the_free_speed_is_that_of_its_parameter_in_its_unit(refusal, file, tmp_path):
    line = tmp_path / 'line.gpx'
    line.write_text(re.sub('<time>[^<]*</time>', '', file.read_text()))
    low_mps, high_mps = next(parameter.limits for parameter in PARAMETERS if parameter.name == 'free_speed')
    for speed_mps in (low_mps, high_mps):
        assert load_offer(values(route=str(line), ambient_temperature=0.0, free_speed=speed_mps)).length_m > 0.0
    said = refusal('route_publisher', '--ros-args', '-p', f'route:={line}', '-p', 'free_speed:=70.0', *AMBIENT)
    # 5 ... 250 km/h.
    assert said.startswith('route_publisher: error: free_speed: 70 m/s is not allowed; it must be 1.3889 ... 69.4')


def test_a_file_that_is_no_route_is_one_line_and_2(refusal, tmp_path):
    path = tmp_path / 'broken.gpx'
    path.write_text('<?xml version="1.0"?><gpx version="1.1"><trk><trkseg><trkpt lat="north" lon="11"/>')
    line = refusal('route_publisher', '--ros-args', '-p', f'route:={path}', *AMBIENT)
    assert line.startswith(f'route_publisher: error: {path}')


# The node

class Trip:
    """A vehicle at a place, and the topics of publisher and planner."""

    def __init__(self, rehearsal):
        self.rehearsal = rehearsal
        self.fixes = rehearsal.publisher(NavSatFix, 'fix', 10)
        self.states = rehearsal.publisher(BatteryState, 'battery_state')
        self.plans = rehearsal.record(PreheatPlan, 'preheat_plan', LATCHED)
        self.routes = rehearsal.record(RoutePlan, 'route_plan', LATCHED)
        self.progress = rehearsal.record(RouteProgress, 'route_progress')
        self.diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 100)

    def drive(self, until, second, place, speed_mps=SPEED_MPS):
        """Drive on from a place at a second until a condition holds; return both."""
        self.rehearsal.now_ns = second * NS
        for _ in range(600):
            self.fixes.publish(a_fix(*place, second))
            self.states.publish(state_at(second * NS, temperature=-4.0, percentage=0.75))
            if until():
                return second, place
            self.rehearsal.advance(1.0)
            second, place = second + 1, (place[0] + speed_mps, place[1])
        raise AssertionError(f'not within 600 s; the last: {self.entries()}')

    def entries(self):
        return {status.name: status for message in self.diagnostics.messages for status in message.status}

    def position(self):
        status = self.entries().get('route_publisher: position')
        return '' if status is None else status.message


def test_the_planner_follows_the_positions_and_a_restarted_publisher_finds_them_again(rehearsal, file):
    trip = Trip(rehearsal)
    arguments = ('-p', f'route:={file}', *AMBIENT, '-p',
                 f'departure_time:={START_S}.0', '-p', 'target_battery_temperature:=25.0')
    rehearsal.now_ns = START_S * NS
    rehearsal.start('planner')
    publisher = rehearsal.start('route_publisher', *arguments)

    # 200 s late: planned after 100 s, driven after 300 s.
    def is_followed():
        plan = trip.plans.latest
        return plan is not None and plan.delay > 150.0 and trip.progress.latest is not None

    second, place = trip.drive(is_followed, START_S + 300, (1500.0, 3.0))
    assert trip.plans.latest.delay == pytest.approx(200.0, abs=3.0)
    assert trip.plans.latest.route_id == 'to_the_sea'
    left_s = (ROAD.length_m - place[0]) / SPEED_MPS
    arrival = trip.plans.latest.arrival
    assert arrival.sec - second == pytest.approx(left_s, abs=10.0)
    told = trip.progress.latest
    assert told.route_id == 'to_the_sea' and told.route_stamp.sec == START_S
    # In the metres of the route plan, whose reader takes the earth for a sphere.
    plan = trip.routes.wait_for()
    scale = np.dot(plan.segment_duration, plan.speed) / ROAD.length_m
    driven_m = SPEED_MPS * (told.header.stamp.sec - second) + place[0]
    assert told.distance == pytest.approx(scale * driven_m, abs=12.0)

    # Positions beside the route give no place.
    left_at = second + 1
    second, place = trip.drive(lambda: 'off the route' in trip.position(), left_at, (place[0], 400.0))
    assert max(message.header.stamp.sec for message in trip.progress.messages) < left_at

    publisher.end()
    trip.routes.clear()
    trip.progress.clear()
    publisher = rehearsal.start('route_publisher', *arguments)
    second, place = trip.drive(lambda: trip.progress.messages, second + 1, (3000.0, 0.0))
    told = trip.progress.messages[0]
    driven_m = SPEED_MPS * (told.header.stamp.sec - second) + place[0]
    assert told.distance == pytest.approx(driven_m, abs=60.0)
    assert trip.routes.wait_for().header.stamp.sec == START_S


def test_on_departure_and_after_a_restart_of_the_clock_the_route_is_published_again(rehearsal, file):
    trip = Trip(rehearsal)
    publisher = rehearsal.start('route_publisher', '-p', f'route:={file}', *AMBIENT)
    second, place = trip.drive(lambda: len(trip.progress.messages) > 20, START_S, (10.0, 0.0), speed_mps=0.0)
    assert trip.routes.latest.header.stamp.sec - START_S < 20
    assert trip.progress.latest.distance == pytest.approx(10.0, abs=15.0)
    departed, _ = trip.drive(lambda: trip.routes.latest.header.stamp.sec > START_S + 19, second, place)
    assert trip.routes.latest.header.stamp.sec == pytest.approx(second, abs=4.0)
    assert publisher.output().count('left the start') == 1

    # Another file replaces the route; an unreadable file does not.
    def replaced(**changed):
        return set_parameters(rehearsal, '/route_publisher', SetParametersAtomically, **changed)

    refused = replaced(route='reference')
    assert not refused.successful
    assert 'has its own ambient temperature; leave out parameter ambient_temperature' in refused.reason
    assert replaced(route='reference', ambient_temperature=-100.0).successful
    assert trip.routes.wait_for(lambda message: message.route_id == 'reference').header.stamp.sec >= departed
    assert replaced(route=str(file), ambient_temperature=-6.5).successful

    trip.routes.clear()
    heard, _ = trip.drive(lambda: trip.routes.messages, START_S - 5000, place)
    # Between the restart of the clock and the message's arrival.
    assert START_S - 5000 <= trip.routes.latest.header.stamp.sec <= heard
    assert 'The clock fell back by' in publisher.output()
