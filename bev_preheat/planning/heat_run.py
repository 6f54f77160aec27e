# SPDX-License-Identifier: Apache-2.0
"""
Forward runs of a vehicle with a heat path: heater and coolant are states beside charge and temperature.

The equations are those of `vehicle.heat_path`. A vehicle without one has no HeatRun: its runs are
exactly those of `dynamics`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, partial
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import ARRAYS, FloatArray, FLOATS, JOULES_PER_WH, SATURATING_FLOATS
from bev_preheat.planning.dynamics import rolled
from bev_preheat.planning.schedule import HeatRun, Schedule
from bev_preheat.planning.situation import BatteryState
from bev_preheat.tunables import HEATING_SHARE
from bev_preheat.vehicle.heat_path import HeatedStep, make_heated_step
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat.vehicle.variants import KEPT_VEHICLES

if TYPE_CHECKING:
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import HeatPath, Vehicle

# State of charge, battery temperature [deg C], heater power [W], coolant excess [K].
States = tuple[float, float, float, float]


@lru_cache(maxsize=KEPT_VEHICLES)
def heated_step_of_floats(vehicle: Vehicle, saturating: bool) -> HeatedStep[float]:
    """Return `make_heated_step` for floats, cached; it raises ValueError beyond the power unless `saturating`."""
    return make_heated_step(vehicle, SATURATING_FLOATS if saturating else FLOATS)


@lru_cache(maxsize=KEPT_VEHICLES)
def _heated_step_of_arrays(vehicle: Vehicle) -> HeatedStep[FloatArray]:
    return make_heated_step(vehicle, ARRAYS)


def initial_states(state: BatteryState) -> States:
    """Return the States at the start of a trip."""
    return state.soc, state.temperature_c, state.heater_power_w, state.coolant_excess_k


def roll_heated(trip: Trip, start: States, command_w: FloatArray, first: int = 0) -> FloatArray:
    """Return the States, as rows, from step `first` on under heater commands [W] (N,), ignoring limits."""
    return rolled(partial(heated_step_of_floats, trip.vehicle), start, [
        column[first:].tolist() for column in (*trip.inputs(), command_w)])


def run_heated(trip: Trip, start: States, command_w: FloatArray, heating_start_s: float | None) -> Schedule:
    """Return the Schedule of a run under heater commands [W] (N,), ignoring limits."""
    states = roll_heated(trip, start, command_w)
    return along_states(trip, states, command_w, np.zeros(len(trip.route)), heating_start_s)


def along_states(trip: Trip, states: Sequence[FloatArray] | FloatArray, command_w: FloatArray,
                 brake_power_w: FloatArray, heating_start_s: float | None) -> Schedule:
    """Return the Schedule of a run with known States (4, N + 1) under commands and brake powers [W] (N,)."""
    soc, temperature_c, heater_w, excess_k = states
    *_, drawn_w, arriving_w = _heated_step_of_arrays(trip.vehicle)(
        soc[:-1], temperature_c[:-1], heater_w[:-1], excess_k[:-1],
        *trip.inputs(None, brake_power_w), command_w)
    return with_heat(trip, states, command_w, brake_power_w, heating_start_s, (drawn_w, arriving_w))


def with_heat(trip: Trip, states: Sequence[FloatArray] | FloatArray, command_w: FloatArray,
              brake_power_w: FloatArray, heating_start_s: float | None,
              heat_w: tuple[FloatArray, FloatArray]) -> Schedule:
    """Return `along_states` of a run whose means of heater power and arriving heat [W] are known, (N,) each."""
    soc, temperature_c, heater_w, excess_k = states
    lost_wh = trip.vehicle.heat_path.heater_lag_s * float(heater_w[-1]) / JOULES_PER_WH
    return Schedule(
        heating_start_s, command_w, brake_power_w, soc, temperature_c, make_runge_kutta_4,
        ends_before_arrival_s(trip, command_w), heat=HeatRun(heater_w, excess_k, *heat_w, lost_wh))


def ends_before_arrival_s(trip: Trip, command_w: FloatArray) -> float | None:
    """Return the end of the last heated step [s]; None if that is the arrival, or without heating."""
    heated = np.flatnonzero(command_w > HEATING_SHARE * trip.heater_limit_w)
    if not len(heated) or heated[-1] + 1 == len(trip.route):
        return None
    return float(trip.time_s[heated[-1] + 1])


def heated_heat_capacity_j_per_k(vehicle: Vehicle) -> float:
    """Return the heat capacity of the battery and of the coolant between heater and battery [J/K]."""
    return vehicle.battery.heat_capacity_j_per_k + vehicle.heat_path.coolant_heat_capacity_j_per_k


def heat_to_come_k(vehicle: Vehicle) -> tuple[float, float]:
    """Return the rise [K] per watt of the heater and kelvin of coolant excess, once battery and coolant meet."""
    path, both_j_per_k = vehicle.heat_path, heated_heat_capacity_j_per_k(vehicle)
    return (vehicle.hvch.efficiency * path.heater_lag_s / both_j_per_k,
            path.coolant_heat_capacity_j_per_k / both_j_per_k)


def state_with_heat_under_way(vehicle: Vehicle, temperature_c: float, soc: float,
                              under_way_k: float) -> BatteryState:
    """
    Return the BatteryState of a vehicle whose heat under way will warm it by `under_way_k` kelvin.

    The heat is divided between coolant and heater as under a steady command, whose division does not depend on the
    command: the actual division is not measured.
    """
    path, heater = vehicle.heat_path, vehicle.hvch
    under_way_j = under_way_k * heated_heat_capacity_j_per_k(vehicle)
    heater_w = min(under_way_j / (heater.efficiency * path.heat_lag_s), heater.maximum_power_w)
    excess_k = (heater.efficiency * heater_w / path.coolant_conductance_w_per_k
                if path.has_coolant else 0.0)
    return BatteryState(temperature_c, soc, heater_w, excess_k)


def mean_share_left(path: HeatPath, duration_s: FloatArray) -> FloatArray:
    """Return the remaining share of a difference between heater and command, on average over steps (N,)."""
    if path.heater_lag_s == 0.0:
        return np.zeros(len(duration_s))
    return np.array([-math.expm1(-each_s / path.heater_lag_s) * path.heater_lag_s / each_s
                     for each_s in duration_s.tolist()])
