# SPDX-License-Identifier: Apache-2.0
"""
The trips of a winter fleet to fast chargers, and their distributions: length, climate, car, charger.

The source of each number is in its comment. Numbers without a source are
assumed; results by temperature and trip length depend on them less than results over all trips.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.factors import S_PER_MIN
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route.segments import Route
from bev_preheat.vehicle import load_vehicle, Vehicle

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import FloatArray

    IntArray = NDArray[np.int64]

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
TOWN_MIN, COUNTRY_MIN = 8.0, 12.0
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
# Road in each minute: 0 town, 1 country, 2 motorway; speed and power factor of each road.
ROADS = np.repeat((0, 1, 2), [round(minutes * S_PER_MIN / STEP_S)
                              for minutes in (TOWN_MIN, COUNTRY_MIN, LENGTH_MIN[1] - TOWN_MIN - COUNTRY_MIN)])
SPEEDS_MPS = MPS_PER_KMH * np.array([TOWN_KMH, COUNTRY_KMH, MOTORWAY_KMH])
FACTORS = np.array([TOWN_FACTOR, 1.0, 1.0])


# Trips in a block; each block has its own random numbers.
BLOCK = 4000


@dataclass(frozen=True)
class FleetTrip:
    """A drawn trip; `car` is in CARS, `charger_w` in CHARGERS_W."""

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
    K drawn trips, sorted by car, then by charger power.

    `number`, `car` (index into CARS), `charger_w`, `ambient_c`, temperature and charge at the start and `steps`
    have shape (K,). The arrays over steps hold all trips one after the other, (sum of `steps`,).
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
        """Index of each trip's first step, and of the end of the last trip, (K + 1,)."""
        return np.concatenate(([0], np.cumsum(self.steps)))

    def plugs(self) -> Iterator[tuple[str, float, slice]]:
        """Return each car and charger [W] with the slice of its trips."""
        for number, car in enumerate(CARS):
            for charger_w in CHARGERS_W:
                places = np.flatnonzero((self.car == number) & (self.charger_w == charger_w))
                if len(places):
                    yield car, charger_w, slice(int(places[0]), int(places[-1]) + 1)

    def cars(self) -> Iterator[tuple[str, slice]]:
        """Return each car with the slice of its trips."""
        for number, car in enumerate(CARS):
            places = np.flatnonzero(self.car == number)
            if len(places):
                yield car, slice(int(places[0]), int(places[-1]) + 1)

    def route(self, places: slice) -> Route:
        """Return consecutive trips of one car as one Route, which satisfies the checks of `make_route`."""
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
        """Return the trip at this index."""
        car = list(CARS)[self.car[place]]
        return FleetTrip(
            int(self.number[place]), car, float(self.charger_w[place]), float(self.ambient_c[place]),
            self.route(slice(place, place + 1)),
            BatteryState(float(self.start_c[place]), float(self.start_soc[place])), goal_of(car))

    def up_to(self, number: int) -> FleetTrips:
        """Return the trips whose number is below `number`."""
        is_kept = self.number < number
        of_steps = np.repeat(is_kept, self.steps)
        return FleetTrips(**{field.name: getattr(self, field.name)[
            of_steps if field.name in OF_STEPS else is_kept] for field in fields(self)})


OF_STEPS = frozenset(('speed_mps', 'power_w', 'rms_w', 'magnitude_w'))


@cache
def vehicle_of(car: str) -> Vehicle:
    """Return the Vehicle of a car in CARS; always the same object."""
    return load_vehicle(car)


def goal_of(car: str) -> Goal:
    """Return the Goal of every trip of a car in CARS: its default target."""
    return Goal(vehicle_of(car).defaults.target_battery_temperature_c)


def cabin_heating_power_w(vehicle: Vehicle, ambient_c: FloatArray | float) -> FloatArray:
    """Return the heater power that the cabin takes at an air temperature [deg C]; shape of the input."""
    return np.asarray(np.minimum(CABIN_W_PER_K * np.maximum(0.0, CABIN_C - ambient_c),
                                 CABIN_SHARE * vehicle.hvch.maximum_power_w), dtype=float)
