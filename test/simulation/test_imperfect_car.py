# SPDX-License-Identifier: Apache-2.0
"""A simulated car that differs from its files: mismatch, sensors, heater faults, clock."""

from math import isnan

import numpy as np
import pytest

from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import load_route
from bev_preheat.simulation.heater import HeaterFault, HeaterLease, NO_LEASE
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch, true_route, true_vehicle
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.traffic import Event, Kind
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import DIRECT, HeatPath

VEHICLE = load_vehicle('reference')
ROUTE = load_route('reference', VEHICLE.defaults)
MISMATCH = Mismatch(heat_capacity=0.93, leakage=1.17, resistance=0.86, heater=1.04,
                    propulsion_power=1.08)
LEASE = HeaterLease(3000.0, 10_000.0)
CABIN_W = float(ROUTE.cabin_heating_power_w[0])
LIMIT_W = VEHICLE.hvch.maximum_power_w - CABIN_W


def make_car(seed=5, events=(), standing_time_s=0.0, **imperfections):
    return ImperfectCar(VEHICLE, DrivePhase(ROUTE, Goal(25.0), standing_time_s, events), BatteryState(-7.0, 0.9),
                        Imperfections(**imperfections), seed)


def drive(car, to_s, lease=NO_LEASE):
    car.advance_under(lease, to_s)
    return car.readings()


# Mismatch

def test_each_factor_changes_its_own_quantity():
    battery, true = VEHICLE.battery, true_vehicle(VEHICLE, MISMATCH, DIRECT)
    assert true.battery.heat_capacity_j_per_k == pytest.approx(
        0.93 * battery.heat_capacity_j_per_k)
    assert true.battery.leakage.coefficient_w_per_k(20.0) == pytest.approx(
        1.17 * battery.leakage.coefficient_w_per_k(20.0))
    assert true.hvch.efficiency == pytest.approx(1.04 * VEHICLE.hvch.efficiency)
    assert true.battery.open_circuit_voltage is battery.open_circuit_voltage
    assert true.hvch.maximum_power_w == VEHICLE.hvch.maximum_power_w


def test_a_lagging_sensor_shows_what_the_battery_was():
    car = make_car(heat_path=HeatPath(sensor_lag_s=120.0))
    prompt = make_car()
    late, now = (drive(each, 400.0) for each in (car, prompt))
    # A battery that warms steadily is shown with its temperature one lag earlier.
    warming_k_per_s = (now[-1].temperature_c - now[-101].temperature_c) / 100.0
    assert now[-1].temperature_c - late[-1].temperature_c == pytest.approx(
        120.0 * warming_k_per_s, rel=0.15)
    assert late[0].temperature_c == now[0].temperature_c


def test_wandering_power_keeps_its_mean_and_has_the_deviation_asked_for():
    wandering = Mismatch(propulsion_power=1.1, propulsion_power_variability=0.2)
    factors = np.concatenate([
        (true_route(ROUTE, wandering, np.random.default_rng(seed)).propulsion_power_w
         / ROUTE.propulsion_power_w)[2:-2] for seed in range(400)])
    # Thousands of values, with five neighbours counting as one: 4 standard errors.
    error = 4.0 * 0.2 / np.sqrt(len(factors) / 5)
    assert factors.mean() == pytest.approx(1.1, abs=error)
    assert np.log(factors).std() == pytest.approx(0.2, abs=error)


# Sensors


def test_readings_come_each_period_with_what_was_true_then():
    car, reference = make_car(sensors=Sensors(period_s=2.5)), make_car()
    car.readings()
    readings = drive(car, 8.0, LEASE)
    assert [reading.instant_s for reading in readings] == [2.5, 5.0, 7.5]
    for reading in readings:
        reference.advance_under(LEASE, reading.instant_s)
        assert reading.temperature_c == pytest.approx(reference.plant.temperature_c, abs=1e-6)
    assert car.time_s == 8.0


def test_a_delay_makes_readings_late_but_not_their_instants():
    car = make_car(sensors=Sensors(delay_s=3.0))
    assert drive(car, 2.9) == []
    assert [reading.instant_s for reading in drive(car, 5.5)] == [0.0, 1.0, 2.0]


def test_an_invalid_temperature_is_no_number():
    readings = drive(make_car(sensors=Sensors(invalid=((10.0, 20.0),))), 40.0)
    assert [at for at, reading in enumerate(readings) if isnan(reading.temperature_c)] == list(range(10, 20))


def test_seed_makes_drive_and_readings():
    imperfections = {'sensors': Sensors(temperature_noise_k=0.2),
                     'mismatch': Mismatch(propulsion_power_variability=0.2)}
    first, same, other = (make_car(seed, **imperfections) for seed in (11, 11, 12))
    readings = drive(first, 300.0)
    assert readings == drive(same, 300.0)
    assert readings != drive(other, 300.0)
    assert (first.plant.route.propulsion_power_w != other.plant.route.propulsion_power_w).all()


# Heater

@pytest.mark.parametrize('fault, expected_w', [
    (HeaterFault(0.0, share=0.0), 0.0), (HeaterFault(0.0, share=0.4), 1200.0),
    (HeaterFault(0.0, stuck_on=True), LIMIT_W), (HeaterFault(200.0, share=0.0), 3000.0),
    (HeaterFault(25.5, 50.5, share=0.0), 0.75 * 3000.0)],
    ids=['dead', 'derated', 'stuck on', 'not yet', 'for a while'])
def test_a_faulty_heater_takes_what_it_is_said_to(fault, expected_w):
    car = make_car(heater_faults=(fault,))
    drive(car, 100.0, LEASE)
    assert car.plant.energy_wh.hvch_electric == pytest.approx(expected_w * 100.0 / 3600.0)


# Trip planner and clock


def test_the_trip_planner_says_at_the_start_how_long_the_car_stood_and_not_again():
    car = make_car(events=(Event(Kind.CANCEL_CHARGING, 50.0, 5.0),), standing_time_s=7200.0)
    assert car.mission(NS_PER_S).standing_time_s == 7200.0
    drive(car, 55.0)
    assert car.route_news(0).standing_time_s == 0.0
    assert make_car().mission(NS_PER_S).standing_time_s == 0.0


def test_an_early_arrival_is_told_with_a_route_that_has_ended():
    car = make_car(events=(Event(Kind.ARRIVE_EARLY, 500.0, 10.0),))
    assert car.plant.duration_s == pytest.approx(500.0)
    drive(car, 510.0)
    leg, = car.route_news(0).legs
    assert leg.start_ns / NS_PER_S + leg.route.total_duration_s == pytest.approx(500.0)
