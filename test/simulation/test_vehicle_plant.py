# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle compared with closed forms and balances."""

from dataclasses import replace

from level_car import CAPACITY_AH, current_a, CURVED, HEAT_CAPACITY_J_PER_K, LEVEL, level, OHM, route_of, VOLTAGE_V
import pytest

from bev_preheat.planning.situation import BatteryState
from bev_preheat.simulation.heater import HeaterLease
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle.description import HeatPath


def with_limits(charge_w, discharge_w):
    return replace(LEVEL, battery=replace(
        LEVEL.battery, charge_power_limit=level(charge_w), discharge_power_limit=level(discharge_w)))


def winter_plant(vehicle=CURVED):
    """Return a plant on a route on which everything varies."""
    route = route_of(31.0, 47.5, 60.0, 12.25, power_w=[18e3, -7e3, 42e3, 0.0],
                     speed_mps=[14.0, 22.0, 33.0, 0.0], ambient_c=[-9.0, -4.0, -11.0, -2.0],
                     cabin_w=[1800.0, 2600.0, 900.0, 6200.0], auxiliary_w=350.0, rms_w=[24e3, 9e3, 42e3, 0.0])
    return VehiclePlant(vehicle, route, BatteryState(temperature_c=3.0, soc=0.71))


@pytest.mark.parametrize('path', [HeatPath(), HeatPath(
    heater_lag_s=60.0, coolant_heat_capacity_j_per_k=20e3, coolant_conductance_w_per_k=400.0, sensor_lag_s=90.0)],
    ids=['direct', 'late'])
def test_heat_balance_closes(path):
    plant = winter_plant(replace(CURVED, heat_path=path))
    plant.advance(80.0, 4000.0)
    plant.advance(plant.duration_s, 0.0)
    energy = plant.energy_wh
    heat_wh = energy.joule + energy.drivetrain_heat + energy.hvch_heat + energy.leakage
    coolant_j = path.coolant_heat_capacity_j_per_k * (plant.coolant_c - 3.0)
    assert path.is_direct or coolant_j > 72e3
    stored_j = HEAT_CAPACITY_J_PER_K * (plant.temperature_c - 3.0)
    assert stored_j + coolant_j == pytest.approx(3600.0 * heat_wh, rel=1e-9)


def test_power_ends_with_the_lease_within_a_step():
    plant = winter_plant()
    plant.advance_under(HeaterLease(power_w=2500.0, until_s=20.37), 30.0)
    assert plant.energy_wh.hvch_electric == pytest.approx(2500.0 * 20.37 / 3600.0, rel=1e-12)
    assert plant.heater_power_w == 0.0
    assert plant.time_s == 30.0
    assert plant.without_lease_s == pytest.approx(30.0 - 20.37)


def test_after_arrival_the_vehicle_stands():
    plant = winter_plant()
    plant.advance(plant.duration_s, 3000.0)
    arrived = (plant.soc, plant.temperature_c, plant.energy_wh)
    plant.advance(plant.duration_s + 500.0, 3000.0)
    assert plant.has_arrived and plant.is_standing
    assert (plant.soc, plant.temperature_c, plant.energy_wh) == arrived
    assert plant.time_s == plant.duration_s + 500.0
    assert plant.heater_power_w == plant.current_a == 0.0


def test_power_that_the_battery_cannot_deliver_is_accounted_for():
    most_w = VOLTAGE_V**2 / (4.0 * OHM)
    plant = VehiclePlant(LEVEL, route_of(10.0, 20.0, power_w=[60e3, most_w + 5e3]), BatteryState(5.0, 0.8))
    plant.advance(30.0, 0.0)
    assert plant.undeliverable_power_w == pytest.approx(5e3)
    assert plant.undeliverable_energy_wh == pytest.approx(5e3 * 20.0 / 3600.0)
    drawn_as = current_a(60e3) * 10.0 + VOLTAGE_V / (2.0 * OHM) * 20.0
    assert (0.8 - plant.soc) * CAPACITY_AH * 3600.0 == pytest.approx(drawn_as)
    assert plant.energy_wh.battery_total == pytest.approx(VOLTAGE_V * drawn_as / 3600.0)


def test_friction_brake_takes_what_the_battery_must_not():
    plant = VehiclePlant(with_limits(charge_w=-5e3, discharge_w=1e5), route_of(
        200.0, power_w=-30e3, auxiliary_w=350.0), BatteryState(5.0, 0.8))
    plant.advance(200.0, 0.0)
    assert plant.energy_wh.battery_total == pytest.approx(-5e3 * 200.0 / 3600.0)
    brake_w = 30e3 - 350.0 - (5e3 + OHM * (5e3 / VOLTAGE_V)**2)
    assert plant.friction_brake_energy_wh == pytest.approx(brake_w * 200.0 / 3600.0)
    assert plant.energy_wh.drivetrain_heat == pytest.approx(
        0.6 * 0.12 * (30e3 - brake_w) * 200.0 / 3600.0)
    assert plant.brake_power_w == 0.0, 'the vehicle stands'


def test_heater_gets_what_the_battery_may_give():
    plant = VehiclePlant(with_limits(charge_w=-1e5, discharge_w=20e3), route_of(200.0, power_w=18e3),
                         BatteryState(5.0, 0.8))
    plant.advance(150.0, 6e3)
    assert plant.energy_wh.battery_total == pytest.approx(20e3 * 150.0 / 3600.0)
    joule_w = OHM * (20e3 / VOLTAGE_V)**2
    assert plant.heater_power_w == pytest.approx(20e3 - joule_w - 18e3)


def test_with_an_empty_battery_the_vehicle_stands():
    strong = with_limits(charge_w=-1e5, discharge_w=1e5)
    plant = VehiclePlant(strong, route_of(900.0, power_w=80e3), BatteryState(5.0, 0.05))
    plant.advance(900.0, 1000.0)
    lasts_s = 0.05 * CAPACITY_AH * 3600.0 / current_a(81e3)
    assert lasts_s <= plant.empty_at_s <= lasts_s + 1.0
    assert plant.is_standing and not plant.has_arrived
    assert plant.energy_wh.hvch_electric == pytest.approx(1000.0 * plant.empty_at_s / 3600.0)
    assert plant.heater_power_w == plant.current_a == 0.0


def test_a_car_does_not_let_its_battery_melt():
    plant = VehiclePlant(LEVEL, route_of(600.0, power_w=2e6), BatteryState(40.0, 0.9))
    plant.advance(600.0, 0.0)
    hottest_c = CURVED.battery.temperature_range_c[1] + 20.0
    energy = plant.energy_wh
    assert plant.temperature_c == hottest_c
    assert (energy.joule + energy.drivetrain_heat + energy.leakage) == pytest.approx(
        HEAT_CAPACITY_J_PER_K * (hottest_c - 40.0) / 3600.0)


def test_current_and_voltage_are_those_of_the_circuit():
    plant = VehiclePlant(LEVEL, route_of(10.0, 10.0, power_w=[30e3, -12e3]), BatteryState(5.0, 0.8))
    plant.advance(5.0, 2000.0)
    assert plant.current_a > 0.0
    assert plant.terminal_voltage_v == pytest.approx(VOLTAGE_V - OHM * plant.current_a)
    assert plant.terminal_voltage_v * plant.current_a == pytest.approx(32e3)
    plant.advance(15.0, 0.0)
    assert plant.terminal_voltage_v * plant.current_a == pytest.approx(-12e3)
    assert plant.current_a < 0.0
