# SPDX-License-Identifier: Apache-2.0
"""
Heat K drawn trips in each way: the native core plans all trips of a car in one call.

The fallback and the reference is `ways.arrivals_of`, trip by trip. It also handles each trip on which a limit
is active.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.calls import ALWAYS_ON, ONE_SWITCH, PAPER, plan_trips, UNHEATED
from bev_preheat.native.library import Declined, OK
from bev_preheat.planning.core_engine import trip_in_core, vehicle_in_core
from bev_preheat.planning.planner import METHODS
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.trip import make_trip
from bev_preheat_studies.fleet.drawn_fleet import goal_of, vehicle_of
from bev_preheat_studies.fleet.ways import ALWAYS, arrivals_of, NONE, WAYS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat_studies.fleet.drawn_fleet import FleetTrips

# On a trip without an active limit, `value_function` is `optimal_switch`.
IN_THE_CORE = {NONE: UNHEATED, ALWAYS: ALWAYS_ON, 'paper': PAPER, 'optimal_switch': ONE_SWITCH,
               'value_function': ONE_SWITCH}
COLUMNS = [IN_THE_CORE[way] for way in WAYS]


@dataclass(frozen=True)
class Arrivals:
    """
    As Arrival, for K trips in each of WAYS: arrays of shape (K, WAYS).

    `are_driven` (K,): whether the car can drive the trip at least without heating; otherwise its values are NaN.
    """

    heater_wh: FloatArray
    temperature_c: FloatArray
    soc: FloatArray
    are_driven: BoolArray


def arrivals_of_all(trips: FleetTrips) -> Arrivals:
    """Return the Arrivals of drawn trips."""
    shape = len(trips), len(WAYS)
    arrivals = Arrivals(np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan),
                        np.ones(len(trips), dtype=bool))
    for car, places in trips.cars():
        are_there = np.zeros((places.stop - places.start, len(WAYS)), dtype=bool)
        found = planned_in_the_core(trips, car, places)
        if found is not None:
            found = found[:, COLUMNS]
            are_there = found['status'] == OK
            for name in ('heater_wh', 'temperature_c', 'soc'):
                getattr(arrivals, name)[places] = np.where(are_there, found[name], np.nan)
        for row in np.flatnonzero(~are_there.all(axis=1)).tolist():
            _drive_one(trips, car, places.start + row, are_there[row], arrivals)
    return arrivals


def planned_in_the_core(trips: FleetTrips, car: str, places: slice) -> NDArray[np.void] | None:
    """Return the result of `plan_trips` for the trips of a car; None if the core cannot answer."""
    vehicle, goal = vehicle_of(car), goal_of(car)
    route = trips.route(places)
    trip = make_trip(vehicle, route)
    if len(trip.route) != len(route) or not vehicle.heat_path.is_direct:
        # Steps that were divided are not the drawn steps.
        return None
    try:
        return plan_trips(
            vehicle_in_core(vehicle), trip_in_core(trip), trips.steps[places], trips.start_soc[places],
            trips.start_c[places], np.full(places.stop - places.start, goal.target_temperature_c),
            reserve_soc(vehicle, goal), vehicle.battery.soc_range[0])
    except Declined:
        return None


def _drive_one(trips: FleetTrips, car: str, place: int, are_there: BoolArray, arrivals: Arrivals) -> None:
    """Write the arrivals of one trip, in the ways that are still missing."""
    methods = [way for way, is_there in zip(WAYS, are_there.tolist()) if way in METHODS and not is_there]
    driven = arrivals_of(trips.trip(place), vehicle_of(car), methods)
    if driven is None:
        arrivals.are_driven[place] = False
        for values in (arrivals.heater_wh, arrivals.temperature_c, arrivals.soc):
            values[place] = np.nan
        return
    for way, arrival in driven.items():
        column = WAYS.index(way)
        arrivals.heater_wh[place, column] = arrival.heater_wh
        arrivals.temperature_c[place, column] = arrival.temperature_c
        arrivals.soc[place, column] = arrival.soc
