# SPDX-License-Identifier: Apache-2.0
"""
Draws the trips of a winter fleet to fast chargers: length, climate, car, charger.

Where the numbers come from is said beside each of them, and in docs/explanation/fleet.md. What has no
source is assumed; results by temperature and trip length depend on it less than those over all trips.
"""

from __future__ import annotations

from bisect import bisect
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
import math
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from bev_preheat.numerics.arithmetic import FLOATS
from bev_preheat.numerics.folded_normal import mean_magnitude
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.road_load import (
    air_density_kg_per_m3,
    battery_power_w,
    GRAVITY_MPS2,
    Load,
    loaded,
    RoadVehicle,
)
from bev_preheat.route.segments import Route
from bev_preheat.route.variation import vary
from bev_preheat.vehicle import load_vehicle, Vehicle

if TYPE_CHECKING:
    from numpy.random import Generator

    from bev_preheat.numerics.arrays import FloatArray

# What is drawn from.
Item = TypeVar('Item')

STEP_S = 60.0
S_PER_MIN, S_PER_H = 60.0, 3600.0
MPS_PER_KMH = 1.0 / 3.6

# The cars of the package and their shares; assumed: each as often.
CARS = {'reference': 0.2, 'large_suv': 0.2, 'mid_size_lfp': 0.2, 'small_hatchback': 0.2, 'small_car': 0.2}
# Chargers [W] and their shares; assumed.
CHARGERS_W = {50e3: 0.3, 150e3: 0.4, 300e3: 0.3}
# Air temperature [deg C]: normal. The mean is that of German winters, 1991-2020 (source: Deutscher
# Wetterdienst, as in br.de, November 2022); assumed: the deviation, of days, nights and places.
AMBIENT_MEAN_C, AMBIENT_DEVIATION_K = 1.4, 5.5
AMBIENT_C = (-25.0, 15.0)
# Driving time to the charger [min]: its logarithm is normal; assumed. No car drives longer than its battery
# carries it.
LENGTH_MEDIAN_MIN, LENGTH_DEVIATION = 55.0, 0.55
LENGTH_MIN = (12.0, 150.0)
# A trip begins with so many minutes in a town and on a country road, the rest is motorway; speeds [km/h]
# and what stop and go adds to the mean power, as a factor. Assumed.
TOWN_MIN, COUNTRY_MIN = 8.0, 12.0
TOWN_KMH, COUNTRY_KMH, MOTORWAY_KMH = 35.0, 75.0, 115.0
TOWN_FACTOR = 1.3
# Drivers differ by this share of the speed; power varies from minute to minute (as in the robustness
# study), and within a minute by the ratio of rms to mean. Assumed.
PACE = (0.9, 1.1)
POWER_VARIABILITY = 0.2
RMS = (1.1, 1.4)
# The battery at the start is warmer than the air by so many kelvin [K], in the open or, for this share
# of the trips, in a garage. Assumed.
SOAK_K, GARAGE_K, GARAGE = (0.0, 6.0), (5.0, 18.0), 0.3
# State of charge with which a driver wants to arrive, about, and leaves. Assumed.
ARRIVAL_SOC, DEPARTURE_SOC, FULL_SOC = (0.08, 0.3), 0.8, 0.97
# The cabin takes so much for each kelvin below 20 degC [W/K]; assumed. At most this share of the heater.
CABIN_W_PER_K, CABIN_C, CABIN_SHARE = 80.0, 20.0, 0.7
# What the circuit loses comes on top of what a trip takes, about.
LOSSES = 1.03
# Of each minute: 0 town, 1 country, 2 motorway; and what is driven there.
ROADS = np.repeat((0, 1, 2), [round(minutes * S_PER_MIN / STEP_S)
                              for minutes in (TOWN_MIN, COUNTRY_MIN, LENGTH_MIN[1] - TOWN_MIN - COUNTRY_MIN)])
SPEEDS_MPS = MPS_PER_KMH * np.array([TOWN_KMH, COUNTRY_KMH, MOTORWAY_KMH])
FACTORS = np.array([TOWN_FACTOR, 1.0, 1.0])


@dataclass(frozen=True)
class FleetTrip:
    """One drawn trip: `car` is one of CARS, `charger_w` one of CHARGERS_W."""

    number: int
    car: str
    charger_w: float
    ambient_c: float
    route: Route
    state: BatteryState
    goal: Goal

    @property
    def length_min(self) -> float:
        """Driving time [min]."""
        return self.route.total_duration_s / S_PER_MIN


@cache
def vehicle_of(car: str) -> Vehicle:
    """Return the Vehicle of one of CARS; always the same object."""
    return load_vehicle(car)


def cabin_heating_power_w(vehicle: Vehicle, ambient_c: float) -> float:
    """Return what the cabin takes of the heater [W] in air of a temperature [deg C]."""
    return float(min(CABIN_W_PER_K * max(0.0, CABIN_C - ambient_c),
                     CABIN_SHARE * vehicle.hvch.maximum_power_w))


def draw_fleet_trip(seed: int, number: int) -> FleetTrip:
    """Return trip `number` of a fleet."""
    random = np.random.default_rng([seed, number])
    car, charger_w = _one_of(random, CARS), _one_of(random, CHARGERS_W)
    vehicle = vehicle_of(car)
    ambient_c = _within(random.normal(AMBIENT_MEAN_C, AMBIENT_DEVIATION_K), AMBIENT_C)
    length_min = _within(LENGTH_MEDIAN_MIN * math.exp(LENGTH_DEVIATION * random.normal()), LENGTH_MIN)
    start_c = ambient_c + random.uniform(*(GARAGE_K if random.uniform() < GARAGE else SOAK_K))
    arrival_soc = random.uniform(*ARRIVAL_SOC)
    steps = round(length_min * S_PER_MIN / STEP_S)
    road = ROADS[:steps]
    speeds_mps = random.uniform(*PACE) * SPEEDS_MPS
    powers_w = FACTORS * _cruising_power_w(car, speeds_mps, ambient_c)
    speed_mps = speeds_mps[road]
    power_w = powers_w[road] * vary(random, steps, 1.0, POWER_VARIABILITY)
    rms = random.uniform(*RMS)
    cabin_w = cabin_heating_power_w(vehicle, ambient_c)
    auxiliary_w = vehicle.defaults.auxiliary_power_w
    used = np.cumsum(LOSSES * (power_w + cabin_w + auxiliary_w)) * STEP_S / S_PER_H / _capacity_wh(car)
    carried = max(1, int(np.searchsorted(used, FULL_SOC - arrival_soc)))
    speed_mps, power_w, used = speed_mps[:carried], power_w[:carried], used[:carried]
    return FleetTrip(
        number, car, charger_w, ambient_c,
        _route(speed_mps, power_w, rms * power_w, ambient_c, cabin_w, auxiliary_w),
        BatteryState(float(start_c), min(float(arrival_soc + used[-1]), FULL_SOC)),
        Goal(vehicle.defaults.target_battery_temperature_c))


def _route(speed_mps: FloatArray, power_w: FloatArray, rms_w: FloatArray, ambient_c: float,
           cabin_w: float, auxiliary_w: float) -> Route:
    """Return a Route; what `make_route` checks holds for all that is drawn here."""
    steps = len(power_w)
    return Route(
        duration_s=np.full(steps, STEP_S), speed_mps=speed_mps, propulsion_power_w=power_w,
        propulsion_power_rms_w=rms_w, ambient_temperature_c=np.full(steps, ambient_c),
        cabin_heating_power_w=np.full(steps, cabin_w), auxiliary_power_w=np.full(steps, auxiliary_w),
        propulsion_power_magnitude_w=mean_magnitude(power_w, rms_w**2 - power_w**2))


def _one_of(random: Generator, shares: dict[Item, float]) -> Item:
    place = bisect(list(accumulate(shares.values())), random.uniform())
    return list(shares)[min(place, len(shares) - 1)]


def _within(value: float, limits: tuple[float, float]) -> float:
    low, high = limits
    return min(max(value, low), high)


def _cruising_power_w(car: str, speed_mps: FloatArray, ambient_c: float) -> FloatArray:
    """Return the drivetrain's electrical power at constant speeds on a level road [W]."""
    on_road = _on_road(car)
    air_n = (0.5 * air_density_kg_per_m3(np.array(ambient_c), np.array(0.0)) * on_road.drag_area_m2
             * speed_mps**2)
    rolling_n = on_road.rolling_resistance * on_road.mass_kg * GRAVITY_MPS2
    return battery_power_w(on_road, (rolling_n + air_n) * speed_mps)


@cache
def _on_road(car: str) -> RoadVehicle:
    return loaded(vehicle_of(car), Load())


@cache
def _capacity_wh(car: str) -> float:
    battery = vehicle_of(car).battery
    return float(battery.capacity_ah * battery.open_circuit_voltage.function(FLOATS)(0.5, 20.0))
