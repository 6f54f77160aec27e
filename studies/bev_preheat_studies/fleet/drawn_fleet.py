# SPDX-License-Identifier: Apache-2.0
"""
The trips of a winter fleet to fast chargers, and what they are drawn from: length, climate, car, charger.

Where the numbers come from is said beside each of them, and in docs/explanation/fleet.md. What has no
source is assumed; results by temperature and trip length depend on it less than those over all trips.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import load_vehicle, Vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import FloatArray

    IntArray = NDArray[np.int64]

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


# Trips are drawn in blocks of so many, each from its own numbers.
BLOCK = 4000


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


@dataclass(frozen=True)
class FleetTrips:
    """
    K drawn trips, those of one car behind each other, of these those to chargers of one power.

    `number`, `car` (a place in CARS), `charger_w`, `ambient_c`, temperature and charge at the start and `steps`
    have shape (K,); what is driven in each step, trip behind trip, (sum of `steps`,).
    """

    number: IntArray
    car: IntArray
    charger_w: FloatArray
    ambient_c: FloatArray
    start_c: FloatArray
    start_soc: FloatArray
    steps: IntArray
    speed_mps: FloatArray
    power_w: FloatArray
    rms_w: FloatArray
    magnitude_w: FloatArray

    def __len__(self) -> int:
        """Return K."""
        return len(self.number)

    @property
    def length_min(self) -> FloatArray:
        """Driving times [min], (K,)."""
        return np.asarray(self.steps * (STEP_S / S_PER_MIN), dtype=np.float64)

    @cached_property
    def first_step(self) -> IntArray:
        """Where each trip begins among the steps, and where the last one ends, (K + 1,)."""
        return np.concatenate(([0], np.cumsum(self.steps)))

    def plugs(self) -> Iterator[tuple[str, float, slice]]:
        """Return each car and charger [W] with the places of its trips."""
        for number, car in enumerate(CARS):
            for charger_w in CHARGERS_W:
                places = np.flatnonzero((self.car == number) & (self.charger_w == charger_w))
                if len(places):
                    yield car, charger_w, slice(int(places[0]), int(places[-1]) + 1)

    def cars(self) -> Iterator[tuple[str, slice]]:
        """Return each car with the places of its trips."""
        for number, car in enumerate(CARS):
            places = np.flatnonzero(self.car == number)
            if len(places):
                yield car, slice(int(places[0]), int(places[-1]) + 1)

    def route(self, places: slice) -> Route:
        """Return trips of one car behind each other as one Route; what `make_route` checks holds for it."""
        vehicle = vehicle_of(list(CARS)[self.car[places.start]])
        of_steps = slice(self.first_step[places.start], self.first_step[places.stop])
        ambient_c = np.repeat(self.ambient_c[places], self.steps[places])
        return Route(
            duration_s=np.full(len(ambient_c), STEP_S), speed_mps=self.speed_mps[of_steps],
            propulsion_power_w=self.power_w[of_steps], propulsion_power_rms_w=self.rms_w[of_steps],
            ambient_temperature_c=ambient_c, cabin_heating_power_w=cabin_heating_power_w(vehicle, ambient_c),
            auxiliary_power_w=np.full(len(ambient_c), vehicle.defaults.auxiliary_power_w),
            propulsion_power_magnitude_w=self.magnitude_w[of_steps])

    def trip(self, place: int) -> FleetTrip:
        """Return one of the trips."""
        car = list(CARS)[self.car[place]]
        return FleetTrip(
            int(self.number[place]), car, float(self.charger_w[place]), float(self.ambient_c[place]),
            self.route(slice(place, place + 1)),
            BatteryState(float(self.start_c[place]), float(self.start_soc[place])), goal_of(car))

    def up_to(self, number: int) -> FleetTrips:
        """Return the trips whose number is below this one."""
        is_kept = self.number < number
        of_steps = np.repeat(is_kept, self.steps)
        return FleetTrips(**{field.name: getattr(self, field.name)[
            of_steps if field.name in OF_STEPS else is_kept] for field in fields(self)})


OF_STEPS = frozenset(('speed_mps', 'power_w', 'rms_w', 'magnitude_w'))


@cache
def vehicle_of(car: str) -> Vehicle:
    """Return the Vehicle of one of CARS; always the same object."""
    return load_vehicle(car)


def goal_of(car: str) -> Goal:
    """Return what the driver of one of CARS is to find on arrival: the car's default target."""
    return Goal(vehicle_of(car).defaults.target_battery_temperature_c)


def cabin_heating_power_w(vehicle: Vehicle, ambient_c: FloatArray | float) -> FloatArray:
    """Return what the cabin takes of the heater [W] in air of a temperature [deg C]; shape of the input."""
    return np.asarray(np.minimum(CABIN_W_PER_K * np.maximum(0.0, CABIN_C - ambient_c),
                                 CABIN_SHARE * vehicle.hvch.maximum_power_w), dtype=float)
