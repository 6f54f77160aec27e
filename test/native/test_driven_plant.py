# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle driven by the core and by Python."""

from dataclasses import replace

import drawn_situations
import numpy as np
import pytest

from bev_preheat.native.library import core, without_core
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route
from bev_preheat.simulation.vehicle_plant import VehiclePlant
from bev_preheat.vehicle.heat_path import HeatPath

PATHS = (HeatPath(), HeatPath(heater_lag_s=33.0), HeatPath(0.0, 17e3, 460.0), HeatPath(21.0, 9e3, 710.0, 55.0),
         HeatPath(sensor_lag_s=80.0))
NUMBERS = 120


@pytest.fixture(autouse=True)
def _core():
    if core() is None:
        pytest.skip('bev_preheat_core is not built')


def drawn(number):
    """Return a vehicle, a route and the initial state; some batteries are too weak or run empty."""
    random = np.random.default_rng([61, number])
    car = drawn_situations.car(drawn_situations.CARS[number % len(drawn_situations.CARS)])
    vehicle = replace(car, heat_path=PATHS[number % len(PATHS)])
    steps = int(random.integers(1, 25))
    mean_w = random.uniform(-60e3, 90e3, steps) * random.choice([1.0, 1.0, 4.0])
    route = make_route({
        'duration_s': random.uniform(0.3, 40.0, steps), 'speed_mps': random.uniform(0.0, 40.0, steps),
        'propulsion_power_w': mean_w, 'propulsion_power_rms_w': np.abs(mean_w) * random.uniform(1.0, 1.5, steps),
        'ambient_temperature_c': random.uniform(-20.0, 30.0, steps),
        'cabin_heating_power_w': random.uniform(0.0, 9e3, steps), 'auxiliary_power_w': [430.0]}, vehicle.defaults)
    state = BatteryState(float(random.uniform(-15.0, 35.0)), float(random.choice([
        random.uniform(0.2, 1.0), random.uniform(0.0, 0.01)])), float(random.uniform(0.0, 3e3)), 4.0)
    return VehiclePlant(vehicle, route, state), random


def driven(number):
    """Return the plant's state after each of many intervals of heater power."""
    plant, random = drawn(number)
    seen = []
    while plant.time_s < plant.duration_s + 5.0:
        plant.advance(plant.time_s + float(random.choice([1.0, 0.25, random.uniform(0.0, 90.0)])),
                      float(random.choice([0.0, random.uniform(0.0, 8e3)])))
        seen.append([
            plant.time_s, plant.soc, plant.temperature_c, plant.sensor_c, plant.coolant_c, plant.heater_power_w,
            plant.brake_power_w, plant.undeliverable_power_w, plant.empty_at_s, plant.has_arrived,
            *vars(plant.energy_wh).values(), plant.undeliverable_energy_wh, plant.friction_brake_energy_wh,
            plant.terminal_voltage_v, plant.current_a])
    return seen


def test_it_is_the_same_to_the_last_bit():
    deficit = empty = 0
    for number in range(NUMBERS):
        found = driven(number)
        with without_core():
            expected = driven(number)
        assert found == expected, number
        deficit += expected[-1][7] > 0.0
        empty += expected[-1][8] is not None
    # Cases that the core leaves to Python are included.
    assert deficit > 5 and empty > 5 and deficit + empty < 2 * NUMBERS


def test_the_core_drives_all_the_way_as_a_rule(monkeypatch):
    plant, _ = drawn(0)
    plant.soc = 0.7
    monkeypatch.setattr(plant, '_drive_within_segment', lambda *_: pytest.fail('driven in Python'))
    plant.advance(plant.duration_s, 900.0)
    assert plant.has_arrived
