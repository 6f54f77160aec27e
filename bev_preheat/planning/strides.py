# SPDX-License-Identifier: Apache-2.0
"""
A trip in strides, and where each stride leads from each temperature, unheated and heated.

A stride is one step, or several in which no limit matters: what a kelvin is worth changes slowly.
The maps are worked out on a grid of temperatures, all strides at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.compiled import runs as compiled_runs
from bev_preheat.numerics.arithmetic import ARRAYS
from bev_preheat.planning.dynamics import compiled_vehicle
from bev_preheat.planning.limits import Watch
from bev_preheat.vehicle.model import make_rates, make_runge_kutta_4
from bev_preheat.vehicle.terminal_limits import make_terminal_limits

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.charge_acceptance import AcceptanceLoss
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import Vehicle

# Steps in which no limit matters are taken together up to this long: the curve changes slowly.
LONGEST_STRIDE_S = 60.0


@dataclass(frozen=True)
class Strides:
    """
    The M strides of a trip, arrays of shape (M,).

    `first` is the first step of each, `end_c` the temperature [deg C] about which its end is needed,
    `loss_to_brake` and `loss_to_heater` are those of an AcceptanceLoss. The means over a stride:
    `idle_power_w`, `power_variance_w2`, `idle_heat_w`, `leakage_w_per_k`, `heater_limit_w` and
    `propulsion_w`, as in Trip.
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

    def __len__(self) -> int:
        """Return the number of strides."""
        return len(self.first)


def make_strides(trip: Trip, watch: Watch, run: Schedule, loss: AcceptanceLoss) -> Strides:
    """Return the Strides of a trip along a run (a Schedule); limits matter where `watch` says so."""
    first = _first_steps(trip.route.duration_s.tolist(), (watch.charge | watch.discharge).tolist())
    duration_s = np.add.reduceat(trip.route.duration_s, first)

    def mean(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values * trip.route.duration_s, first) / duration_s

    return Strides(
        first=first, duration_s=duration_s,
        idle_power_w=mean(trip.idle_power_w), power_variance_w2=mean(trip.power_variance_w2),
        idle_heat_w=mean(trip.idle_heat_w), leakage_w_per_k=mean(trip.leakage_w_per_k),
        heater_limit_w=mean(trip.heater_limit_w),
        propulsion_w=mean(trip.route.propulsion_power_w),
        soc=run.soc[first],
        end_c=run.temperature_c[np.append(first[1:], len(trip.route))],
        loss_to_brake=loss.to_brake[first], loss_to_heater=loss.to_heater[first],
        may_overcharge=watch.charge[first], may_overdraw=watch.discharge[first])


def _first_steps(durations_s: list[float], are_limited: list[bool]) -> IntArray:
    """First steps of the strides: a step in which limits matter is a stride of its own."""
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
    Where one stride ends, `end_c` [deg C], and what it takes, `energy_j` [J], from each `start_c`.

    Shapes (G,). `needed_c` is the temperature from which on the battery delivers what the stride
    asks without heating; -inf where it always does.
    """

    start_c: FloatArray
    end_c: FloatArray
    energy_j: FloatArray
    needed_c: float


@dataclass(frozen=True)
class StrideMaps:
    """The maps of M strides: `start_c` (G,), `end_c` and `energy_j` (M, G), `needed_c` (M,)."""

    start_c: FloatArray
    end_c: FloatArray
    energy_j: FloatArray
    needed_c: FloatArray

    def __getitem__(self, m: int) -> StrideMap:
        """Return the StrideMap of stride m."""
        return StrideMap(self.start_c, self.end_c[m], self.energy_j[m], float(self.needed_c[m]))


def map_strides(vehicle: Vehicle, strides: Strides, grid_c: FloatArray,
                penalty: float) -> tuple[StrideMaps, StrideMaps]:
    """
    Return the maps of all strides with free heating only, and with all the heating there is.

    A watt that the battery lacks costs `penalty` times what the heater takes for it.
    """
    compiled = compiled_vehicle(vehicle)
    mapped = None if compiled is None else compiled_runs.map_strides(
        compiled, (strides.duration_s, strides.idle_power_w, strides.power_variance_w2,
                   strides.idle_heat_w, strides.leakage_w_per_k, strides.heater_limit_w,
                   strides.propulsion_w, strides.soc),
        strides.may_overcharge | strides.may_overdraw, grid_c, penalty)
    if mapped is not None:
        (unheated_c, unheated_j, heated_c, heated_j), needed_c = mapped
        return (StrideMaps(grid_c, unheated_c, unheated_j, needed_c),
                StrideMaps(grid_c, heated_c, heated_j, needed_c))
    power_w, variance_w2, heat_w, leakage_w_per_k, soc, duration_s, limit_w = (
        column[:, np.newaxis] for column in (
            strides.idle_power_w, strides.power_variance_w2, strides.idle_heat_w,
            strides.leakage_w_per_k, strides.soc, strides.duration_s, strides.heater_limit_w))
    start_c = np.broadcast_to(grid_c, (len(strides), len(grid_c)))
    surplus_w, lacking_w, room_w = _at_the_limits(vehicle, strides, start_c)
    needed_c = _needed_c(grid_c, lacking_w)
    step = make_runge_kutta_4(make_rates(vehicle, ARRAYS))

    def maps_of(heater_w: FloatArray) -> StrideMaps:
        brake_w = surplus_w - np.minimum(heater_w, surplus_w)
        terminal_w = power_w + heater_w + brake_w
        _, end_c, _, joule_w = step(
            soc, start_c, duration_s, terminal_w, variance_w2,
            heat_w + vehicle.hvch.efficiency * heater_w
            - vehicle.drivetrain.heat_share * brake_w, leakage_w_per_k)
        energy_j = duration_s * (terminal_w + joule_w + penalty * lacking_w)
        return StrideMaps(grid_c, end_c, energy_j, needed_c)

    free_w = np.minimum(limit_w, surplus_w)
    return maps_of(free_w), maps_of(np.maximum(room_w, free_w))


def _at_the_limits(vehicle: Vehicle, strides: Strides,
                   start_c: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return what the battery does not take, what it lacks, and what it leaves the heater [W].

    Of each stride from each temperature, shapes (M, G).
    """
    limit_w = strides.heater_limit_w[:, np.newaxis]
    surplus_w, lacking_w = np.zeros(start_c.shape), np.zeros(start_c.shape)
    room_w = np.broadcast_to(limit_w, start_c.shape).copy()
    near = strides.may_overcharge | strides.may_overdraw
    if near.any():
        power_w = strides.idle_power_w[near, np.newaxis]
        least_w, most_w = make_terminal_limits(vehicle, ARRAYS)(
            strides.soc[near, np.newaxis], start_c[near],
            strides.power_variance_w2[near, np.newaxis])
        surplus_w[near] = np.clip(least_w - power_w, 0.0, np.maximum(
            -strides.propulsion_w[near, np.newaxis], 0.0))
        lacking_w[near] = np.maximum(power_w - most_w, 0.0)
        room_w[near] = np.clip(most_w - power_w, 0.0, limit_w[near])
    return surplus_w, lacking_w, room_w


def _needed_c(grid_c: FloatArray, lacking_w: FloatArray) -> FloatArray:
    """Temperatures [deg C] from which on nothing is lacking in each stride; -inf where nothing is."""
    needed_c = np.full(len(lacking_w), -np.inf)
    for m in np.flatnonzero((lacking_w > 0.0).any(axis=1)).tolist():
        row_w = lacking_w[m]
        last = int(np.flatnonzero(row_w > 0.0)[-1])
        before = max(last - 1, 0)
        slope = (row_w[before] - row_w[last]) / max(grid_c[last] - grid_c[before], 1e-9)
        needed_c[m] = grid_c[last] + (row_w[last] / slope if slope > 0.0 else 0.0)
    return needed_c
