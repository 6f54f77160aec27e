# SPDX-License-Identifier: Apache-2.0
"""Random cars, trips, states and goals for comparing the native core with Python."""

from dataclasses import replace
from functools import cache

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal, Uncertainty
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.core_library import without_core
from bev_preheat.vehicle.description import HeatPath
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, with_shell

# Curves of the first are formulas, with tables of limits; of the second, tables.
CARS = ('reference', 'mid_size_lfp')
PATHS = (HeatPath(), HeatPath(), HeatPath(), HeatPath(35.0), HeatPath(0.0, 14e3, 320.0),
         HeatPath(45.0, 16e3, 280.0))


def in_both(make):
    """Return the results of a function with the native core and without it."""
    found = make()
    with without_core():
        return found, make()


@cache
def car(name):
    return load_vehicle(name)


def draw(number, most_steps):
    """Return (vehicle, route, state, goal, method, uncertainty) of situation `number`, some extreme."""
    random = np.random.default_rng([15, number])
    described = car(CARS[int(random.integers(2))])
    vehicle = replace(
        corrected_vehicle(described, Corrections(*random.uniform(0.8, 1.2, 4).tolist())),
        heat_path=PATHS[int(random.integers(len(PATHS)))])
    steps = int(random.integers(3, most_steps + 1))
    power_w = random.uniform(0.0, 30e3) + random.uniform(0.0, 25e3) * random.standard_normal(steps)
    if number % 7 == 0:
        vehicle = replace(vehicle, heat_path=HeatPath(vehicle.heat_path.heater_lag_s))
        vehicle = with_shell(vehicle, 0.25, 400.0, 'core')
    if random.random() < 0.5:
        # A climb, then a descent, at the limits of a cold battery and beyond.
        first, last = sorted(random.integers(0, steps, 2).tolist())
        power_w[:first] += random.uniform(0.0, 90e3)
        power_w[first:last] -= random.uniform(0.0, 60e3)
    ambient_c = float(random.uniform(-28.0, 12.0))
    route = make_route({
        'duration_s': random.uniform(20.0, 150.0, steps),
        'speed_mps': random.uniform(0.0, 36.0, steps),
        'propulsion_power_w': power_w,
        'propulsion_power_rms_w': np.abs(power_w) * random.uniform(1.0, 1.4),
        'ambient_temperature_c': np.full(steps, ambient_c),
        'cabin_heating_power_w': np.full(steps, random.uniform(0.0, 4e3)),
        'auxiliary_power_w': np.full(steps, random.uniform(200.0, 900.0)),
    }, vehicle.defaults)
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    state = BatteryState(
        float(np.clip(ambient_c + random.uniform(0.0, 25.0), lowest_c, highest_c)),
        float(random.uniform(0.03, 1.0)), float(random.uniform(0.0, 3e3)), float(random.uniform(0.0, 6.0)))
    goal = Goal(float(random.uniform(5.0, min(40.0, highest_c))), float(random.choice([0.0, 0.2, 0.6])),
                heating_pays=bool(random.random() < 0.9))
    method = ('value_function', 'optimal_switch', 'paper')[int(random.choice(3, p=[0.7, 0.2, 0.1]))]
    uncertainty = None if random.random() < 0.5 else Uncertainty(
        float(random.uniform(0.02, 2.0)), bool(random.random() < 0.5))
    return vehicle, route, state, goal, method, uncertainty


def draw_without_limits(number):
    """Return (vehicle, route, state, goal) of situation `number`; the battery's limits are mostly not active."""
    random = np.random.default_rng([29, number])
    steps = int(random.integers(2, 40))
    vehicle = car(CARS[int(random.integers(2))])
    route = make_route({
        'duration_s': random.uniform(20.0, 400.0, steps), 'speed_mps': random.uniform(0.0, 33.0, steps),
        'propulsion_power_w': random.uniform(-500.0, 18e3, steps),
        'ambient_temperature_c': random.uniform(-15.0, 5.0, steps),
        'cabin_heating_power_w': random.choice([0.0, 1500.0, 7e3], steps, p=[0.1, 0.85, 0.05]),
        'auxiliary_power_w': [350.0]}, vehicle.defaults)
    goal = Goal(float(random.uniform(-2.0, 25.0)), float(random.choice([0.0, 0.3, 0.6])),
                charging_planned=bool(random.random() < 0.9), heating_pays=bool(random.random() < 0.9))
    return vehicle, route, BatteryState(float(random.uniform(0.0, 10.0)), float(random.uniform(0.4, 0.95))), goal


def draw_uncertainty(number):
    """Return an Uncertainty, and the heater's share and lag [s], of situation `number`."""
    random = np.random.default_rng([30, number])
    uncertainty = Uncertainty(
        float(random.choice([1e-4, 0.1, 1.0, 4.0]) * random.uniform(0.2, 1.0)), bool(random.random() < 0.3))
    return uncertainty, float(random.choice([1.0, 1.0, 0.6])), float(random.choice([0.0, 40.0, 400.0]))
