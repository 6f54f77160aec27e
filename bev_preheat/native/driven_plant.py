# SPDX-License-Identifier: Apache-2.0
"""The simulated vehicle driven by the compiled core; plant.h says what the call does."""

from __future__ import annotations

from ctypes import addressof
from struct import Struct as Packed
from typing import Any, TYPE_CHECKING

from bev_preheat.native.library import core, OK
from bev_preheat.native.structs import PLANT_COLUMNS, PlantStruct

if TYPE_CHECKING:
    from bev_preheat.native.structs import NativeTrip, NativeVehicle

# The numbers of a `bev_plant` in a row: written and read at once, which takes a fifth of field by field.
PLANT = Packed(f'{len(PLANT_COLUMNS)}di')


class NativePlant:
    """A vehicle and the trip on which the core drives it; where it is, the caller keeps."""

    def __init__(self, vehicle: NativeVehicle, trip: NativeTrip, sensor_lag_s: float) -> None:
        """Take a vehicle whose sensor is so late [s]."""
        self._vehicle, self._trip, self._sensor_lag_s = vehicle, trip, sensor_lag_s
        self._struct = PlantStruct()
        self._address = addressof(self._struct)

    def drive(self, until_s: float, heater_power_w: float, longest_step_s: float,
              plant: tuple[float, ...]) -> tuple[bool, tuple[Any, ...]] | None:
        """
        Do `bev_drive_plant`; None where the core does not answer.

        Returns whether it drove as far as is wanted, and what became of `plant`: PLANT_COLUMNS and segment.
        """
        library = core()
        if library is None:
            return None
        PLANT.pack_into(self._struct, 0, *plant)
        status = library.bev_drive_plant(
            self._vehicle.address, self._trip.address, self._sensor_lag_s, longest_step_s, until_s,
            heater_power_w, self._address)
        return None if status < OK else (status == OK, PLANT.unpack_from(self._struct))
