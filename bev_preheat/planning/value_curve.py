# SPDX-License-Identifier: Apache-2.0
"""
What a kelvin is worth: the battery energy that the rest of a trip costs, over temperature.

Algorithm 2 of the paper runs one temperature backward from the target, heated all the way: below it
heating must be on. Here a whole curve runs backward: V_k(T), the battery energy that the rest of the
trip costs from temperature T on, limits and all (dynamic programming). Its slope says what a kelvin
is worth. Heating pays in a step where a kelvin is worth more than the heater takes for it, which as
a rule is so below one temperature, the *threshold* of the step. Without limits V_N is a step at the
target, and the thresholds are the temperatures of Algorithm 2. A very cold battery takes hardly any
regeneration, however much it is heated, so before a descent heating may pay in a band only.

A joule taken from the battery counts as what it is worth on arrival: before a descent at the charge
limit that is less than a joule (`charge_acceptance`).

The curve's points move with the vehicle's own dynamics, heated below the threshold and unheated
above it, so its kinks stay sharp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.arithmetic import ARRAYS
from bev_preheat.model import make_rates, make_runge_kutta_4
from bev_preheat.planning.limits import make_terminal_limits, Watch

if TYPE_CHECKING:
    from bev_preheat.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.charge_acceptance import AcceptanceLoss
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.description import Vehicle

# Steps in which no limit matters are taken together up to this long: the curve changes slowly.
LONGEST_STRIDE_S = 60.0
# A kelvin below the target, or a watt that the battery lacks, costs this many times what the heater
# takes for it, so that nothing is saved there.
PENALTY = 30.0
# The curve reaches this far beyond the temperatures that the trip can take.
MARGIN_K = 10.0
# Temperatures at which each step is worked out; in between it is interpolated.
GRID_POINTS = 64
# The curve's points: not further apart, and if there are more, those that say less [J] go.
WIDEST_GAP_K = 1.0
MOST_POINTS = 64
CURVE_TOLERANCE_J = 100.0
# Heating that makes no more difference than this [J] is no decision.
INDIFFERENCE_J = 10.0
# Bands of temperature in which heating pays: below what must be reached, and before a descent.
BANDS = 2
# What a kelvin is worth is taken over this difference, which smooths the curve's kinks.
SLOPE_K = 1.0
# Thresholds of one stride and the next that are further apart belong to different bands [K].
NEIGHBOUR_K = 3.0
# Floor, low and high of Thresholds [deg C].
Band = tuple[float, float, float]


@dataclass(frozen=True)
class Thresholds:
    """
    Where heating pays in step k: bands of temperature, at most BANDS of them, shape (N, BANDS).

    At full power from `floor_c` to `low_c`, not at all from `high_c`, in between in proportion: the
    step in which the threshold is reached. A band that starts at a floor is one of investment: from
    below it, all that heating could still do before a descent would not earn what it costs. An empty
    band has floor_c = inf.
    """

    floor_c: FloatArray
    low_c: FloatArray
    high_c: FloatArray


@dataclass(frozen=True)
class _Strides:
    """The trip in strides: steps taken together where no limit matters; arrays of shape (M,)."""

    first: IntArray
    duration_s: FloatArray
    columns: tuple[FloatArray, ...]
    cap_w: FloatArray
    propulsion_w: FloatArray
    soc: FloatArray
    end_c: FloatArray
    loss_to_brake: FloatArray
    loss_to_heater: FloatArray
    may_overcharge: BoolArray
    may_overdraw: BoolArray


def _make_strides(trip: Trip, watch: Watch, run: Schedule, loss: AcceptanceLoss) -> _Strides:
    limited = (watch.charge | watch.discharge).tolist()
    durations = trip.route.duration_s.tolist()
    starts: list[int] = []
    length_s, before_limited = np.inf, True
    for k, (duration_s, is_limited) in enumerate(zip(durations, limited)):
        if is_limited or before_limited or length_s + duration_s > LONGEST_STRIDE_S:
            starts.append(k)
            length_s = 0.0
        length_s += duration_s
        before_limited = is_limited
    first = np.array(starts)
    duration_s = np.add.reduceat(trip.route.duration_s, first)

    def mean(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values * trip.route.duration_s, first) / duration_s

    return _Strides(
        first=first, duration_s=duration_s,
        columns=tuple(mean(column) for column in (
            trip.idle_power_w, trip.power_variance_w2, trip.idle_heat_w, trip.leakage_w_per_k)),
        cap_w=mean(trip.heater_limit_w),
        propulsion_w=mean(trip.route.propulsion_power_w),
        soc=run.soc[first],
        end_c=run.temperature_c[np.append(first[1:], len(limited))],
        loss_to_brake=loss.to_brake[first], loss_to_heater=loss.to_heater[first],
        may_overcharge=watch.charge[first], may_overdraw=watch.discharge[first])


def find_thresholds(trip: Trip, watch: Watch, run: Schedule, target_c: float, loss: AcceptanceLoss,
                    serves_climbs: bool = True) -> Thresholds:
    """
    Return the Thresholds of a trip, by running the value curve backward.

    `run` (a Schedule) says along which states of charge, and about which temperatures, the curve
    is needed, and the AcceptanceLoss `loss` what charge is worth. Without `serves_climbs` a power
    that the battery lacks costs nothing.
    """
    battery, hvch = trip.vehicle.battery, trip.vehicle.hvch
    strides = _make_strides(trip, watch, run, loss)
    # Outside its range the battery is not described, and beyond its highest temperature not heated.
    lowest_c, highest_c = battery.temperature_range_c
    coldest_c = max(min(run.temperature_c.min(), target_c) - MARGIN_K, lowest_c)
    warmest_c = min(max(run.temperature_c.max(), target_c), highest_c) + 2.0 * MARGIN_K
    grid_c = np.linspace(max(coldest_c - MARGIN_K, lowest_c), warmest_c, GRID_POINTS)
    idle, full = _step_maps(trip.vehicle, strides, grid_c, PENALTY if serves_climbs else 0.0)
    k_per_joule = hvch.efficiency / battery.heat_capacity_j_per_k
    price_j_per_k = PENALTY / k_per_joule
    curve_c = np.unique(np.append(grid_c, target_c))
    value_j = price_j_per_k * np.maximum(target_c - curve_c, 0.0)
    count = len(strides.first)
    bands_c = np.full((3, count, BANDS), -np.inf)
    bands_c[0] = np.inf
    # What a joule in the battery is worth on arrival [J].
    worth = 1.0
    for m in range(count - 1, -1, -1):
        ends_c, ends_j = curve_c, value_j
        idle_c = np.interp(curve_c, idle.end_c[m], grid_c)
        full_c = np.interp(curve_c, full.end_c[m], grid_c)
        idle_j = value_j + worth * np.interp(curve_c, idle.end_c[m], idle.energy_j[m])
        full_j = value_j + worth * np.interp(curve_c, full.end_c[m], full.energy_j[m])
        # What the heater takes for a kelvin, at each point; nothing where all it can do is free.
        gained_k = idle_c - full_c
        asked = np.where(gained_k > 1e-9, (full_j - idle_j) / np.maximum(gained_k, 1e-9), -np.inf)
        pays = value_j[:-1] - value_j[1:] > asked[1:] * (curve_c[1:] - curve_c[:-1])
        # Nothing is known of where the curve comes from beyond the grid.
        pays &= full_c[1:] < grid_c[-1]
        curve_c, value_j, bands = _choose(full_c, full_j, idle_c, idle_j, pays)
        for slot, band in enumerate(bands[:BANDS]):
            bands_c[:, m, slot] = band
        needed_c = idle.needed_c[m]
        if needed_c > curve_c[0]:
            # Where the battery just delivers what the step asks the curve has a kink.
            at = int(np.searchsorted(curve_c, needed_c))
            needed_j = _after(idle, m, grid_c, needed_c, ends_c, ends_j, worth)
            curve_c, value_j = np.insert(curve_c, at, needed_c), np.insert(value_j, at, needed_j)
        curve_c, value_j = _mesh(curve_c, value_j, coldest_c, warmest_c)
        worth -= worth * strides.loss_to_brake[m]
        if strides.loss_to_heater[m] > 0.0:
            heat_worth = k_per_joule * _slope(strides.end_c[m], ends_c, ends_j)
            # Heat is worth no more than the charge that would buy it.
            worth -= strides.loss_to_heater[m] * max(worth - heat_worth, 0.0)
    return _in_steps(strides.first, len(trip.route), *bands_c)


def _choose(full_c: FloatArray, full_j: FloatArray, idle_c: FloatArray, idle_j: FloatArray,
            pays: BoolArray) -> tuple[FloatArray, FloatArray, list[Band]]:
    """
    Take the cheaper of the two branches of the curve before a stride.

    Returns (temperatures, values, bands): bands are (floor, low, high), the warmest first.
    """
    splits = (np.flatnonzero(pays & ~np.append(pays[1:], False)) + 1).tolist()
    if not splits:
        return idle_c, idle_j, []
    if pays[0] and len(splits) == 1:
        # The convex case: heat below the threshold, do not above. Between the two, heating in part
        # takes what the heater takes: a straight piece.
        split = splits[0]
        fan = split + 1 if idle_c[split] > full_c[split] + 1e-6 else split
        return (np.concatenate((full_c[:fan], idle_c[split:])),
                np.concatenate((full_j[:fan], idle_j[split:])),
                [(-np.inf, full_c[split], max(idle_c[split], full_c[split] + 1e-9))])
    mesh_c = np.sort(np.concatenate((full_c, idle_c)))
    heated_j = np.interp(mesh_c, full_c, full_j, right=np.inf)
    unheated_j = np.interp(mesh_c, idle_c, idle_j, left=np.inf)
    heat = heated_j <= unheated_j + INDIFFERENCE_J
    keep, bands = np.ones(len(mesh_c), dtype=bool), []
    for last in np.flatnonzero(heat & ~np.append(heat[1:], False))[::-1].tolist():
        low_c = mesh_c[last]
        high_c = max(np.interp(low_c, full_c, idle_c), low_c + 1e-9)
        colder = np.flatnonzero(~heat[:last])
        bands.append((mesh_c[colder[-1]] if len(colder) else -np.inf, low_c, high_c))
        keep &= (mesh_c <= low_c) | (mesh_c >= high_c)
    return mesh_c[keep], np.minimum(heated_j, unheated_j)[keep], bands


def _in_steps(first: IntArray, steps: int, floor_c: FloatArray, low_c: FloatArray,
              high_c: FloatArray) -> Thresholds:
    """Thresholds of steps from those of strides, arrays (M, BANDS): in between along a line."""
    step = np.arange(steps)
    stride = np.searchsorted(first, step, side='right') - 1
    following = np.minimum(stride + 1, len(first) - 1)
    share = ((step - first[stride])
             / np.maximum(first[following] - first[stride], 1))[:, np.newaxis]

    def between(values_c: FloatArray) -> FloatArray:
        here_c, there_c = values_c[stride], values_c[following]
        # A band that begins or ends, or another one in its place, is no neighbour.
        near = np.isfinite(here_c) & np.isfinite(there_c)
        change_c = np.where(near, there_c, 0.0) - np.where(near, here_c, 0.0)
        between_c: FloatArray = here_c + share * np.where(
            np.abs(change_c) < NEIGHBOUR_K, change_c, 0.0)
        return between_c

    return Thresholds(floor_c[stride], between(low_c), between(high_c))


def _slope(temperature_c: float, curve_c: FloatArray, value_j: FloatArray) -> float:
    """Return what a kelvin is worth [J/K] about a temperature, never less than nothing."""
    cooler_j, warmer_j = np.interp(
        (temperature_c - 0.5 * SLOPE_K, temperature_c + 0.5 * SLOPE_K), curve_c, value_j)
    worth_j_per_k: float = max(cooler_j - warmer_j, 0.0) / SLOPE_K
    return worth_j_per_k


def _after(step_map: _StepMap, m: int, grid_c: FloatArray, start_c: float, ends_c: FloatArray,
           ends_j: FloatArray, worth: float) -> float:
    """Value at a temperature before stride m, from the curve (ends_c, ends_j) after it."""
    end_c = np.interp(start_c, grid_c, step_map.end_c[m])
    value_j: float = (np.interp(end_c, ends_c, ends_j)
                      + worth * np.interp(start_c, grid_c, step_map.energy_j[m]))
    return value_j


@dataclass(frozen=True)
class _StepMap:
    """
    Where a stride ends [deg C], and what it takes [J], from each temperature: (M, G).

    `needed_c` (M,) is the temperature from which on the battery delivers what the stride asks
    without heating; -inf where it always does.
    """

    end_c: FloatArray
    energy_j: FloatArray
    needed_c: FloatArray


def _step_maps(vehicle: Vehicle, strides: _Strides, grid_c: FloatArray,
               penalty: float) -> tuple[_StepMap, _StepMap]:
    """
    Return the maps of all strides with free heating only, and with all the heating there is.

    A watt that the battery lacks costs `penalty` times what the heater takes for it.
    """
    power_w, variance_w2, heat_w, leakage_w_per_k = (
        column[:, np.newaxis] for column in strides.columns)
    soc, duration_s, cap_w = (
        values[:, np.newaxis] for values in (strides.soc, strides.duration_s, strides.cap_w))
    start_c = np.broadcast_to(grid_c, (len(strides.first), len(grid_c)))
    surplus_w, lacking_w = np.zeros(start_c.shape), np.zeros(start_c.shape)
    room_w = np.broadcast_to(cap_w, start_c.shape).copy()
    near = strides.may_overcharge | strides.may_overdraw
    if near.any():
        least_w, most_w = make_terminal_limits(vehicle, ARRAYS)(
            soc[near], start_c[near], variance_w2[near])
        surplus_w[near] = np.clip(least_w - power_w[near], 0.0, np.maximum(
            -strides.propulsion_w[near, np.newaxis], 0.0))
        lacking_w[near] = np.maximum(power_w[near] - most_w, 0.0)
        room_w[near] = np.clip(most_w - power_w[near], 0.0, cap_w[near])
    needed_c = np.full(len(strides.first), -np.inf)
    for m in np.flatnonzero((lacking_w > 0.0).any(axis=1)):
        row_w = lacking_w[m]
        last = int(np.flatnonzero(row_w > 0.0)[-1])
        before = max(last - 1, 0)
        slope = (row_w[before] - row_w[last]) / max(grid_c[last] - grid_c[before], 1e-9)
        needed_c[m] = grid_c[last] + (row_w[last] / slope if slope > 0.0 else 0.0)
    step = make_runge_kutta_4(make_rates(vehicle, ARRAYS))
    free_w = np.minimum(cap_w, surplus_w)

    def map_of(heater_w: FloatArray) -> _StepMap:
        brake_w = surplus_w - np.minimum(heater_w, surplus_w)
        terminal_w = power_w + heater_w + brake_w
        _, end_c, _, joule_w = step(
            soc, start_c, duration_s, terminal_w, variance_w2,
            heat_w + vehicle.hvch.efficiency * heater_w
            - vehicle.drivetrain.heat_share * brake_w, leakage_w_per_k)
        return _StepMap(end_c, duration_s * (terminal_w + joule_w + penalty * lacking_w),
                        needed_c)

    return map_of(free_w), map_of(np.maximum(room_w, free_w))


def _mesh(curve_c: FloatArray, value_j: FloatArray, coldest_c: float,
          warmest_c: float) -> tuple[FloatArray, FloatArray]:
    """Keep the curve's points dense enough, few enough, and where the trip can come."""
    first = max(int(np.searchsorted(curve_c, coldest_c)) - 1, 0)
    last = int(np.searchsorted(curve_c, warmest_c)) + 1
    curve_c, value_j = curve_c[first:last], value_j[first:last]
    # Points that come from beyond the grid all lie at its end: of these one is left.
    curve_c = np.maximum.accumulate(curve_c)
    apart = np.append(np.diff(curve_c) > 0.0, True)
    if not apart.all():
        curve_c, value_j = curve_c[apart], value_j[apart]
    wide = np.flatnonzero(np.diff(curve_c) > WIDEST_GAP_K) + 1
    if len(wide):
        middle_c = 0.5 * (curve_c[wide] + curve_c[wide - 1])
        middle_j = 0.5 * (value_j[wide] + value_j[wide - 1])
        curve_c, value_j = np.insert(curve_c, wide, middle_c), np.insert(value_j, wide, middle_j)
    if len(curve_c) > MOST_POINTS:
        inner_j = np.interp(curve_c[1:-1:2], curve_c[::2], value_j[::2])
        keep = np.ones(len(curve_c), dtype=bool)
        keep[1:-1:2] = ((np.abs(value_j[1:-1:2] - inner_j) > CURVE_TOLERANCE_J)
                        | (curve_c[2::2][:len(inner_j)] - curve_c[:-2:2] > WIDEST_GAP_K))
        curve_c, value_j = curve_c[keep], value_j[keep]
    return curve_c, value_j
