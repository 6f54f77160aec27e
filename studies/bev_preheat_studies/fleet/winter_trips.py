# SPDX-License-Identifier: Apache-2.0
"""
The trips of a winter fleet to fast chargers, and their distributions: length, climate, car, charger.

The source of each number is in its comment. Numbers without a source are
assumed; results by temperature and trip length depend on them less than results over all trips.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
import math

import numpy as np

from bev_preheat.charging.stop import ChargingStop
from bev_preheat.numerics import FLOATS, S_PER_H
from bev_preheat.planning.maker_rules import MAKER_RULES
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.road_load import air_density_kg_per_m3, battery_power_w, GRAVITY_MPS2, road_load_of
from bev_preheat.route.segments import make_route, Route
from bev_preheat.simulation.traffic import vary
from bev_preheat.vehicle import load_vehicle, Vehicle

# The ways to heat a trip.
NONE, ALWAYS, USUAL, BEST = 'no_heating', 'always_on', 'usual_target', 'best_target'
WAYS = (NONE, ALWAYS, *MAKER_RULES, USUAL, BEST)
# Edges of the groups of trips.
AMBIENT_EDGES_C = (-10.0, -5.0, 0.0, 5.0)
LENGTH_EDGES_MIN = (30.0, 60.0, 90.0)
STEP_S = 60.0
MPS_PER_KMH = 1.0 / 3.6
# The cars of the package and their shares; assumed: equal.
CARS = {'reference': 0.2, 'large_suv': 0.2, 'mid_size_lfp': 0.2, 'small_hatchback': 0.2, 'small_car': 0.2}
# Chargers [W] and their shares; assumed.
CHARGERS_W = {50e3: 0.3, 150e3: 0.4, 300e3: 0.3}
# Air temperature [deg C]: normal. The mean is that of German winters, 1991-2020 (source: Deutscher
# Wetterdienst, as in br.de, November 2022); assumed: the deviation, of days, nights and places.
AMBIENT_MEAN_C, AMBIENT_DEVIATION_K = 1.4, 5.5
AMBIENT_C = (-25.0, 15.0)
# Driving time to the charger [min]: lognormal; assumed. No trip is longer than the car's range.
LENGTH_MEDIAN_MIN, LENGTH_DEVIATION = 55.0, 0.55
LENGTH_MIN = (12.0, 150.0)
# Each trip starts with these minutes in town and on a country road; the rest is motorway. Speeds [km/h], and the
# factor by which stop-and-go raises the mean power. Assumed.
TOWN_MIN, COUNTRY_MIN = 8, 12
TOWN_KMH, COUNTRY_KMH, MOTORWAY_KMH = 35.0, 75.0, 115.0
TOWN_FACTOR = 1.3
# Factor on the speed, by driver; variation of the power from minute to minute (as in the robustness study);
# ratio of rms to mean power within a minute. Assumed.
PACE = (0.9, 1.1)
POWER_VARIABILITY = 0.2
RMS = (1.1, 1.4)
# Battery above air temperature at the start [K]: parked outdoors or, for a share of GARAGE of the trips, in a
# garage. Assumed.
SOAK_K, GARAGE_K, GARAGE = (0.0, 6.0), (5.0, 18.0), 0.3
# State of charge: approximate goal on arrival, at departure from the charger, highest at the start. Assumed.
ARRIVAL_SOC, DEPARTURE_SOC, FULL_SOC = (0.08, 0.3), 0.8, 0.97
# Cabin heating for each kelvin below 20 degC [W/K]; assumed. At most this share of the heater's power.
CABIN_W_PER_K, CABIN_C, CABIN_SHARE = 80.0, 20.0, 0.7
# Approximate factor for losses in the circuit on the energy of a trip.
LOSSES = 1.03


def _intervals(edges: Sequence[float], unit: str) -> list[tuple[str, float, float]]:
    """Return the name and bounds of the intervals between edges."""
    return [(f'below {edges[0]:g} {unit}', -math.inf, edges[0]),
            *((f'{low:g} to {high:g} {unit}', low, high) for low, high in zip(edges, edges[1:])),
            (f'from {edges[-1]:g} {unit}', edges[-1], math.inf)]


AMBIENTS, LENGTHS = _intervals(AMBIENT_EDGES_C, 'degC'), _intervals(LENGTH_EDGES_MIN, 'min')


@dataclass(frozen=True)
class WinterTrip:
    """A drawn trip of a car in CARS; reproducible from seed and number."""

    car: str
    vehicle: Vehicle
    ambient_c: float
    route: Route
    state: BatteryState
    goal: Goal
    stop: ChargingStop


def draw_winter_trip(seed: int, number: int) -> WinterTrip:
    """Return trip `number` of a fleet."""
    random = np.random.default_rng([seed, number])
    car = str(random.choice(list(CARS), p=list(CARS.values())))
    charger_w = float(random.choice(list(CHARGERS_W), p=list(CHARGERS_W.values())))
    vehicle = _vehicle(car)
    ambient_c = float(np.clip(random.normal(AMBIENT_MEAN_C, AMBIENT_DEVIATION_K), *AMBIENT_C))
    length_min = float(np.clip(LENGTH_MEDIAN_MIN * np.exp(LENGTH_DEVIATION * random.normal()), *LENGTH_MIN))
    start_c = ambient_c + random.uniform(*(GARAGE_K if random.uniform() < GARAGE else SOAK_K))
    arrival_soc = random.uniform(*ARRIVAL_SOC)
    minutes = round(length_min)
    roads = np.repeat((0, 1, 2), (TOWN_MIN, COUNTRY_MIN, minutes))[:minutes]
    speed_mps = MPS_PER_KMH * random.uniform(*PACE) * np.array([TOWN_KMH, COUNTRY_KMH, MOTORWAY_KMH])
    power_w = (_cruising_power_w(vehicle, speed_mps, ambient_c) * (TOWN_FACTOR, 1.0, 1.0))[roads]
    power_w = power_w * vary(random, minutes, 1.0, POWER_VARIABILITY)
    cabin_w = min(CABIN_W_PER_K * max(0.0, CABIN_C - ambient_c), CABIN_SHARE * vehicle.hvch.maximum_power_w)
    auxiliary_w, battery = vehicle.defaults.auxiliary_power_w, vehicle.battery
    capacity_wh = battery.capacity_ah * battery.open_circuit_voltage.function(FLOATS)(0.5, 20.0)
    used = np.cumsum(LOSSES * STEP_S / S_PER_H * (power_w + cabin_w + auxiliary_w)) / capacity_wh
    # No trip is longer than the car's range.
    steps = max(1, int(np.searchsorted(used, FULL_SOC - arrival_soc)))
    route = make_route({
        'duration_s': np.full(steps, STEP_S), 'speed_mps': speed_mps[roads][:steps],
        'propulsion_power_w': power_w[:steps], 'propulsion_power_rms_w': random.uniform(*RMS) * power_w[:steps],
        'ambient_temperature_c': [ambient_c], 'cabin_heating_power_w': [cabin_w],
        'auxiliary_power_w': [auxiliary_w]}, vehicle.defaults)
    return WinterTrip(
        car, vehicle, ambient_c, route, BatteryState(start_c, min(arrival_soc + float(used[steps - 1]), FULL_SOC)),
        Goal(vehicle.defaults.target_battery_temperature_c),
        ChargingStop(charger_w, DEPARTURE_SOC, ambient_c, cabin_w, auxiliary_w))


@cache
def _vehicle(car: str) -> Vehicle:
    return load_vehicle(car)


def _cruising_power_w(vehicle: Vehicle, speed_mps: np.ndarray, ambient_c: float) -> np.ndarray:
    """Return the drivetrain's electrical power at constant speeds on a level road [W]."""
    road_load = road_load_of(vehicle)
    air_n = 0.5 * air_density_kg_per_m3(np.array(ambient_c), np.array(0.0)) * road_load.drag_area_m2 * speed_mps**2
    return np.asarray(battery_power_w(
        vehicle, (road_load.rolling_resistance * road_load.mass_kg * GRAVITY_MPS2 + air_n) * speed_mps))
