# SPDX-License-Identifier: Apache-2.0
"""
Temperatures below which heating pays, for each step: dynamic programming backward from arrival.

Algorithm 2 of the paper runs one temperature backward from the target: below it heating must be on.
Here a whole curve runs backward (`value_curve`). Its slope is the worth of a kelvin. Heating pays in a step if
a kelvin is worth more than the heater's energy for it, usually below one temperature, the *threshold* of the
step. Without limits the last curve is a step at the target, and the thresholds are the temperatures of
Algorithm 2. A very cold battery accepts hardly any regeneration, however much it is heated, so before a descent
heating may pay in a band only.

A joule from the battery counts with its worth on arrival: before a descent at the charge limit that is less than
a joule (`charge_acceptance`).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.native import searches as native_searches
from bev_preheat.planning.dynamics import native_vehicle
from bev_preheat.planning.strides import COARSE, make_strides, map_strides, Strides
from bev_preheat.planning.value_curve import cheaper_branch, heating_pays, ValueCurve

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.charge_acceptance import AcceptanceLoss
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip
    from bev_preheat.planning.wanted_heat import LimitedSteps
    from bev_preheat.vehicle.description import Vehicle

# A kelvin below the target, or a watt of power deficit, costs this many times the heater's energy for it, so that
# a plan does not save there.
PENALTY = 30.0
# The curve extends this far beyond the temperatures that the trip can reach.
MARGIN_K = 10.0
# Each stride is computed at whole multiples of this [deg C], the same in every plan, and interpolated in
# between.
GRID_K = 1.0
# Bands of temperature in which heating pays: below the required temperature, and before a descent.
BANDS = 2
# Thresholds of neighbouring strides that differ by more than this belong to different bands [K].
NEIGHBOUR_K = 3.0


class Thresholds(NamedTuple):
    """
    Bands of temperature in which heating pays in step k, at most BANDS of them, shape (N, BANDS).

    At full power from `floor_c` to `low_c`, off from `high_c`, in proportion in between: this is the
    step in which the threshold is reached. A band with a floor is an investment: from below the floor, no heating
    before a descent can earn its cost. An empty band has floor_c = inf.
    """

    floor_c: FloatArray
    low_c: FloatArray
    high_c: FloatArray


def find_thresholds(trip: Trip, watch: LimitedSteps, run: Schedule, target_c: float, loss: AcceptanceLoss,
                    serves_climbs: bool = True, is_first_look: bool = False) -> Thresholds:
    """
    Return the Thresholds of a trip, by running the value curve backward.

    `run` (a Schedule) gives the states of charge, and the approximate temperatures, along which the curve
    is needed; the AcceptanceLoss `loss` gives the worth of charge. Without `serves_climbs` a power deficit
    costs nothing. The first pass is coarser, and covers a wider range around the run.
    """
    battery = trip.vehicle.battery
    strides = make_strides(trip, watch, run, loss, target_c, is_first_look)
    # The model does not describe a battery outside its range, and heating ends at the highest temperature.
    lowest_c, highest_c = battery.temperature_range_c
    coldest_c = max(min(run.temperature_c.min(), target_c) - MARGIN_K, lowest_c)
    warmest_c = min(max(run.temperature_c.max(), target_c), highest_c) + MARGIN_K
    grid_c = GRID_K * np.arange(math.floor(max(coldest_c - MARGIN_K, lowest_c) / GRID_K),
                                math.ceil(warmest_c / GRID_K) + COARSE)
    ends = target_c, coldest_c, warmest_c, PENALTY if serves_climbs else 0.0
    native = native_vehicle(trip.vehicle)
    bands_c = None if native is None else native_searches.find_bands(
        native, vars(strides), strides.may_overcharge | strides.may_overdraw, is_first_look, grid_c,
        *ends, PENALTY)
    if bands_c is None:
        bands_c = _find_bands(trip.vehicle, strides, grid_c, *ends)
    return _in_steps(strides.first, len(trip.route), *bands_c)


def _find_bands(vehicle: Vehicle, strides: Strides, grid_c: FloatArray, target_c: float,
                coldest_c: float, warmest_c: float, penalty: float) -> FloatArray:
    """
    Return floor, low and high [deg C] of each stride's bands, (3, M, BANDS), from the curve on arrival.

    Computed on a grid (G,), within the coldest and the warmest temperature. A watt of power deficit counts
    `penalty` times.
    """
    k_per_joule = vehicle.hvch.efficiency / vehicle.battery.heat_capacity_j_per_k
    unheated_maps, heated_maps = map_strides(vehicle, strides, grid_c, penalty)
    points_c = np.unique(np.append(grid_c, target_c))
    curve = ValueCurve(points_c, PENALTY / k_per_joule * np.maximum(target_c - points_c, 0.0))
    # Empty unless found.
    bands_c = np.full((3, len(strides), BANDS), -np.inf)
    bands_c[0] = np.inf
    # Worth of a joule in the battery on arrival [J/J].
    joule_worth = 1.0
    lowest_c = np.clip(strides.coldest_c, coldest_c, warmest_c - 1.0)
    highest_c = np.clip(strides.warmest_c, coldest_c + 1.0, warmest_c)
    curve = curve.within(lowest_c[-1], highest_c[-1])
    for m in range(len(strides) - 1, -1, -1):
        after, idle = curve, unheated_maps[m]
        heated, unheated = (after.before(stride, joule_worth) for stride in (heated_maps[m], idle))
        curve, bands = cheaper_branch(
            heated, unheated, heating_pays(after, heated, unheated, idle.start_c[-1]))
        for slot, band in enumerate(bands[:BANDS]):
            bands_c[:, m, slot] = band
        if idle.needed_c > curve.temperature_c[0]:
            # The curve has a kink at the temperature that just delivers the stride's power.
            curve = curve.with_point(
                idle.needed_c, after.before_at(idle, idle.needed_c, joule_worth))
        curve = curve.within(lowest_c[m], highest_c[m])
        joule_worth -= joule_worth * strides.loss_to_brake[m]
        if strides.loss_to_heater[m] > 0.0:
            heat_worth = k_per_joule * after.worth_j_per_k(strides.end_c[m])
            # Heat is worth no more than the charge that would buy it.
            joule_worth -= strides.loss_to_heater[m] * max(joule_worth - heat_worth, 0.0)
    return bands_c


def _in_steps(first: IntArray, steps: int, floor_c: FloatArray, low_c: FloatArray,
              high_c: FloatArray) -> Thresholds:
    """Return the Thresholds of steps from those of strides, arrays (M, BANDS), interpolated linearly."""
    step = np.arange(steps)
    stride = np.searchsorted(first, step, side='right') - 1
    following = np.minimum(stride + 1, len(first) - 1)
    share = ((step - first[stride])
             / np.maximum(first[following] - first[stride], 1))[:, np.newaxis]

    def between(values_c: FloatArray) -> FloatArray:
        here_c, there_c = values_c[stride], values_c[following]
        # Do not interpolate between different bands, or at the end of one.
        near = np.isfinite(here_c) & np.isfinite(there_c)
        change_c = np.where(near, there_c, 0.0) - np.where(near, here_c, 0.0)
        between_c: FloatArray = here_c + share * np.where(
            np.abs(change_c) < NEIGHBOUR_K, change_c, 0.0)
        return between_c

    return Thresholds(floor_c[stride], between(low_c), between(high_c))
