# SPDX-License-Identifier: Apache-2.0
"""Draw the trips of a winter fleet, one block at a time, in arrays."""

from __future__ import annotations

from functools import cache
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.numerics.factors import S_PER_H, S_PER_MIN
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.route.road_load import (
    air_density_kg_per_m3,
    battery_power_w,
    GRAVITY_MPS2,
    loaded,
    RoadForces,
    RoadVehicle,
)
from bev_preheat.route.variation import vary_each
from bev_preheat_studies.fleet.drawn_fleet import (
    AMBIENT_C,
    AMBIENT_DEVIATION_K,
    AMBIENT_MEAN_C,
    ARRIVAL_SOC,
    BLOCK,
    cabin_heating_power_w,
    CARS,
    CHARGERS_W,
    FACTORS,
    FleetTrips,
    FULL_SOC,
    GARAGE,
    GARAGE_K,
    LENGTH_DEVIATION,
    LENGTH_MEDIAN_MIN,
    LENGTH_MIN,
    LOSSES,
    PACE,
    POWER_VARIABILITY,
    RMS,
    ROADS,
    SOAK_K,
    SPEEDS_MPS,
    STEP_S,
    vehicle_of,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.random import Generator
    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import FloatArray

    IntArray = NDArray[np.int64]


def draw_fleet(seed: int, block: int, size: int = BLOCK) -> FleetTrips:
    """Return the first `size` trips of a block, whose first trip is number `block` * BLOCK."""
    # Always draw the whole block: a trip must not depend on the size of the fleet.
    random = np.random.default_rng([seed, block])
    car, charger = _one_of(random, CARS), _one_of(random, CHARGERS_W)
    order = np.lexsort((charger, car))
    car, charger_w = car[order], np.array(list(CHARGERS_W))[charger[order]]
    ambient_c = np.clip(random.normal(AMBIENT_MEAN_C, AMBIENT_DEVIATION_K, BLOCK), *AMBIENT_C)
    length_min = np.clip(
        LENGTH_MEDIAN_MIN * np.exp(LENGTH_DEVIATION * random.normal(size=BLOCK)), *LENGTH_MIN)
    start_c = ambient_c + np.where(random.uniform(size=BLOCK) < GARAGE, random.uniform(*GARAGE_K, BLOCK),
                                   random.uniform(*SOAK_K, BLOCK))
    arrival_soc = random.uniform(*ARRIVAL_SOC, BLOCK)
    rms = random.uniform(*RMS, BLOCK)
    speeds_mps = random.uniform(*PACE, (BLOCK, 1)) * SPEEDS_MPS
    cruising_w, side_w, capacity_wh = np.empty_like(speeds_mps), np.empty(BLOCK), np.empty(BLOCK)
    for number, name in enumerate(CARS):
        of_car, vehicle = car == number, vehicle_of(name)
        cruising_w[of_car] = FACTORS * _cruising_power_w(
            name, speeds_mps[of_car], ambient_c[of_car, np.newaxis])
        side_w[of_car] = cabin_heating_power_w(vehicle, ambient_c[of_car]) + vehicle.defaults.auxiliary_power_w
        capacity_wh[of_car] = _capacity_wh(name)
    steps = np.rint(length_min * S_PER_MIN / STEP_S).astype(np.int64)
    trip = np.repeat(np.arange(BLOCK), steps)
    first = np.cumsum(steps) - steps
    place = np.arange(len(trip)) - first[trip]
    road = trip, ROADS[place]
    power_w = cruising_w[road] * vary_each(random, steps, POWER_VARIABILITY)
    taken = np.cumsum(LOSSES * STEP_S / S_PER_H * (power_w + side_w[trip]) / capacity_wh[trip])
    used = taken - np.concatenate(([0.0], taken))[first][trip]
    # No trip is longer than the car's range.
    carried = np.maximum(1, np.add.reduceat((used < (FULL_SOC - arrival_soc)[trip]).astype(np.int64), first))
    is_driven = place < carried[trip]
    trip, power_w = trip[is_driven], power_w[is_driven]
    trips = FleetTrips(
        block * BLOCK + order, car, charger_w, ambient_c, start_c,
        np.minimum(arrival_soc + used[first + carried - 1], FULL_SOC), carried,
        speeds_mps[road][is_driven], power_w, rms[trip] * power_w,
        mean_magnitude(1.0, rms**2 - 1.0)[trip] * power_w)
    return trips if size == BLOCK else trips.up_to(block * BLOCK + size)


def _one_of(random: Generator, shares: Mapping[Any, float]) -> IntArray:
    """Return indices into `shares`, drawn with these probabilities, (BLOCK,)."""
    below = np.cumsum(list(shares.values()))[:-1]
    return np.searchsorted(below, random.uniform(size=BLOCK), side='right')


def _cruising_power_w(car: str, speed_mps: FloatArray, ambient_c: FloatArray) -> FloatArray:
    """Return the drivetrain's electrical power at constant speeds on a level road [W]."""
    on_road = _on_road(car)
    air_n = (0.5 * air_density_kg_per_m3(ambient_c, np.array(0.0)) * on_road.drag_area_m2
             * speed_mps**2)
    rolling_n = on_road.rolling_resistance * on_road.mass_kg * GRAVITY_MPS2
    return battery_power_w(on_road, (rolling_n + air_n) * speed_mps)


@cache
def _on_road(car: str) -> RoadVehicle:
    return loaded(vehicle_of(car), RoadForces())


@cache
def _capacity_wh(car: str) -> float:
    battery = vehicle_of(car).battery
    return float(battery.capacity_ah * battery.open_circuit_voltage.function(FLOATS)(0.5, 20.0))
