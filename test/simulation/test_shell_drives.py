# SPDX-License-Identifier: Apache-2.0
"""A simulated battery of shell and core: its balance, and drives with the sensor in each place."""

from dataclasses import replace

import numpy as np
import pytest

from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.numerics import FLOATS
from bev_preheat.planning.planner import plan_preheating
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.steps_ahead import StepsAhead
from bev_preheat.planning.trip import make_trip
from bev_preheat.route import make_route
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections, Mismatch
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.simulation.supervised_drive import moments
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatPath, Leakage
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat.vehicle.variants import with_shell

REFERENCE = load_vehicle('reference')
START, TARGET_C = BatteryState(-2.0, 0.8), 10.0


def route(minutes=25):
    power_w = 14e3 + 8e3 * np.sin(np.arange(minutes))
    return make_route({
        'duration_s': np.full(minutes, 60.0), 'speed_mps': np.full(minutes, 22.0), 'propulsion_power_w': power_w,
        'ambient_temperature_c': np.full(minutes, -9.0), 'cabin_heating_power_w': np.full(minutes, 900.0),
        'auxiliary_power_w': np.full(minutes, 400.0)}, REFERENCE.defaults)


def shell_car(sensor='shell', heat_path=HeatPath()):
    return with_shell(replace(REFERENCE, heat_path=heat_path), 0.2, 350.0, sensor)


def supervised(car, known_as, minutes=25, **imperfections):
    """Yield time [s], plant and the planner's State at each moment of a drive; the planner knows another car."""
    drive = ImperfectCar(
        car, DrivePhase(route(minutes), Goal(TARGET_C)), START, Imperfections(**imperfections), seed=3)
    supervisor = Supervisor(known_as, Settings())
    for moment in moments(drive, supervisor, lambda: drive.plant.has_arrived):
        yield moment.time_s, drive.plant, supervisor.state


@pytest.mark.parametrize('heat_path', [HeatPath(), HeatPath(heater_lag_s=45.0, sensor_lag_s=20.0)])
def test_all_heat_is_in_shell_and_core_and_the_plan_predicts_it(heat_path):
    car = shell_car('core', heat_path)
    plan = plan_preheating(car, route(), START, Goal(TARGET_C))
    plant = VehiclePlant(car, route(), START)
    for until_s, command_w in zip(plan.time_s[1:].tolist(), plan.hvch_battery_power_w.tolist()):
        plant.advance(until_s, command_w)
    energies, pack_j_per_k = plant.energy_wh, REFERENCE.battery.heat_capacity_j_per_k
    stored_wh = pack_j_per_k * (0.8 * plant.temperature_c + 0.2 * plant.coolant_c - START.temperature_c) / 3600.0
    assert stored_wh == pytest.approx(
        energies.joule + energies.drivetrain_heat + energies.hvch_heat + energies.leakage, abs=1e-6)
    assert plan.arrival_temperature_c == pytest.approx(TARGET_C, abs=0.01)
    assert plant.temperature_c == pytest.approx(TARGET_C, abs=0.02)
    assert plan.energy_wh.leakage == pytest.approx(energies.leakage, rel=0.01)
    assert plan.energy_wh.hvch_heat == pytest.approx(energies.hvch_heat, rel=0.01)


@pytest.mark.parametrize('idle_s, command_w', [(60.0, 0.0), (60.0, 5e3), (900.0, 0.0), (900.0, 5e3)])
def test_a_plan_knows_how_much_of_a_steps_heat_the_core_has_on_arrival(idle_s, command_w):
    tight = replace(REFERENCE, battery=replace(REFERENCE.battery, leakage=Leakage(1.0, 0.0)))
    car = with_shell(tight, 0.22, 45.0, 'core')
    # Much Joule heat, and heat from the drivetrain; then core and shell only exchange heat.
    trip = make_trip(car, make_route({
        'duration_s': [300.0, idle_s], 'speed_mps': [22.0, 0.0], 'propulsion_power_w': [6e4, 0.0],
        'ambient_temperature_c': [-25.0, START.temperature_c], 'cabin_heating_power_w': [0.0, 0.0],
        'auxiliary_power_w': [0.0, 0.0]}, car.defaults))
    step, states = make_heated_step(car, FLOATS), (START.soc, START.temperature_c, 0.0, 0.0)
    for k in range(len(trip.route)):
        states = step(*states, *(column.item(k) for column in trip.inputs()), 0.0 if k else command_w)[:4]
    end = StepsAhead(trip, np.ones(len(trip.route))).end(
        0, np.array([START.soc]), np.array([START.temperature_c]), 0.0, (False, False), 0.0, command_w, False)
    assert end.settled_c.item() - START.temperature_c == pytest.approx(states[1] - START.temperature_c, rel=0.08)


@pytest.mark.parametrize('sensor, silent_s', [
    ('core', ()), ('shell', ((900.0, 1000.0),)), *(
        pytest.param(sensor, (), marks=pytest.mark.deep) for sensor in ('shell', 'mean'))])
def test_the_core_arrives_warm_wherever_the_sensor_is(sensor, silent_s):
    car, hottest_k, errors_k = shell_car(sensor), 0.0, []
    for _, plant, state in supervised(
            car, car, mismatch=Mismatch(heat_capacity=1.05, leakage=0.9, heater=0.95, propulsion_power=1.05),
            sensors=Sensors(temperature_noise_k=0.1, temperature_resolution_k=0.5, drop_outs=silent_s)):
        hottest_k = max(hottest_k, plant.coolant_c - plant.temperature_c)
        errors_k += [] if state.estimate is None else [state.estimate.temperature_c - plant.temperature_c]
    assert max(map(abs, errors_k)) < 2.5
    # The shell has been so much warmer that a battery of one mass would be misjudged.
    assert hottest_k > 8.0
    assert plant.temperature_c == pytest.approx(TARGET_C, abs=1.0)
    assert state.decision.plan.arrival_temperature_c == pytest.approx(plant.temperature_c, abs=1.0)


@pytest.mark.parametrize('sensor', ['core', 'shell'])
def test_a_file_of_one_mass_heats_and_predicts_the_mean_of_shell_and_core(sensor):
    # Slow, and with a third of the battery: on arrival the shell is still much warmer.
    early_c = []
    for time_s, plant, state in supervised(
            with_shell(REFERENCE, 0.33, 250.0, sensor), REFERENCE, 40,
            sensors=Sensors(temperature_noise_k=0.1, temperature_resolution_k=0.5)):
        core_c, mean_c = plant.temperature_c, 0.67 * plant.temperature_c + 0.33 * plant.coolant_c
        if time_s >= 2100.0:
            early_c.append(state.decision.plan.arrival_temperature_c)
    assert mean_c - core_c > 1.0
    assert mean_c == pytest.approx(TARGET_C, abs=0.6)
    assert early_c[0] == pytest.approx(mean_c, abs=0.6)
