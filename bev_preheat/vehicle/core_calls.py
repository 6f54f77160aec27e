# SPDX-License-Identifier: Apache-2.0
"""
Vehicles and arrays as the native core takes them, and the calls of the estimation's filters (see estimation.h).

A call raises Declined if the core does not answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import addressof, byref, c_double, c_int32
from functools import lru_cache
from struct import Struct as Packed
from typing import Any

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.vehicle.core_library import call, core, Declined
from bev_preheat.vehicle.core_structs import (
    address_of,
    BeliefStruct,
    BeliefTermsStruct,
    DOUBLE_BYTES,
    doubles,
    DRIVE_COLUMNS,
    ELEMENTS,
    ExpectedDriveStruct,
    MOST_HEATERS,
    NativeVehicle,
    NotDescribed,
    PassedStruct,
    ReadingStruct,
)
from bev_preheat.vehicle.description import Leakage, Vehicle
from bev_preheat.vehicle.model import Integrator, make_euler, make_midpoint, make_runge_kutta_4
from bev_preheat.vehicle.variants import DriveInputs, KEPT_VEHICLES

INTEGRATORS: dict[Integrator, int] = {make_euler: 0, make_midpoint: 1, make_runge_kutta_4: 2}
FLOAT = np.dtype(float)


def vehicle_in_core(vehicle: Vehicle) -> NativeVehicle:
    """Return the vehicle as a native struct; raises Declined if the core is not used, or cannot take it."""
    # The cache must not depend on whether the core is switched off for a while.
    native = None if core() is None else _native_vehicle(vehicle)
    if native is None:
        raise Declined
    return native


@lru_cache(maxsize=KEPT_VEHICLES)
def _native_vehicle(vehicle: Vehicle) -> NativeVehicle | None:
    try:
        native = NativeVehicle(vehicle)
        # Down to its tables.
        call('bev_check_vehicle', native.address)
    except (NotDescribed, Declined):
        return None
    return native


def doubles_at(values: FloatArray | None, count: int) -> Any:
    """Return a pointer to values (count,), or to a contiguous copy; None for None."""
    if values is None:
        return None
    try:
        if values.dtype is FLOAT and len(values) == count:
            return place(values)
    except (TypeError, ValueError):
        # Not contiguous, read only, or empty.
        pass
    copy = np.zeros(count + 1)
    copy[:count] = values
    return place(copy)


def rows_of(array: FloatArray) -> list[Any]:
    """Return pointers to the rows of a contiguous array."""
    rows, columns = array.shape
    return [place(array, row * columns * DOUBLE_BYTES) for row in range(rows)]


def place(array: FloatArray, offset: int = 0) -> Any:
    """Return a pointer into an array, at an offset in bytes from its beginning; keeps the array alive."""
    return byref(c_double.from_buffer(array, offset))  # type: ignore[arg-type]


class Elapsing:
    """Time that passes [s]: the transitions (heaters, heaters) and the variances (ELEMENTS,) that come with it."""

    def __init__(self, duration_s: float, transitions: FloatArray, wander: FloatArray) -> None:
        """Keep the arrays alive, which must be contiguous."""
        self.duration_s, self.transitions, self.wander = duration_s, transitions, wander
        self.addresses = address_of(transitions), address_of(wander)


class ReadingNoise:
    """Variances (noises,) of a reading's temperature [K^2] and charge."""

    def __init__(self, temperature_k2: FloatArray, soc: FloatArray) -> None:
        """Keep the arrays alive, which must be contiguous."""
        self._kept = temperature_k2, soc
        self.addresses = address_of(temperature_k2), address_of(soc)


# The numbers of these structs in a row: written at once, which takes a fifth of field by field.
PASSED, READING = Packed(f'2P6d{2 * MOST_HEATERS}d{len(DRIVE_COLUMNS)}di'), Packed('2P4d')


class NativeBelief:
    """A `bev_belief`: copies of the arrays of weights, means and covariances, which its calls change."""

    def __init__(self, weights: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
        """Copy arrays (heaters, noises), (…, ELEMENTS) and (…, ELEMENTS, ELEMENTS); Declined without the core."""
        if core() is None:
            raise Declined
        self.weights, self.mean, self.covariance = arrays = weights.copy(), mean.copy(), covariance.copy()
        self._memory = np.empty(sum([array.size for array in arrays]))
        self._struct = BeliefStruct(*weights.shape, *map(address_of, (*arrays, self._memory)))
        self._address = addressof(self._struct)
        self._passed, self._reading = PassedStruct(), ReadingStruct()
        self._places = addressof(self._passed), addressof(self._reading)
        self._lost = c_int32()
        self._others_w = (0.0,) * (MOST_HEATERS - len(weights))

    def follow(self, vehicle: NativeVehicle, terms: BeliefTermsStruct, elapsing: Elapsing, drive: DriveInputs,
               leakage: Leakage, heats_w: tuple[Sequence[float], Sequence[float]], hidden_variance_s2: float,
               propulsion: tuple[float, float, float, float]) -> int:
        """
        Do `bev_follow`; return how many filters are lost.

        `heats_w` are the HVCH's power and the heat of other sources of each hypothesis [W]. `propulsion` is power
        seen and power of the route [W], variance [W^2], and most difference [W].
        """
        PASSED.pack_into(
            self._passed, 0, *elapsing.addresses, elapsing.duration_s, hidden_variance_s2, *propulsion,
            *heats_w[0], *self._others_w, *heats_w[1], *self._others_w, *_numbers_of(drive, leakage))
        call('bev_follow', vehicle.address, self._address, addressof(terms), self._places[0],
             addressof(self._lost))
        return self._lost.value

    def take_reading(self, terms: BeliefTermsStruct, noise: ReadingNoise, interval_c: tuple[float, float],
                     interval: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """
        Do `bev_take_reading` of intervals of temperature [deg C] and charge; return mean and covariance.

        Declined also if filters are lost, because that ends it.
        """
        both = np.empty((ELEMENTS + 1, ELEMENTS))
        at = address_of(both)
        READING.pack_into(self._reading, 0, *noise.addresses, *interval_c, *interval)
        call('bev_take_reading', self._address, addressof(terms), self._places[1], at,
             at + DOUBLE_BYTES * ELEMENTS, addressof(self._lost))
        if self._lost.value:
            raise Declined
        both.setflags(write=False)
        return both[0], both[1:]


def arrival_variance(vehicle: NativeVehicle, terms: BeliefTermsStruct, leakage: Leakage, route: FloatArray,
                     heater_w: FloatArray, source_heat_w: FloatArray, temperature_c: FloatArray, soc: FloatArray,
                     covariance: FloatArray) -> float:
    """
    Do `bev_arrival_variance`; return the variance of the temperature on arrival [K^2].

    `route` (8, N) are the columns of a route, `heater_w` (N,) is the heater power in each step [W],
    `source_heat_w` (N,) the heat of other sources as HVCH power [W], temperatures [deg C] and charge (N + 1,) are
    the run, `covariance` is (ELEMENTS, ELEMENTS).
    """
    arrays = [*map(doubles, (route, heater_w, source_heat_w, temperature_c, soc, covariance))]
    *columns, believed = map(address_of, arrays)
    expected = ExpectedDriveStruct(
        route.shape[1], *columns, leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps)
    variance_k2 = c_double()
    call('bev_arrival_variance', vehicle.address, addressof(expected), addressof(terms), believed,
         addressof(variance_k2))
    return variance_k2.value


def _numbers_of(drive: DriveInputs, leakage: Leakage) -> tuple[float, ...]:
    """Return a `bev_drive` in the order of its fields."""
    seen_w = drive.terminal_power_w
    return (drive.speed_mps, drive.ambient_temperature_c, drive.propulsion_power_w,
            drive.power_variance_w2, drive.propulsion_power_magnitude_w, drive.cabin_heating_power_w,
            drive.auxiliary_power_w, 0.0 if seen_w is None else seen_w, drive.hidden_variance_w2,
            leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, seen_w is not None)
