# SPDX-License-Identifier: Apache-2.0
"""Draws random trips: vehicle, route, state and goal, each from its own seed."""

from dataclasses import dataclass, replace

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route, Route
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance

STEP_S = 30.0
# (low, high) of what is drawn evenly.
DURATION_MIN = (10.0, 120.0)
MEAN_POWER_W = (6e3, 32e3)
AMBIENT_C = (-28.0, 8.0)
SOAK_K = (0.0, 8.0)
SOC = (0.75, 0.98)
TARGET_C = (10.0, 30.0)
SIZE = (0.6, 1.4)
HEATER = (0.7, 1.5)


@dataclass(frozen=True)
class DrawnTrip:
    """One random trip; `seed` and `number` make it again."""

    seed: int
    number: int
    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal


def draw_trip(vehicle, seed, number):
    """Return trip `number` of a study, without regeneration and far from the power limits."""
    random = np.random.default_rng([seed, number])
    size = random.uniform(*SIZE)
    scaled = scale_vehicle(vehicle, size, random.uniform(*HEATER))
    steps = int(random.uniform(*DURATION_MIN) * 60.0 / STEP_S)
    ambient_c = random.uniform(*AMBIENT_C)
    power_w = vary(random, steps, size * random.uniform(*MEAN_POWER_W), random.uniform(0.0, 0.6))
    route = make_route({
        'duration_s': np.full(steps, STEP_S),
        'speed_mps': 34.0 * np.cbrt(power_w / (size * 40e3)),
        'propulsion_power_w': power_w,
        'propulsion_power_rms_w': power_w * random.uniform(1.0, 1.5),
        'ambient_temperature_c': ambient_c + vary(random, steps, 1.0, 0.5),
        'cabin_heating_power_w': np.full(steps, random.uniform(500.0, 3000.0)),
        'auxiliary_power_w': np.full(steps, random.uniform(200.0, 800.0)),
    }, scaled.defaults)
    state = BatteryState(float(ambient_c + random.uniform(*SOAK_K)), float(random.uniform(*SOC)))
    return DrawnTrip(seed, number, scaled, route, state, Goal(float(random.uniform(*TARGET_C))))


def vary(random, steps, mean, variability):
    """Return a positive series that wanders about its mean, as traffic does, shape (steps,)."""
    noise = random.normal(size=steps)
    smooth = np.convolve(noise, np.full(5, 1.0 / np.sqrt(5.0)), mode='same')
    return mean * np.exp(variability * smooth - 0.5 * variability**2)


def scale_vehicle(vehicle, size, heater):
    """Return the vehicle with another pack size and heater, as multiples of its own."""
    battery = vehicle.battery
    resistance = battery.resistance
    if not isinstance(resistance, InverseTemperatureResistance):
        raise TypeError('only a vehicle whose resistance is a formula can be scaled')
    return replace(
        vehicle,
        battery=replace(
            battery,
            capacity_ah=battery.capacity_ah * size,
            heat_capacity_j_per_k=battery.heat_capacity_j_per_k * size,
            resistance=replace(resistance, k_ohm_k=resistance.k_ohm_k / size),
            leakage=replace(
                battery.leakage,
                gamma_0_w_per_k=battery.leakage.gamma_0_w_per_k * size**(2.0 / 3.0),
                gamma_v_w_per_k_per_mps=(
                    battery.leakage.gamma_v_w_per_k_per_mps * size**(2.0 / 3.0)))),
        hvch=replace(vehicle.hvch, maximum_power_w=vehicle.hvch.maximum_power_w * heater))
