# SPDX-License-Identifier: Apache-2.0
"""Sensors that are wrong from start to end, other batteries on the topic, states out of order."""

import math

from level_car import route_of
import pytest

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.simulation.heater import NO_LEASE
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import Charge, DrivePhase
from bev_preheat.simulation.sensors import OtherBattery, PositionReports, Sensors, Spike
from bev_preheat.simulation.traffic import Event, Kind
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')


def readings(to_s=100.0, power_w=20e3, following=(), **sensors):
    car = ImperfectCar(VEHICLE, DrivePhase(route_of(100.0, power_w=power_w), Goal(20.0)), BatteryState(5.0, 0.6),
                       Imperfections(sensors=Sensors(**sensors)), following=following)
    car.advance_under(NO_LEASE, to_s)
    return car.readings()


def test_a_spike_raises_the_temperature_while_it_lasts():
    plain = readings()
    spiky = readings(spikes=(Spike(20.0, 50.0, 2.0), Spike(40.0, 60.0, 1.0)))
    raised = {round(good.instant_s): bad.temperature_c - good.temperature_c for good, bad in zip(plain, spiky)}
    assert [raised[second] for second in (19, 20, 39, 40, 49, 50, 59, 60)] == pytest.approx(
        [0.0, 2.0, 2.0, 3.0, 3.0, 1.0, 1.0, 0.0])


@pytest.mark.parametrize('every', [1, 3, 10])
def test_each_so_many_th_temperature_is_no_number(every):
    taken = readings(invalid_every=every)
    assert [math.isnan(each.temperature_c) for each in taken] == [
        number % every == 0 for number in range(1, len(taken) + 1)]


@pytest.mark.parametrize('is_first', [True, False])
def test_another_battery_comes_in_turn(is_first):
    other = OtherBattery(20.0, 0.9, 24.6, -3.0, 'trunk', is_first)
    taken = readings(location='floor', other=other)
    others, own = (taken[0::2], taken[1::2]) if is_first else (taken[1::2], taken[0::2])
    assert {(each.temperature_c, each.soc, each.voltage_v, each.current_a, each.location) for each in others} == {
        (20.0, 0.9, 24.6, -3.0, 'trunk')}
    assert {each.location for each in own} == {'floor'}
    assert max(each.temperature_c for each in own) < 6.0


def test_states_in_disorder_are_neither_lost_nor_new():
    taken = readings(reordered_every=5)
    stamps_s = [each.instant_s for each in taken]
    assert stamps_s[:8] == [0.0, 1.0, 2.0, 3.0, 5.0, 4.0, 6.0, 7.0]
    assert sorted(stamps_s) == [float(second) for second in range(100)] + [100.0]


@pytest.mark.parametrize('kind, driving, braking, charging', [
    ('unknown', SupplyStatus.UNKNOWN, SupplyStatus.UNKNOWN, SupplyStatus.UNKNOWN),
    ('plugged', SupplyStatus.DISCHARGING, SupplyStatus.DISCHARGING, SupplyStatus.CHARGING),
    ('sign', SupplyStatus.DISCHARGING, SupplyStatus.CHARGING, SupplyStatus.CHARGING)])
def test_the_supply_status_says_what_its_kind_knows(kind, driving, braking, charging):
    charge = (Charge(30e3, 60.0, 0.0),)
    for power_w, status in ((20e3, driving), (-20e3, braking)):
        taken = readings(150.0, power_w, charge, supply_status=kind)
        assert (taken[50].supply_status, taken[130].supply_status) == (status, charging)


START_NS = 1_700_000_000_000_000_000


def distances(until_s, *events):
    """Drive, and return the distance reported at each second, or None."""
    drive = DrivePhase(route_of(100.0, power_w=20e3), Goal(20.0), events=events, position=PositionReports())
    car = ImperfectCar(VEHICLE, drive, BatteryState(0.0, 0.8), Imperfections(sensors=Sensors(period_s=50.0)),
                       route_id='home')
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


def test_the_distance_grows_as_it_drives_and_stays_where_it_stands():
    said = distances(180, Event(Kind.STOP, 30.0, None, 40.0), Event(Kind.OTHER_PACE, 80.0, None, 20.0, 2.0))
    assert [said[second] for second in (0, 10, 30, 50, 70, 80, 100, 120, 180)] == [
        0.0, 200.0, 600.0, 600.0, 600.0, 800.0, 1000.0, 1200.0, 2000.0]


def test_off_its_route_it_says_nothing_until_the_next_one_comes():
    said = distances(50, Event(Kind.DETOUR, 30.0, 10.0, route=route_of(100.0, speed_mps=10.0)))
    assert [said[second] for second in (29, 30, 39, 40, 50)] == [580.0, None, None, 0.0, 100.0]
