# SPDX-License-Identifier: Apache-2.0
"""
Plans and accounts of the native core, with arrays in and out.

As in `runs`, each function returns None if the core does not answer.
"""

from __future__ import annotations

from ctypes import addressof, byref, c_double
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native.library import core, OK, SATURATED
from bev_preheat.native.runs import doubles_at, INTEGRATORS, place
from bev_preheat.native.structs import (
    address_of,
    DOUBLE_BYTES,
    ENERGIES,
    room,
    RunOfPowersStruct,
    SwitchPlanStruct,
)

if TYPE_CHECKING:
    from bev_preheat.native.structs import NativeTrip, NativeVehicle
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.model import Integrator


class SwitchedRun(NamedTuple):
    """A run with one switching instant [s]: states (N + 1,), temperatures in deg C, and heater powers [W] (N,)."""

    instant_s: float
    soc: FloatArray
    temperature_c: FloatArray
    heater_power_w: FloatArray


def find_switch(vehicle: NativeVehicle, trip: NativeTrip, target_c: float, idle_soc: FloatArray,
                idle_c: FloatArray) -> SwitchedRun | None:
    """Return the run that arrives at a target [deg C], from the unheated one, (N + 1,) each, which does not."""
    library = core()
    if library is None:
        return None
    run, places = _new_run(trip.steps)
    instant_s = c_double()
    status = library.bev_find_switch(
        vehicle.address, trip.address, target_c, doubles_at(idle_soc, trip.steps + 1),
        doubles_at(idle_c, trip.steps + 1), *places, byref(instant_s))
    return SwitchedRun(instant_s.value, *run) if status in (OK, SATURATED) else None


def plan_switch(vehicle: NativeVehicle, trip: NativeTrip, soc: float, temperature_c: float,
                target_c: float, in_one_interval: bool = True
                ) -> tuple[SwitchPlanStruct | None, SwitchedRun] | None:
    """
    Return the whole plan of a trip on which no limit is active; see core.h.

    If a limit is active, or heating may be cheaper elsewhere, (None, the unheated run) is returned.
    """
    library = core()
    if library is None:
        return None
    run, places = _new_run(trip.steps)
    memory, found = np.empty(room('BEV_SWITCH_MEMORY', trip.steps)), SwitchPlanStruct()
    status = library.bev_plan_switch(
        vehicle.address, trip.address, soc, temperature_c, target_c, in_one_interval,
        place(memory), *places, addressof(found))
    if status > OK:
        # The memory begins with the unheated run.
        idle = memory[:2 * trip.steps + 2].reshape(2, -1).copy()
        return None, SwitchedRun(math.nan, idle[0], idle[1], np.zeros(trip.steps))
    return (found, SwitchedRun(found.switching_instant_s, *run)) if status == OK else None


def plan_paper(vehicle: NativeVehicle, trip: NativeTrip, soc: float, temperature_c: float,
               target_c: float) -> tuple[SwitchPlanStruct, SwitchedRun] | None:
    """Return the whole plan of the paper's heuristic; None if a limit is active. See core.h."""
    library = core()
    if library is None:
        return None
    run, places = _new_run(trip.steps)
    memory, found = np.empty(room('BEV_SWITCH_MEMORY', trip.steps)), SwitchPlanStruct()
    status = library.bev_plan_paper(
        vehicle.address, trip.address, soc, temperature_c, target_c, place(memory), *places,
        addressof(found))
    return (found, SwitchedRun(found.switching_instant_s, *run)) if status == OK else None


def _new_run(steps: int) -> tuple[tuple[FloatArray, FloatArray, FloatArray], tuple[int, int, int]]:
    """Return arrays for charge, temperature and heater power, and their addresses."""
    block = np.empty(3 * steps + 2)
    at = addressof(c_double.from_buffer(block))  # type: ignore[arg-type]
    after, end = steps + 1, 2 * steps + 2
    return ((block[:after], block[after:end], block[end:]),
            (at, at + DOUBLE_BYTES * after, at + DOUBLE_BYTES * end))


def find_prices(vehicle: NativeVehicle, trip: NativeTrip, soc: FloatArray, temperature_c: FloatArray,
                heater_w: FloatArray) -> FloatArray | None:
    """Return the effect on arrival of a watt in each step, warmth [K/W] and charge [1/W], (2, N); see core.h."""
    library = core()
    if library is None:
        return None
    prices = np.empty((2, trip.steps))
    status = library.bev_find_prices(
        vehicle.address, trip.address, doubles_at(soc, trip.steps + 1),
        doubles_at(temperature_c, trip.steps + 1), doubles_at(heater_w, trip.steps), place(prices),
        place(prices, DOUBLE_BYTES * trip.steps))
    return prices if status == OK else None


class TwiceSwitchedRun(NamedTuple):
    """A run that is heated between two instants [s]: states (4, N + 1), heater commands [W] (N,)."""

    on_s: float
    off_s: float
    states: FloatArray
    command_w: FloatArray


def find_two_switches(vehicle: NativeVehicle, trip: NativeTrip, target_c: float,
                      idle_states: FloatArray) -> TwiceSwitchedRun | None:
    """Return the run that arrives at a target [deg C], from the unheated one (4, N + 1), which does not."""
    library = core()
    if library is None:
        return None
    states, command_w = np.empty((4, trip.steps + 1)), np.empty(trip.steps)
    instants_s = (c_double * 2)()
    status = library.bev_find_two_switches(
        vehicle.address, trip.address, target_c, place(idle_states),
        place(np.empty(room('BEV_TWO_SWITCHES_MEMORY', trip.steps))), place(states), place(command_w),
        byref(instants_s), byref(instants_s, DOUBLE_BYTES))
    return TwiceSwitchedRun(instants_s[0], instants_s[1], states, command_w) if status == OK else None


def heat_along(vehicle: NativeVehicle, trip: NativeTrip, states: FloatArray, command_w: FloatArray,
               brake_w: FloatArray) -> FloatArray | None:
    """Return means of heater power and of the heat that arrives [W], (2, N), along states (4, N + 1)."""
    library = core()
    if library is None:
        return None
    heat_w = np.empty((2, trip.steps))
    status = library.bev_heat_along(
        vehicle.address, trip.address, place(states), doubles_at(command_w, trip.steps),
        doubles_at(brake_w, trip.steps), place(heat_w))
    return heat_w if status == OK else None


def keep_accounts(vehicle: NativeVehicle, make_integrator: Integrator, trip: NativeTrip,
                  deliverable: bool, soc: FloatArray, temperature_c: FloatArray, heater_w: FloatArray,
                  arriving_heat_w: FloatArray | None,
                  brake_w: FloatArray) -> tuple[list[float], FloatArray] | None:
    """
    Return energies [Wh], as ENERGIES, and means over each step [W], (4, N), of a run.

    The means are Joule heat, leakage, power of the cells, and deficit of the circuit; see core.h.
    """
    library, integrator = core(), INTEGRATORS.get(make_integrator)
    if library is None or integrator is None:
        return None
    columns, energies_wh = np.empty((4, trip.steps)), (c_double * len(ENERGIES))()
    kept = [array if array is None else np.ascontiguousarray(array, dtype=float)
            for array in (soc, temperature_c, heater_w, arriving_heat_w, brake_w)]
    run = RunOfPowersStruct(deliverable, *map(address_of, kept))
    status = library.bev_keep_accounts(
        vehicle.address, integrator, trip.address, addressof(run), place(columns),
        addressof(energies_wh))
    return (energies_wh[:], columns) if status == OK else None
