# SPDX-License-Identifier: Apache-2.0
"""Plans of many trips of one vehicle in one call of the native core."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, OK
from bev_preheat.native.runs import doubles_at, place
from bev_preheat.native.structs import ArrivalStruct, room

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from bev_preheat.native.structs import NativeTrip, NativeVehicle
    from bev_preheat.numerics.arrays import FloatArray

# BEV_WAYS.
WAYS_OF_TRIP = 4
# In the order of `bev_way`.
UNHEATED, ALWAYS_ON, PAPER, ONE_SWITCH = range(WAYS_OF_TRIP)
ARRIVAL = np.dtype(ArrivalStruct)


def plan_trips(vehicle: NativeVehicle, trips: NativeTrip, steps: NDArray[np.integer], soc: FloatArray,
               temperature_c: FloatArray, target_c: FloatArray, reserve_soc: float,
               lowest_soc: float) -> NDArray[np.void] | None:
    """
    Return how each way to heat each of K trips ends, ARRIVAL (K, WAYS_OF_TRIP); see core.h.

    The trips lie in `trips` one after the other, of `steps` (K,) each; charge, temperature [deg C] at the
    start and target [deg C] have the same shape. An arrival whose `status` is not OK has no answer of the core.
    """
    library, count = core(), len(steps)
    if library is None:
        return None
    longest = int(steps.max(initial=1))
    arrivals = np.zeros((count, WAYS_OF_TRIP), ARRIVAL)
    # Memory behind pointers must live until the call has ended.
    counts, flags = np.ascontiguousarray(steps, np.int32), np.empty(room('BEV_TRIPS_FLAGS', longest), np.uint8)
    status = library.bev_plan_trips(
        vehicle.address, trips.address, count, counts.ctypes.data, doubles_at(soc, count),
        doubles_at(temperature_c, count), doubles_at(target_c, count), reserve_soc, lowest_soc, longest,
        place(np.empty(room('BEV_TRIPS_MEMORY', longest))), flags.ctypes.data, arrivals.ctypes.data)
    return arrivals if status == OK else None
