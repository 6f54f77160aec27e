# SPDX-License-Identifier: Apache-2.0
"""
Runs of the native core, with arrays in and out.

Each returns None if the core does not answer: the caller then falls back to Python, which has the same
result or raises the appropriate exception.
"""

from __future__ import annotations

from ctypes import byref, c_double, c_int32
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, EMPTY, NO_CROSSING, OK, SATURATED
from bev_preheat.native.structs import DOUBLE_BYTES, doubles, HeatingStruct
from bev_preheat.vehicle.model import make_euler, make_midpoint, make_runge_kutta_4

if TYPE_CHECKING:

    from bev_preheat.native.structs import NativeTrip, NativeVehicle
    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.vehicle.model import Integrator

INTEGRATORS: dict[Integrator, int] = {make_euler: 0, make_midpoint: 1, make_runge_kutta_4: 2}
FLOAT = np.dtype(float)


def is_in_order(vehicle: NativeVehicle) -> bool:
    """Return whether the core takes a vehicle's numbers, down to its tables."""
    library = core()
    return library is not None and library.bev_check_vehicle(vehicle.address) == OK


def run(vehicle: NativeVehicle, make_integrator: Integrator, trip: NativeTrip,
        states: FloatArray, first: int, heater_w: FloatArray | None,
        brake_w: FloatArray | None) -> FloatArray | None:
    """
    Return states of charge and temperatures [deg C] of a run from step `first` on, (2, N + 1).

    `states` are those at the start of step `first`, written into the returned array; values before it are
    undefined. `heater_w` and `brake_w` are powers [W] of each step (N,), None: no power.
    """
    library, integrator = core(), INTEGRATORS.get(make_integrator)
    if library is None or integrator is None:
        return None
    status = library.bev_run(
        vehicle.address, integrator, trip.address, first, doubles_at(heater_w, trip.steps),
        doubles_at(brake_w, trip.steps), *_rows(states, 2))
    return states if status in (OK, SATURATED) else None


def run_heated(vehicle: NativeVehicle, trip: NativeTrip, states: FloatArray, first: int,
               command_w: FloatArray, brake_w: FloatArray | None) -> FloatArray | None:
    """
    Return the four states of a run with the heat path from step `first` on, (4, N + 1).

    As `run`; `command_w` (N,) is the heater command [W].
    """
    library = core()
    if library is None:
        return None
    status = library.bev_run_heated(
        vehicle.address, trip.address, first, doubles_at(command_w, trip.steps),
        doubles_at(brake_w, trip.steps), place(states))
    return states if status in (OK, SATURATED) else None


def crossing(vehicle: NativeVehicle, make_integrator: Integrator, trip: NativeTrip,
             target_c: float, terminal_soc: float, lost_k: float,
             idle_temperature_c: FloatArray) -> tuple[float | None] | None:
    """Return the instant [s] at which the backward run meets the unheated one, in a tuple; (None,) if never."""
    library, integrator = core(), INTEGRATORS.get(make_integrator)
    if library is None or integrator is None:
        return None
    instant_s = c_double()
    status = library.bev_find_crossing(
        vehicle.address, integrator, trip.address, target_c, terminal_soc, lost_k,
        doubles_at(idle_temperature_c, trip.steps + 1), byref(instant_s))
    if status == NO_CROSSING:
        return (None,)
    return (instant_s.value,) if status == OK else None


class Heating:
    """A `bev_heating`: when a run within limits heats; see core.h."""

    def __init__(self, power_w: FloatArray, below_c: float, may_overcharge: BoolArray, may_overdraw: BoolArray,
                 takes_surplus: bool) -> None:
        """`power_w` (N,) [W], in steps that begin colder than `below_c` [deg C]."""
        self._power_w = doubles(power_w)
        self._flags = np.concatenate((may_overcharge, may_overdraw)).view(np.uint8)
        flags = self._flags.ctypes.data
        self.struct = HeatingStruct(
            takes_surplus, below_c, self._power_w.ctypes.data, flags, flags + len(power_w))


def run_within_limits(vehicle: NativeVehicle, trip: NativeTrip, heating: Heating, first: int,
                      states: FloatArray, powers_w: FloatArray) -> tuple[int | None] | None:
    """
    Drive on from step `first` within the limits; `states` and `powers_w` are written.

    `states` (2, N + 1) are charge and temperature [deg C], `powers_w` (2, N) heater and brake. Returns
    the step in which the charge runs out, in a tuple; (None,) if it does not run out.
    """
    library = core()
    if library is None:
        return None
    empty = c_int32()
    status = library.bev_run_within_limits(
        vehicle.address, trip.address, byref(heating.struct), first, *_rows(states, 2),
        *_rows(powers_w, 2), byref(empty))
    if status == EMPTY:
        return (empty.value,)
    return (None,) if status == OK else None


def run_heated_within_limits(vehicle: NativeVehicle, trip: NativeTrip, heating: Heating, first: int,
                             states: FloatArray, powers_w: FloatArray) -> tuple[int | None] | None:
    """
    Do as `run_within_limits`, with the heat path.

    `states` (4, N + 1) are those of `run_heated`; `powers_w` (4, N) are command, friction brake, heater
    power and heat into the battery [W].
    """
    library = core()
    if library is None:
        return None
    empty = c_int32()
    status = library.bev_run_heated_within_limits(
        vehicle.address, trip.address, byref(heating.struct), first,
        place(states), place(powers_w), byref(empty))
    if status == EMPTY:
        return (empty.value,)
    return (None,) if status == OK else None


def limits_of_steps(vehicle: NativeVehicle, soc: FloatArray, temperature_c: FloatArray,
                    variance_w2: FloatArray) -> FloatArray | None:
    """Return least and most terminal power [W], (2, K), of steps with variances (K,) between states (K + 1,)."""
    library = core()
    if library is None:
        return None
    count = len(variance_w2)
    limits_w = np.empty((2, count))
    status = library.bev_limits_of_steps(
        vehicle.address, count, doubles_at(soc, count + 1), doubles_at(temperature_c, count + 1),
        doubles_at(variance_w2, count), *_rows(limits_w, 2))
    return limits_w if status == OK else None


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


def _rows(array: FloatArray, rows: int) -> list[Any]:
    """Return pointers to the rows of a contiguous array (rows, any)."""
    width = DOUBLE_BYTES * array.shape[1]
    return [place(array, row * width) for row in range(rows)]


def place(array: FloatArray, offset: int = 0) -> Any:
    """Return a pointer into an array, at an offset in bytes from its beginning; keeps the array alive."""
    return byref(c_double.from_buffer(array, offset))  # type: ignore[arg-type]
