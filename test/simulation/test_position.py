# SPDX-License-Identifier: Apache-2.0
"""Position reports of the simulated car along its route."""

from math import inf

import numpy as np
import pytest

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.heater_lease import NO_LEASE
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.position import Position, PositionReports
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.traffic import ClockJump, Event, Kind
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000_000_000_000


def a_route(duration_s=100.0, speed_mps=20.0):
    return make_route({
        'duration_s': [duration_s], 'speed_mps': [speed_mps], 'propulsion_power_w': [5e3],
        'ambient_temperature_c': [0.0], 'cabin_heating_power_w': [0.0],
        'auxiliary_power_w': [0.0]}, None)


def a_car(*events, position=PositionReports(), **imperfections):
    return ImperfectCar(
        VEHICLE, a_route(), BatteryState(0.0, 0.8), Goal(20.0),
        Imperfections(events=events, position=position, sensors=Sensors(period_s=50.0),
                      **imperfections), route_id='home')


def distances(car, until_s):
    """Drive, and return the distance reported at each second, or None."""
    said, mission = {}, car.mission(START_NS)
    for second in range(until_s + 1):
        car.advance_under(NO_LEASE, float(second))
        mission = car.route_news(START_NS) or mission
        progress = car.progress(START_NS)
        if progress is not None:
            assert (progress.route_id, progress.route_start_ns) == ('home', mission.start_ns)
            assert progress.stamp_ns == START_NS + round(car.clock_s * 1e9)
        said[second] = None if progress is None else pytest.approx(progress.distance_m)
    return said


def test_a_car_that_does_not_say_where_it_is_changes_nothing():
    car = a_car(position=None)
    car.readings()
    assert car.next_event_s == 50.0
    assert set(distances(car, 20).values()) == {None}


def test_the_distance_grows_as_it_drives_and_stays_where_it_stands():
    said = distances(a_car(Event(Kind.STOP, 30.0, None, 40.0),
                           Event(Kind.OTHER_PACE, 80.0, None, 20.0, 2.0)), 180)
    assert [said[second] for second in (0, 10, 30, 50, 70, 80, 100, 120, 180)] == [
        0.0, 200.0, 600.0, 600.0, 600.0, 800.0, 1000.0, 1200.0, 2000.0]


def test_it_counts_from_the_route_that_was_sent_last():
    said = distances(a_car(Event(Kind.STOP, 30.0, 10.0, 20.0)), 60)
    assert [said[second] for second in (39, 40, 50, 60)] == [600.0, 0.0, 0.0, 200.0]


def test_off_its_route_it_says_nothing_until_the_next_one_comes():
    said = distances(a_car(Event(Kind.DETOUR, 30.0, 10.0, route=a_route(speed_mps=10.0))), 50)
    assert [said[second] for second in (29, 30, 39, 40, 50)] == [580.0, None, None, 0.0, 100.0]


def test_it_comes_each_period_but_for_drop_outs():
    car = a_car(position=PositionReports(period_s=4.0, drop_outs=((8.0, 13.0),)))
    said = distances(car, 20)
    assert [second for second, distance_m in said.items() if distance_m is not None] == [
        0, 4, 16, 20]
    car.readings()
    assert car.next_event_s == 24.0


def test_its_stamp_is_that_of_the_clock():
    distances(a_car(clock_jumps=(ClockJump(5.0, 100.0),)), 10)


def test_noise_is_as_large_as_is_said():
    position = Position(PositionReports(noise_m=5.0), a_route(3000.0), (), np.random.default_rng(1))
    errors_m = [position.report_m(float(second)) - 20.0 * second for second in range(100, 2900)]
    assert np.std(errors_m) == pytest.approx(5.0, rel=0.1)
    assert abs(np.mean(errors_m)) < 0.4


def test_nothing_is_due_where_nothing_is_reported():
    position = Position(None, a_route(), (), np.random.default_rng(1))
    assert (position.next_s, position.report_m(10.0)) == (inf, None)
