# SPDX-License-Identifier: Apache-2.0
"""Draw random trips: vehicle, route, state and goal, each trip from its own seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator

from bev_preheat.numerics import ARRAYS, Curve, FloatArray
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import make_route, Route
from bev_preheat.simulation.traffic import vary
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.curves import InverseTemperatureResistance, Table
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, ScaledCurve

STEP_S = 30.0
# Approximate voltage, to convert energy to charge when a reserve is drawn.
NOMINAL_VOLTAGE_V = 410.0
# (low, high) of uniform distributions.
DURATION_MIN = (10.0, 120.0)
MEAN_POWER_W = (6e3, 32e3)
AMBIENT_C = (-28.0, 8.0)
SOAK_K = (0.0, 8.0)
SOC = (0.75, 0.98)
TARGET_C = (10.0, 30.0)
SIZE = (0.6, 1.4)
HEATER = (0.7, 1.5)
# Factor on the vehicle's pack limits that keeps every trip far below them.
POWER_LIMITS = 10.0


@dataclass(frozen=True)
class DrawnTrip:
    """A random trip, reproducible from `seed` and `number`."""

    seed: int
    number: int
    vehicle: Vehicle
    route: Route
    state: BatteryState
    goal: Goal


def draw_trip(vehicle: Vehicle, seed: int, number: int) -> DrawnTrip:
    """Return trip `number` of a study, without regeneration and far from the power limits."""
    random = np.random.default_rng([seed, number])
    size = random.uniform(*SIZE)
    scaled = scale_vehicle(vehicle, size, random.uniform(*HEATER), POWER_LIMITS)
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


def draw_limit_trip(vehicle: Vehicle, seed: int, number: int) -> DrawnTrip:
    """
    Return trip `number` of a study in which limits are active.

    Each trip has at least one of: a descent whose power exceeds the cold battery's charging limit, a climb
    whose power exceeds its discharging limit, a tight reserve of charge, a varying cabin share of the heater.
    """
    random = np.random.default_rng([seed, number])
    features = {'descent', 'climb', 'reserve', 'cabin'}
    chosen = {name for name in sorted(features) if random.uniform() < 0.4}
    chosen = chosen or {sorted(features)[number % len(features)]}
    ambient_c = random.uniform(-22.0, 3.0)
    start_c, soc = ambient_c + random.uniform(0.0, 6.0), random.uniform(0.6, 0.95)
    parts = [_cruise(random, 5.0, 50.0)]
    if 'climb' in chosen:
        most_w = float(vehicle.battery.discharge_power_limit.function(ARRAYS)(
            np.asarray(soc), np.asarray(start_c + 3.0)))
        steps = int(random.integers(4, 16))
        parts += [np.full(steps, most_w * random.uniform(0.8, 1.15)),
                  _cruise(random, 3.0, 30.0)]
    if 'descent' in chosen:
        steps = int(random.uniform(5.0, 40.0) * 60.0 / STEP_S)
        parts += [-vary(random, steps, random.uniform(10e3, 60e3), random.uniform(0.0, 0.15)),
                  _cruise(random, 5.0, 40.0)]
    power_w = np.concatenate(parts)
    steps = len(power_w)
    cabin_w = np.full(steps, random.uniform(500.0, 3000.0))
    if 'cabin' in chosen:
        # The cabin's demand varies, up to the heater's full power.
        cabin_w = np.repeat(random.uniform(200.0, 8000.0, size=steps // 8 + 1), 8)[:steps]
    route = make_route({
        'duration_s': np.full(steps, STEP_S),
        'speed_mps': np.clip(34.0 * np.cbrt(np.abs(power_w) / 40e3), 5.0, 40.0),
        'propulsion_power_w': power_w,
        'propulsion_power_rms_w': np.abs(power_w) * random.uniform(1.0, 1.2),
        'ambient_temperature_c': np.full(steps, ambient_c),
        'cabin_heating_power_w': cabin_w,
        'auxiliary_power_w': np.full(steps, random.uniform(200.0, 800.0)),
    }, vehicle.defaults)
    state = BatteryState(float(start_c), float(soc))
    reserve = 0.0
    if 'reserve' in chosen:
        used = float(np.sum(power_w + cabin_w) * STEP_S) / (
            vehicle.battery.capacity_as * NOMINAL_VOLTAGE_V)
        reserve = float(np.clip(soc - used - random.uniform(-0.01, 0.05), 0.0, 1.0))
    return DrawnTrip(seed, number, vehicle, route, state,
                     Goal(float(random.uniform(5.0, 30.0)), reserve))


def _cruise(random: Generator, shortest_min: float, longest_min: float) -> FloatArray:
    steps = int(random.uniform(shortest_min, longest_min) * 60.0 / STEP_S)
    return vary(random, steps, random.uniform(6e3, 30e3), random.uniform(0.0, 0.4))


def scale_vehicle(vehicle: Vehicle, size: float, heater: float, power_limits: float) -> Vehicle:
    """Return the vehicle with pack size, heater and limits multiplied by these factors."""
    resistance = vehicle.battery.resistance
    scaled = corrected_vehicle(vehicle, Corrections(size, size**(2.0 / 3.0)))
    battery = scaled.battery
    return replace(
        scaled,
        battery=replace(
            battery, capacity_ah=battery.capacity_ah * size,
            resistance=replace(resistance, k_ohm_k=resistance.k_ohm_k / size)
            if isinstance(resistance, InverseTemperatureResistance) else ScaledCurve(resistance, 1.0 / size),
            discharge_power_limit=_scale_table(battery.discharge_power_limit, power_limits),
            charge_power_limit=_scale_table(battery.charge_power_limit, power_limits)),
        hvch=replace(scaled.hvch, maximum_power_w=scaled.hvch.maximum_power_w * heater))


def _scale_table(table: Curve, factor: float) -> Table:
    if not isinstance(table, Table):
        raise TypeError('only a vehicle whose power limits are tables can be scaled')
    return replace(table, values=tuple(
        tuple(factor * value for value in row) for row in table.values))


# The choices of `preheat sweep --trips`: draw(vehicle, seed, number).
DRAWS: dict[str, Callable[[Vehicle, int, int], DrawnTrip]] = {
    'free': draw_trip, 'limits': draw_limit_trip}
