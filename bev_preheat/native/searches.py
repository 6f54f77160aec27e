# SPDX-License-Identifier: Apache-2.0
"""
Searches of the native core: where heating pays, and the runs that meet their requirements.

As in `runs`, each returns None if the core does not answer.
"""

from __future__ import annotations

from ctypes import byref, c_double, c_int32
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, EMPTY, OK
from bev_preheat.native.runs import doubles_at
from bev_preheat.native.structs import (
    address_of,
    BANDS,
    CURVE_MEMORY,
    CurveRangeStruct,
    DOUBLE_BYTES,
    doubles,
    MeritPlanStruct,
    room,
    SafeGoalStruct,
    SafePlanStruct,
    SettlingStruct,
    StrandingStruct,
    STRIDE_COLUMNS,
    StridesStruct,
    ValueGoalStruct,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bev_preheat.native.runs import Heating
    from bev_preheat.native.structs import NativeTrip, NativeVehicle, UncertaintyMarginStruct
    from bev_preheat.numerics.arrays import BoolArray, FloatArray

    # The step in which the charge runs out, and its driven share.
    Stranded = tuple[int, float] | None


def find_bands(vehicle: NativeVehicle, columns: dict[str, FloatArray], is_limited: BoolArray,
               is_first_look: bool, grid_c: FloatArray, *ends: float) -> FloatArray | None:
    """
    Return floor, low and high [deg C] of the bands in which heating pays, (3, M, BANDS); see core.h.

    `columns` has those of STRIDE_COLUMNS, `is_limited` (M,) says where limits may matter. On the grid
    (G,) [deg C], at a first look on a coarser one; `ends` are the other fields of `bev_curve_range`, in
    their order.
    """
    library = core()
    if library is None:
        return None
    strides = len(is_limited)
    ordered = [columns[name] for name in STRIDE_COLUMNS]
    block = np.concatenate((*ordered, grid_c), dtype=float)
    flags = is_limited.astype(np.uint8)
    places, at = [], block.ctypes.data
    for column in ordered:
        places.append(at)
        at += DOUBLE_BYTES * len(column)
    struct = StridesStruct(strides, *places, flags.ctypes.data)
    extent = CurveRangeStruct(len(grid_c), is_first_look, at, *ends)
    bands_c, memory = np.empty((3, strides, BANDS)), np.empty(CURVE_MEMORY)
    status = library.bev_find_bands(
        vehicle.address, byref(struct), byref(extent), memory.ctypes.data, bands_c.ctypes.data)
    return bands_c if status == OK else None


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


def settle(vehicle: NativeVehicle, trip: NativeTrip, heating: Heating, goal: SettlingStruct,
           start: Sequence[float]) -> tuple[FloatArray, FloatArray, Stranded] | None:
    """
    Return states (S, N + 1) and powers (S, N) of the run that delivers its climbs and meets the target.

    Last, the step in which its charge runs out and the driven share of that step; None if it does not run out.
    `start` are the S states at its beginning, two or, with a heat path, four; see `bev_settle` in core.h.
    """
    library = core()
    if library is None:
        return None
    states, powers_w = np.empty((len(start), trip.steps + 1)), np.empty((len(start), trip.steps))
    states[:, 0] = start
    memory = np.empty(room('BEV_SETTLE_MEMORY', trip.steps))
    stranding = StrandingStruct()
    status = library.bev_settle(
        vehicle.address, trip.address, byref(heating.struct), byref(goal), states.ctypes.data,
        powers_w.ctypes.data, byref(stranding), memory.ctypes.data)
    return (states, powers_w, _stranded(stranding)) if status == OK else None


class MeritPlan(NamedTuple):
    """
    A plan: states (S, N + 1) and powers (S, N), as of `settle`, and when it heats [s].

    `start_s` is None without heating, `end_s` if heating lasts until arrival; `stranded` as of `settle`.
    """

    states: FloatArray
    powers_w: FloatArray
    start_s: float | None
    end_s: float | None
    stranded: Stranded


def plan_merit_order(vehicle: NativeVehicle, trip: NativeTrip, goal: SettlingStruct,
                     idle_states: FloatArray) -> MeritPlan | None:
    """Return the plan by merit order from the unheated run (S, N + 1) on; see `bev_plan_merit_order` in core.h."""
    library = core()
    if library is None:
        return None
    arrays, plan = _merit_arrays(trip, idle_states, 'BEV_MERIT_PLAN_MEMORY'), MeritPlanStruct()
    status = library.bev_plan_merit_order(
        vehicle.address, trip.address, byref(goal), *[address_of(array) for array in arrays], byref(plan))
    return _merit_plan(arrays.states, arrays.powers_w, plan) if status == OK else None


class PlanByValues(NamedTuple):
    """Heater commands [W] (N,) of a plan by values; None if the charge does not carry the trip."""

    command_w: FloatArray | None


def plan_by_values(vehicle: NativeVehicle, trip: NativeTrip, target_c: float, lowest_soc: float,
                   is_heating: bool, start: Sequence[float]) -> PlanByValues | None:
    """Return the plan by values from the four states `start` on; see `bev_plan_by_values` in core.h."""
    library = core()
    if library is None:
        return None
    steps = trip.steps
    states, powers_w = np.zeros((4, steps + 1)), np.zeros((4, steps))
    states[:, 0] = start
    goal = ValueGoalStruct(is_heating, target_c, lowest_soc)
    flags = np.zeros(room('BEV_VALUE_BYTES', steps), dtype=np.uint8)
    memory = np.empty(room('BEV_VALUE_MEMORY', steps))
    status = library.bev_plan_by_values(
        vehicle.address, trip.address, byref(goal), address_of(states), address_of(powers_w), address_of(flags),
        address_of(memory))
    if status == EMPTY:
        return PlanByValues(None)
    return PlanByValues(powers_w[0]) if status == OK else None


def heat_early(vehicle: NativeVehicle, trip: NativeTrip, target_c: float,
               uncertainty_margin: UncertaintyMarginStruct, states: FloatArray, powers_w: FloatArray,
               end_s: float | None) -> tuple[MeritPlan | None] | None:
    """
    Return the plan whose last heating interval begins early, in a tuple; (None,) if the plan is unchanged.

    `states` (S, N + 1), `powers_w` (S, N) and `end_s` are those of a MeritPlan; both arrays are written to. See
    `bev_heat_early` in core.h.
    """
    library = core()
    if library is None:
        return None
    plan, is_changed = MeritPlanStruct(math.nan, math.nan if end_s is None else end_s), c_int32()
    memory = np.empty(room('BEV_HEAT_EARLY_MEMORY', trip.steps))
    watched = np.empty((2, trip.steps), dtype=np.uint8)
    status = library.bev_heat_early(
        vehicle.address,
        trip.address,
        target_c,
        byref(uncertainty_margin),
        address_of(states),
        address_of(powers_w),
        address_of(watched),
        address_of(memory),
        byref(plan),
        byref(is_changed))
    if status != OK:
        return None
    return (_merit_plan(states, powers_w, plan) if is_changed.value else None,)


def plan_no_regret(vehicle: NativeVehicle, trip: NativeTrip, goal: SafeGoalStruct,
                   uncertainty_margin: UncertaintyMarginStruct | None,
                   idle_states: FloatArray) -> tuple[MeritPlan | None, int] | None:
    """
    Return the plan by merit order that is no worse than not heating, and what holds it back, a `bev_held_back`.

    None for the plan: no paid heating is better than not heating. From the unheated run (S, N + 1) on; see
    `bev_plan_no_regret` in core.h.
    """
    library = core()
    if library is None:
        return None
    arrays, found = _merit_arrays(trip, idle_states, 'BEV_NO_REGRET_MEMORY'), SafePlanStruct()
    status = library.bev_plan_no_regret(
        vehicle.address, trip.address, byref(goal),
        None if uncertainty_margin is None else byref(uncertainty_margin),
        *[address_of(array) for array in arrays], byref(found))
    if status != OK:
        return None
    return (None if found.is_unheated else _merit_plan(arrays.states, arrays.powers_w, found.plan)
            ), found.held_back


def unheated_deficit(vehicle: NativeVehicle, trip: NativeTrip,
                     start: Sequence[float]) -> tuple[float, Stranded] | None:
    """
    Return the worst power deficit [W] of a trip without paid heating, and its stranding, as `settle`.

    It is driven within the limits from the states `start`, two or, with a heat path, four; see
    `bev_unheated_deficit` in core.h.
    """
    library = core()
    if library is None:
        return None
    memory = np.empty(room('BEV_UNHEATED_MEMORY', trip.steps))
    flags, states = np.empty(2 * trip.steps, dtype=np.uint8), (c_double * len(start))(*start)
    stranding, deficit_w = StrandingStruct(), c_double()
    status = library.bev_unheated_deficit(
        vehicle.address, trip.address, byref(states), address_of(memory), address_of(flags),
        byref(deficit_w), byref(stranding))
    return (deficit_w.value, _stranded(stranding)) if status == OK else None


def find_surplus_ceiling(vehicle: NativeVehicle, trip: NativeTrip, start: Sequence[float],
                         target_c: float, soc: FloatArray) -> FloatArray | None:
    """
    Return how warm surplus may make the battery by the end of each step [deg C], (N,).

    From the states `start`, as of `unheated_deficit`, at the states of charge `soc` (N + 1,); see
    `bev_find_surplus_ceiling` in core.h.
    """
    library = core()
    if library is None:
        return None
    memory = np.empty(room('BEV_SURPLUS_CEILING_MEMORY', trip.steps))
    flags, states = np.empty(2 * trip.steps, dtype=np.uint8), (c_double * len(start))(*start)
    ceiling_c = np.empty(trip.steps)
    status = library.bev_find_surplus_ceiling(
        vehicle.address, trip.address, byref(states), target_c, doubles_at(soc, trip.steps + 1),
        address_of(memory), address_of(flags), address_of(ceiling_c))
    return ceiling_c if status == OK else None


class _MeritArrays(NamedTuple):
    """Arrays that the searches by merit order work on, in the order of their arguments."""

    idle_states: FloatArray
    states: FloatArray
    powers_w: FloatArray
    watched: NDArray[np.uint8]
    order: NDArray[np.int32]
    memory: FloatArray


def _merit_arrays(trip: NativeTrip, idle_states: FloatArray, memory: str) -> _MeritArrays:
    """Return the arrays for a search from the unheated run (S, N + 1), with the memory of that name."""
    idle_states, steps = doubles(idle_states), trip.steps
    return _MeritArrays(
        idle_states, np.empty(idle_states.shape), np.empty((len(idle_states), steps)),
        np.empty(room('BEV_MERIT_BYTES', steps), dtype=np.uint8), np.empty(steps, dtype=np.int32),
        np.empty(room(memory, steps)))


def _merit_plan(states: FloatArray, powers_w: FloatArray, plan: MeritPlanStruct) -> MeritPlan:
    return MeritPlan(states, powers_w, _number(plan.start_s), _number(plan.end_s),
                     _stranded(plan.stranding))


def _number(value: float) -> float | None:
    """Return a number, None for NaN."""
    return None if math.isnan(value) else value


def _stranded(stranding: StrandingStruct) -> Stranded:
    return None if stranding.step < 0 else (stranding.step, stranding.driven_share)
