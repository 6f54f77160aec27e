# SPDX-License-Identifier: Apache-2.0
"""
The estimation's filters in the native core, with arrays in and out; core.h documents the calls.

Each call returns None or False if the core does not answer, and has then changed no array: the caller
falls back to Python.
"""

from __future__ import annotations

from ctypes import addressof, byref, c_double, c_int32
from struct import Struct as Packed
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.native.belief_structs import (
    BeliefStruct,
    DRIVE_COLUMNS,
    DriveStruct,
    ELEMENTS,
    ExpectedDriveStruct,
    MOST_HEATERS,
    PassedStruct,
    ReadingStruct,
)
from bev_preheat.native.library import core, OK
from bev_preheat.native.structs import address_of, DOUBLE_BYTES, doubles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.native.belief_structs import BeliefTermsStruct
    from bev_preheat.native.structs import NativeVehicle
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Leakage
    from bev_preheat.vehicle.uncertain_car import DriveInputs


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
PASSED, READING = Packed(f'2P6d{MOST_HEATERS}d{len(DRIVE_COLUMNS)}di'), Packed('2P4di')


class NativeBelief:
    """A `bev_belief`: copies of the arrays of weights, means and covariances, which its calls change."""

    def __init__(self, weights: FloatArray, mean: FloatArray, covariance: FloatArray) -> None:
        """Copy arrays (heaters, noises), (…, ELEMENTS) and (…, ELEMENTS, ELEMENTS)."""
        self.weights, self.mean, self.covariance = arrays = weights.copy(), mean.copy(), covariance.copy()
        self._memory = np.empty(sum([array.size for array in arrays]))
        self._struct = BeliefStruct(*weights.shape, *map(address_of, (*arrays, self._memory)))
        self._address = addressof(self._struct)
        self._passed, self._reading = PassedStruct(), ReadingStruct()
        self._places = addressof(self._passed), addressof(self._reading)
        self._done, self._lost = c_int32(), c_int32()
        self._counts = addressof(self._done), addressof(self._lost)
        self._others_w = (0.0,) * (MOST_HEATERS - len(weights))

    def mix(self, transitions: FloatArray) -> bool:
        """Do `bev_mix_belief` with transitions (heaters, heaters)."""
        library = core()
        return library is not None and bool(
            library.bev_mix_belief(self._address, _place(transitions)) == OK)

    def move(self, vehicle: NativeVehicle, terms: BeliefTermsStruct, drive: DriveInputs,
             leakage: Leakage, duration_s: float, heater_w: FloatArray, wander: FloatArray,
             hidden_variance_s2: float) -> bool:
        """Do `bev_move_belief` under the powers of each hypothesis (heaters,) [W]."""
        library = core()
        if library is None:
            return False
        struct = DriveStruct(*_numbers_of(drive, leakage))
        return bool(library.bev_move_belief(
            vehicle.address, self._address, byref(terms), byref(struct), duration_s, _place(heater_w),
            _place(wander), hidden_variance_s2) == OK)

    def see_interval(self, terms: BeliefTermsStruct, element: int, noise_variance: FloatArray, low: float,
                     high: float, tells_hypotheses: bool) -> int | None:
        """Do `bev_see_interval` with variances (noises,); return how many filters are lost."""
        library = core()
        if library is None:
            return None
        status = library.bev_see_interval(
            self._address, byref(terms), element, _place(noise_variance), low, high, tells_hypotheses,
            byref(self._lost))
        return self._lost.value if status == OK else None

    def see_propulsion_power(self, terms: BeliefTermsStruct, seen_w: float, route_w: float,
                             variance_w2: float, most_w: float) -> int | None:
        """Do `bev_see_propulsion_power`; return how many filters are lost."""
        library = core()
        if library is None:
            return None
        status = library.bev_see_propulsion_power(
            self._address, byref(terms), seen_w, route_w, variance_w2, most_w, byref(self._lost))
        return self._lost.value if status == OK else None

    def follow(self, vehicle: NativeVehicle, terms: BeliefTermsStruct, elapsing: Elapsing, drive: DriveInputs,
               leakage: Leakage, heater_w: Sequence[float], hidden_variance_s2: float,
               propulsion: tuple[float, float, float, float]) -> tuple[int, int]:
        """
        Do `bev_follow`; return how many of its three parts were done, and how many filters are lost.

        `propulsion` is power seen and power of the route [W], variance [W^2], and most difference [W].
        """
        library = core()
        if library is None:
            return 0, 0
        PASSED.pack_into(
            self._passed, 0, *elapsing.addresses, elapsing.duration_s, hidden_variance_s2, *propulsion,
            *heater_w, *self._others_w, *_numbers_of(drive, leakage))
        library.bev_follow(
            vehicle.address, self._address, addressof(terms), self._places[0], *self._counts)
        return self._done.value, self._lost.value

    def take_reading(self, terms: BeliefTermsStruct, noise: ReadingNoise, interval_c: tuple[float, float],
                     interval: tuple[float, float], tells_hypotheses: bool,
                     ) -> tuple[int, int, tuple[FloatArray, FloatArray]]:
        """
        Do `bev_take_reading` of intervals of temperature [deg C] and charge; see bev_reading.

        Returns how many of its three parts were done, how many filters are lost, and, if all parts were
        done, the result of `expected`.
        """
        library, both = core(), np.empty((ELEMENTS + 1, ELEMENTS))
        if library is None:
            return 0, 0, (both[0], both[1:])
        at = address_of(both)
        READING.pack_into(self._reading, 0, *noise.addresses, *interval_c, *interval, tells_hypotheses)
        library.bev_take_reading(
            self._address, addressof(terms), self._places[1], at, at + DOUBLE_BYTES * ELEMENTS, *self._counts)
        both.setflags(write=False)
        return self._done.value, self._lost.value, (both[0], both[1:])

    def expected(self) -> tuple[FloatArray, FloatArray] | None:
        """Return mean (ELEMENTS,) and covariance (ELEMENTS, ELEMENTS) over all hypotheses."""
        library = core()
        if library is None:
            return None
        both = np.empty((ELEMENTS + 1, ELEMENTS))
        if library.bev_expect(
                self._address, _place(both), _place(both, DOUBLE_BYTES * ELEMENTS)) != OK:
            return None
        both.setflags(write=False)
        return both[0], both[1:]


def arrival_variance(vehicle: NativeVehicle, terms: BeliefTermsStruct, leakage: Leakage, route: FloatArray,
                     heater_w: FloatArray, temperature_c: FloatArray, soc: FloatArray,
                     covariance: FloatArray) -> float | None:
    """
    Do `bev_arrival_variance`; return the variance of the temperature on arrival [K^2].

    `route` (8, N) are the columns of a route, `heater_w` (N,) is the heater power in each step [W],
    temperatures [deg C] and charge (N + 1,) are the run, `covariance` is (ELEMENTS, ELEMENTS).
    """
    library = core()
    if library is None:
        return None
    arrays = [*map(doubles, (route, heater_w, temperature_c, soc, covariance))]
    *columns, believed = map(address_of, arrays)
    expected = ExpectedDriveStruct(
        route.shape[1], *columns, leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps)
    variance_k2 = c_double()
    status = library.bev_arrival_variance(
        vehicle.address, addressof(expected), addressof(terms), believed, addressof(variance_k2))
    return variance_k2.value if status == OK else None


def _numbers_of(drive: DriveInputs, leakage: Leakage) -> tuple[float, ...]:
    """Return a `bev_drive` in the order of its fields."""
    seen_w = drive.terminal_power_w
    return (drive.speed_mps, drive.ambient_temperature_c, drive.propulsion_power_w,
            drive.power_variance_w2, drive.propulsion_power_magnitude_w, drive.cabin_heating_power_w,
            drive.auxiliary_power_w, 0.0 if seen_w is None else seen_w, drive.hidden_variance_w2,
            leakage.gamma_0_w_per_k, leakage.gamma_v_w_per_k_per_mps, seen_w is not None)


def _place(array: FloatArray, offset: int = 0) -> Any:
    """Return a pointer into a contiguous array of doubles, at an offset in bytes from its beginning."""
    return byref(c_double.from_buffer(array, offset))  # type: ignore[arg-type]
