# SPDX-License-Identifier: Apache-2.0
"""
Divides a trip into strides, and maps the outcome of each stride over temperature, unheated and heated.

A stride is one step, or several steps without an active limit, because the worth of a kelvin changes slowly.
The maps are computed on a grid of temperatures; each stride uses the part of the grid that the battery can
reach in it, whatever is heated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.wanted_heat import LimitedSteps
from bev_preheat.vehicle.heat_balance import heat_under_w
from bev_preheat.vehicle.model import make_midpoint, make_rates
from bev_preheat.vehicle.terminal_limits import make_terminal_limits

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.charge_acceptance import AcceptanceLoss
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import Vehicle

# Steps without an active limit are merged up to this length: the curve changes slowly.
LONGEST_STRIDE_S = 60.0
# Margin below the temperatures that the run and the heater can reach: a colder battery regenerates less, and
# regeneration that it rejects heats neither drivetrain nor cells.
COLDER_MARGIN_K = 8.0
WARMER_MARGIN_K = 5.0
# Without an active limit a stride's map is nearly straight, and the first pass need not be sharp: every
# COARSE-th point of the grid is enough.
COARSE = 4
# After the first pass the battery stays this near to the run. A run that is paid to arrive more than the second
# value above the target will not be the result.
NEAR_K = 10.0
NEAR_TARGET_K = 5.0
# The slope of a map is taken over a piece that is at least so wide.
LEAST_WIDTH_K = 1e-9


@dataclass(frozen=True)
class Strides:
    """
    The M strides of a trip, arrays of shape (M,).

    `first` is the first step of each stride, `end_c` the temperature [deg C] about which the map's end matters,
    `loss_to_brake` and `loss_to_heater` are those of an AcceptanceLoss. Means over a stride:
    `idle_power_w`, `power_variance_w2`, `idle_heat_w`, `leakage_w_per_k`, `heater_limit_w` and
    `propulsion_w`, as in Trip. Each stride uses every `every`-th point of the grid. `coldest_c` and
    `warmest_c` (M + 1,) bound the battery temperature at the start of each stride and on
    arrival [deg C].
    """

    first: IntArray
    duration_s: FloatArray
    idle_power_w: FloatArray
    power_variance_w2: FloatArray
    idle_heat_w: FloatArray
    leakage_w_per_k: FloatArray
    heater_limit_w: FloatArray
    propulsion_w: FloatArray
    soc: FloatArray
    end_c: FloatArray
    loss_to_brake: FloatArray
    loss_to_heater: FloatArray
    may_overcharge: BoolArray
    may_overdraw: BoolArray
    every: IntArray
    coldest_c: FloatArray
    warmest_c: FloatArray

    def __len__(self) -> int:
        """Return the number of strides."""
        return len(self.first)


def make_strides(trip: Trip, watch: LimitedSteps, run: Schedule, loss: AcceptanceLoss, target_c: float,
                 is_first_look: bool = False) -> Strides:
    """
    Return the Strides of a trip along a run (a Schedule); limits matter in the steps of `watch`.

    In the first pass the run may be far from the result. It is to arrive at the target [deg C].
    """
    first = _first_steps(trip.route.duration_s.tolist(), (watch.charge | watch.discharge).tolist())
    duration_s = np.add.reduceat(trip.route.duration_s, first)
    instants = np.append(first, len(trip.route))
    coldest_c, warmest_c = _reach_c(trip, run)
    if not is_first_look:
        too_warm_k = min(float(run.temperature_c[-1]) - target_c, _paid_k(trip, run)) - NEAR_TARGET_K
        coldest_c = np.maximum(coldest_c, run.temperature_c - (NEAR_K + max(too_warm_k, 0.0)))
        warmest_c = np.minimum(warmest_c, run.temperature_c + NEAR_K)
    is_limited = watch.charge[first] | watch.discharge[first]

    def mean(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values * trip.route.duration_s, first) / duration_s

    return Strides(
        first=first, duration_s=duration_s,
        idle_power_w=mean(trip.idle_power_w), power_variance_w2=mean(trip.power_variance_w2),
        idle_heat_w=mean(trip.idle_heat_w), leakage_w_per_k=mean(trip.leakage_w_per_k),
        heater_limit_w=mean(trip.heater_limit_w),
        propulsion_w=mean(trip.route.propulsion_power_w),
        soc=run.soc[first],
        end_c=run.temperature_c[instants[1:]],
        loss_to_brake=loss.to_brake[first], loss_to_heater=loss.to_heater[first],
        may_overcharge=watch.charge[first], may_overdraw=watch.discharge[first],
        every=np.where(is_limited & (not is_first_look), 1, COARSE),
        coldest_c=coldest_c[instants], warmest_c=warmest_c[instants])


def _paid_k(trip: Trip, run: Schedule) -> float:
    """Return by how much a run is warmed in steps without regeneration [K], ignoring leakage."""
    paid_w = np.where(trip.route.propulsion_power_w < 0.0, 0.0, run.heater_power_w)
    return (trip.vehicle.hvch.efficiency * float((paid_w * trip.route.duration_s).cumsum()[-1])
            / trip.vehicle.battery.heat_capacity_j_per_k)


def _reach_c(trip: Trip, run: Schedule) -> tuple[FloatArray, FloatArray]:
    """
    Return the coldest and the warmest possible battery at each instant [deg C], (N + 1,).

    Approximate: the run without its heat, and with all heat the heater could have added. Leakage only makes
    the difference smaller. The run lies between the two, even if the coolant took more heat than
    it gave.
    """
    heater_w = trip.vehicle.hvch.efficiency * trip.heater_limit_w
    arrived_w = (trip.vehicle.hvch.efficiency * run.heater_power_w if run.heat is None
                 else run.heat.arriving_heat_w)
    braked_w = trip.vehicle.drivetrain.heat_share * run.brake_power_w

    def warmed_k(power_w: FloatArray) -> FloatArray:
        joules = np.concatenate(([0.0], np.cumsum(power_w * trip.route.duration_s)))
        return joules / trip.vehicle.battery.heat_capacity_j_per_k

    return (run.temperature_c - np.maximum(warmed_k(arrived_w) + COLDER_MARGIN_K, 0.0),
            run.temperature_c + warmed_k(np.maximum(heater_w - arrived_w, 0.0) + braked_w)
            + WARMER_MARGIN_K)


def _first_steps(durations_s: list[float], are_limited: list[bool]) -> IntArray:
    """Return the first steps of the strides: a step in which limits matter is a stride of its own."""
    starts: list[int] = []
    length_s, before_limited = np.inf, True
    for k, (duration_s, is_limited) in enumerate(zip(durations_s, are_limited)):
        if is_limited or before_limited or length_s + duration_s > LONGEST_STRIDE_S:
            starts.append(k)
            length_s = 0.0
        length_s += duration_s
        before_limited = is_limited
    return np.array(starts)


@dataclass(frozen=True)
class StrideMap:
    """
    End temperature `end_c` [deg C] and energy `energy_j` [J] of one stride, from each `start_c`.

    Shapes (G,). `needed_c` is the lowest temperature at which the battery delivers the stride's power
    without heating; -inf if it always does.
    """

    start_c: FloatArray
    end_c: FloatArray
    energy_j: FloatArray
    needed_c: float


@dataclass(frozen=True)
class StrideMaps:
    """
    The maps of M strides: `start_c` (G,), `end_c` and `energy_j` (M, G), `needed_c` (M,).

    Stride m uses every `every[m]`-th point, from `first[m]` up to, not including, `last[m]`.
    """

    start_c: FloatArray
    end_c: FloatArray
    energy_j: FloatArray
    needed_c: FloatArray
    first: IntArray
    last: IntArray
    every: IntArray

    def __getitem__(self, m: int) -> StrideMap:
        """Return the StrideMap of stride m."""
        used = slice(self.first[m], self.last[m], self.every[m])
        # Far beyond its limits a warmer battery may end colder; a map must not fall.
        return StrideMap(self.start_c[used], np.maximum.accumulate(self.end_c[m, used]),
                         self.energy_j[m, used], float(self.needed_c[m]))


def map_strides(vehicle: Vehicle, strides: Strides, grid_c: FloatArray,
                penalty: float) -> tuple[StrideMaps, StrideMaps]:
    """
    Return the maps of all strides with free heating only, and with all possible heating.

    A watt of power deficit costs `penalty` times the heater's energy for it.
    """
    power_w, variance_w2, heat_w, leakage_w_per_k, soc, duration_s, limit_w = (
        column[:, np.newaxis] for column in (
            strides.idle_power_w, strides.power_variance_w2, strides.idle_heat_w,
            strides.leakage_w_per_k, strides.soc, strides.duration_s, strides.heater_limit_w))
    start_c = np.broadcast_to(grid_c, (len(strides), len(grid_c)))
    surplus_w, deficit_w, room_w = _at_the_limits(vehicle, strides, start_c)
    first, last = _points_used(grid_c, strides)
    needed_c = _needed_c(grid_c, deficit_w, first, last, strides.every)
    step = make_midpoint(make_rates(vehicle, ARRAYS))

    def maps_of(heater_w: FloatArray) -> StrideMaps:
        brake_w = surplus_w - np.minimum(heater_w, surplus_w)
        terminal_w = power_w + heater_w + brake_w
        _, end_c, _, joule_w = step(
            soc, start_c, duration_s, terminal_w, variance_w2,
            heat_under_w(vehicle, heat_w, heater_w, brake_w), leakage_w_per_k)
        energy_j = duration_s * (terminal_w + joule_w + penalty * deficit_w)
        return StrideMaps(grid_c, end_c, energy_j, needed_c, first, last, strides.every)

    free_w = np.minimum(limit_w, surplus_w)
    return maps_of(free_w), maps_of(np.maximum(room_w, free_w))


def _at_the_limits(vehicle: Vehicle, strides: Strides,
                   start_c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return the surplus that the battery rejects, the power deficit, and the power left for the heater [W].

    For each stride from each temperature, shapes (M, G).
    """
    limit_w = strides.heater_limit_w[:, np.newaxis]
    surplus_w, deficit_w = np.zeros(start_c.shape), np.zeros(start_c.shape)
    room_w = np.broadcast_to(limit_w, start_c.shape).copy()
    near = strides.may_overcharge | strides.may_overdraw
    if near.any():
        power_w = strides.idle_power_w[near, np.newaxis]
        least_w, most_w = make_terminal_limits(vehicle, ARRAYS)(
            strides.soc[near, np.newaxis], start_c[near],
            strides.power_variance_w2[near, np.newaxis])
        surplus_w[near] = np.clip(least_w - power_w, 0.0, np.maximum(
            -strides.propulsion_w[near, np.newaxis], 0.0))
        deficit_w[near] = np.maximum(power_w - most_w, 0.0)
        room_w[near] = np.clip(most_w - power_w, 0.0, limit_w[near])
    return surplus_w, deficit_w, room_w


def _points_used(grid_c: FloatArray, strides: Strides) -> tuple[IntArray, IntArray]:
    """
    Return the first point of the grid that each stride uses, and the last + 1, (M,).

    At least two points. If points are skipped, the last one is at or above the warmest temperature, provided
    that the grid extends that far.
    """
    every = strides.every
    first = np.clip(np.searchsorted(grid_c, strides.coldest_c[:-1]) - 1, 0, len(grid_c) - 1 - every)
    last = np.clip(np.searchsorted(grid_c, strides.warmest_c[:-1]) + 1, first + 2, len(grid_c))
    pieces = np.minimum(-((first + 1 - last) // every), (len(grid_c) - 1 - first) // every)
    return first, first + pieces * every + 1


def _needed_c(grid_c: FloatArray, deficit_w: FloatArray, first: IntArray,
              last: IntArray, every: IntArray) -> FloatArray:
    """Return the lowest temperature [deg C] without a deficit in each stride; -inf if it never has one."""
    needed_c = np.full(len(deficit_w), -np.inf)
    for m in np.flatnonzero((deficit_w > 0.0).any(axis=1)).tolist():
        used = slice(first[m], last[m], every[m])
        row_c, row_w = grid_c[used], deficit_w[m, used]
        deficit = np.flatnonzero(row_w > 0.0)
        if not len(deficit):
            continue
        at = int(deficit[-1])
        before = max(at - 1, 0)
        slope = (row_w[before] - row_w[at]) / max(row_c[at] - row_c[before], LEAST_WIDTH_K)
        needed_c[m] = row_c[at] + (row_w[at] / slope if slope > 0.0 else 0.0)
    return needed_c
