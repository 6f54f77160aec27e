# SPDX-License-Identifier: Apache-2.0
"""
Searches of the native core: where heating pays, and the runs that meet their requirements.

As in `runs`, each returns None if the core does not answer.
"""

from __future__ import annotations

from ctypes import byref, c_int32
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, EMPTY, OK
from bev_preheat.native.structs import (
    address_of,
    room,
    StrandingStruct,
    ValueGoalStruct,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bev_preheat.native.structs import NativeTrip, NativeVehicle
    from bev_preheat.numerics.arrays import FloatArray

    # The step in which the charge runs out, and its driven share.
    Stranded = tuple[int, float] | None

# Here memory is cheaper than computing values twice.
ALL_KEPT = 1


def stand(vehicle: NativeVehicle, trip: NativeTrip, empty: int, states: FloatArray,
          powers_w: FloatArray) -> float | None:
    """
    Write the end of a run whose charge runs out in step `empty`; return the driven share of that step.

    `states` (S, N + 1) and `powers_w` (S, N) are those of `settle`; see `bev_stand` in core.h.
    """
    library = core()
    if library is None:
        return None
    stranding, asked_w = StrandingStruct(empty), powers_w[:, empty].copy()
    status = library.bev_stand(
        vehicle.address, trip.address, states.ctypes.data, powers_w.ctypes.data, byref(stranding))
    if status == OK:
        return float(stranding.driven_share)
    powers_w[:, empty] = asked_w
    return None


class NativeValues(NamedTuple):
    """What `bev_plan_by_values` leaves for `bev_follow_values`, of a trip of so many steps."""

    steps: int
    flags: NDArray[np.uint8]
    memory: FloatArray


class PlanByValues(NamedTuple):
    """
    Heater commands [W] (N,) of a plan by values; None if the charge does not carry the trip.

    `ends_in` is the step within which heating ends, or None. `values` lead to the plans after it.
    """

    command_w: FloatArray | None
    ends_in: int | None = None
    values: Any = None


def plan_by_values(vehicle: NativeVehicle, trip: NativeTrip, start: Sequence[float], target_c: float,
                   lowest_soc: float, deviation_k: float, is_heating: bool, price: FloatArray | None = None,
                   kept: NativeValues | None = None) -> PlanByValues | None:
    """
    Return the plan by values from the four states `start` on; see `bev_plan_by_values` in core.h.

    With `kept` it follows the values of an earlier plan; None also if they do not lead to a plan.
    """
    library = core()
    if library is None:
        return None
    steps = trip.steps
    states, powers_w = np.zeros((4, steps + 1)), np.zeros((4, steps))
    states[:, 0] = start
    goal = ValueGoalStruct(is_heating, target_c, lowest_soc, deviation_k,
                           None if price is None else address_of(price))
    values = kept or NativeValues(steps, np.zeros(room('BEV_VALUE_BYTES', steps), dtype=np.uint8),
                                  np.empty(room('BEV_VALUE_MEMORY', steps)))
    run = address_of(states), address_of(powers_w), address_of(values.flags), address_of(values.memory)
    ends_in = c_int32()
    if kept is None:
        status = library.bev_plan_by_values(
            vehicle.address, trip.address, byref(goal), *run, byref(ends_in), ALL_KEPT)
    else:
        status = library.bev_follow_values(
            vehicle.address, trip.address, byref(goal), kept.steps, *run, byref(ends_in))
    if status == EMPTY:
        return PlanByValues(None)
    if status != OK:
        return None
    return PlanByValues(powers_w[0], None if ends_in.value < 0 else ends_in.value, values)
