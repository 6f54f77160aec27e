# SPDX-License-Identifier: Apache-2.0
"""Sensors that are wrong from start to end, other batteries on the topic, states out of order."""

import math

import numpy as np
import pytest

from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.heater_lease import NO_LEASE
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import Charge
from bev_preheat.simulation.sensors import OtherBattery, Sensors, Spike
from bev_preheat.vehicle import load_vehicle

VEHICLE = load_vehicle('reference')


def readings(to_s=100.0, power_w=20e3, following=(), **sensors):
    route = make_route({
        'duration_s': [100.0], 'speed_mps': [20.0], 'propulsion_power_w': [power_w],
        'ambient_temperature_c': [0.0], 'cabin_heating_power_w': [0.0], 'auxiliary_power_w': [0.0]}, None)
    car = ImperfectCar(VEHICLE, route, BatteryState(5.0, 0.6), Goal(20.0),
                       Imperfections(sensors=Sensors(**sensors)), following=following)
    car.advance_under(NO_LEASE, to_s)
    return car.readings()


def test_what_was_never_set_is_the_same_from_start_to_end():
    taken = readings(
        temperature_stuck_at_c=0.0, soc_stuck_at=0.0, voltage_stuck_at_v=12.6, temperature_noise_k=0.3)
    assert {(each.temperature_c, each.soc, each.voltage_v) for each in taken} == {(0.0, 0.0, 12.6)}
    assert taken[0].current_a == pytest.approx(20e3 / readings()[0].voltage_v, rel=1e-3)


def test_scale_and_sign_change_nothing_else():
    right, wrong = readings(), readings(soc_scale=100.0, voltage_scale=0.1, reverses_current=True)
    for good, bad in zip(right, wrong, strict=True):
        assert bad.soc == pytest.approx(100.0 * good.soc)
        assert bad.voltage_v == pytest.approx(0.1 * good.voltage_v)
        assert bad.current_a == -good.current_a
        assert bad.temperature_c == good.temperature_c


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


def test_the_sensor_noise_is_on_another_battery_too():
    taken = readings(other=OtherBattery(20.0, 0.9, 24.6, is_first=True), temperature_noise_k=0.3)[0::2]
    assert np.std([each.temperature_c for each in taken]) == pytest.approx(0.3, rel=0.4)


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
