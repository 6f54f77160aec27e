# SPDX-License-Identifier: Apache-2.0
"""
The estimation's filters in the native core, with arrays in and out; core.h documents the calls.

Each call raises Declined if the core does not answer.
"""

from __future__ import annotations

from ctypes import addressof, c_double, c_int32
from struct import Struct as Packed
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import call, core, Declined
from bev_preheat.native.structs import (
    address_of,
    BeliefStruct,
    DOUBLE_BYTES,
    doubles,
    DRIVE_COLUMNS,
    ELEMENTS,
    ExpectedDriveStruct,
    MOST_HEATERS,
    PassedStruct,
    ReadingStruct,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.native.structs import BeliefTermsStruct, NativeVehicle
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
               leakage: Leakage, heater_w: Sequence[float], hidden_variance_s2: float,
               propulsion: tuple[float, float, float, float]) -> int:
        """
        Do `bev_follow`; return how many filters are lost.

        `propulsion` is power seen and power of the route [W], variance [W^2], and most difference [W].
        """
        PASSED.pack_into(
            self._passed, 0, *elapsing.addresses, elapsing.duration_s, hidden_variance_s2, *propulsion,
            *heater_w, *self._others_w, *_numbers_of(drive, leakage))
        call('bev_follow', vehicle.address, self._address, addressof(terms), self._places[0],
             addressof(self._lost))
        return self._lost.value

    def take_reading(self, terms: BeliefTermsStruct, noise: ReadingNoise, interval_c: tuple[float, float],
                     interval: tuple[float, float], tells_hypotheses: bool) -> tuple[FloatArray, FloatArray]:
        """
        Do `bev_take_reading` of intervals of temperature [deg C] and charge; return mean and covariance.

        Declined also if filters are lost, because that ends it.
        """
        both = np.empty((ELEMENTS + 1, ELEMENTS))
        at = address_of(both)
        READING.pack_into(self._reading, 0, *noise.addresses, *interval_c, *interval, tells_hypotheses)
        call('bev_take_reading', self._address, addressof(terms), self._places[1], at,
             at + DOUBLE_BYTES * ELEMENTS, addressof(self._lost))
        if self._lost.value:
            raise Declined
        both.setflags(write=False)
        return both[0], both[1:]


def arrival_variance(vehicle: NativeVehicle, terms: BeliefTermsStruct, leakage: Leakage, route: FloatArray,
                     heater_w: FloatArray, temperature_c: FloatArray, soc: FloatArray,
                     covariance: FloatArray) -> float:
    """
    Do `bev_arrival_variance`; return the variance of the temperature on arrival [K^2].

    `route` (8, N) are the columns of a route, `heater_w` (N,) is the heater power in each step [W],
    temperatures [deg C] and charge (N + 1,) are the run, `covariance` is (ELEMENTS, ELEMENTS).
    """
    arrays = [*map(doubles, (route, heater_w, temperature_c, soc, covariance))]
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
