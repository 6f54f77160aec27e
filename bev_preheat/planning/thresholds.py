# SPDX-License-Identifier: Apache-2.0
"""
Below which temperature heating pays, in each step: dynamic programming backward from arrival.

Algorithm 2 of the paper runs one temperature backward from the target: below it heating must be on.
Here a whole curve runs backward (`value_curve`). Its slope says what a kelvin is worth, and heating
pays in a step where that is more than the heater takes for it, which as a rule is so below one
temperature, the *threshold* of the step. Without limits the last curve is a step at the target, and
the thresholds are the temperatures of Algorithm 2. A very cold battery takes hardly any
regeneration, however much it is heated, so before a descent heating may pay in a band only.

A joule taken from the battery counts as what it is worth on arrival: before a descent at the charge
limit that is less than a joule (`charge_acceptance`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.compiled import runs as compiled_runs
from bev_preheat.planning.strides import make_strides, map_strides, StrideMaps, Strides
from bev_preheat.planning.value_curve import cheaper_branch, heating_pays, ValueCurve

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.charge_acceptance import AcceptanceLoss
    from bev_preheat.planning.limits import Watch
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip

# A kelvin below the target, or a watt that the battery lacks, costs this many times what the heater
# takes for it, so that nothing is saved there.
PENALTY = 30.0
# The curve reaches this far beyond the temperatures that the trip can take.
MARGIN_K = 10.0
# Temperatures at which each stride is worked out; in between it is interpolated.
GRID_POINTS = 64
# Bands of temperature in which heating pays: below what must be reached, and before a descent.
BANDS = 2
# Thresholds of one stride and the next that are further apart belong to different bands [K].
NEIGHBOUR_K = 3.0


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


def find_thresholds(trip: Trip, watch: Watch, run: Schedule, target_c: float, loss: AcceptanceLoss,
                    serves_climbs: bool = True) -> Thresholds:
    """
    Return the Thresholds of a trip, by running the value curve backward.

    `run` (a Schedule) says along which states of charge, and about which temperatures, the curve
    is needed, and the AcceptanceLoss `loss` what charge is worth. Without `serves_climbs` a power
    that the battery lacks costs nothing.
    """
    battery = trip.vehicle.battery
    k_per_joule = trip.vehicle.hvch.efficiency / battery.heat_capacity_j_per_k
    strides = make_strides(trip, watch, run, loss)
    # Outside its range the battery is not described, and beyond its highest temperature not heated.
    lowest_c, highest_c = battery.temperature_range_c
    coldest_c = max(min(run.temperature_c.min(), target_c) - MARGIN_K, lowest_c)
    warmest_c = min(max(run.temperature_c.max(), target_c), highest_c) + 2.0 * MARGIN_K
    grid_c = np.linspace(max(coldest_c - MARGIN_K, lowest_c), warmest_c, GRID_POINTS)
    unheated_maps, heated_maps = map_strides(
        trip.vehicle, strides, grid_c, PENALTY if serves_climbs else 0.0)
    points_c = np.unique(np.append(grid_c, target_c))
    curve = ValueCurve(points_c, PENALTY / k_per_joule * np.maximum(target_c - points_c, 0.0))
    bands_c = compiled_runs.find_bands(
        (grid_c, unheated_maps.end_c, unheated_maps.energy_j, heated_maps.end_c, heated_maps.energy_j,
         unheated_maps.needed_c, strides.end_c, strides.loss_to_brake, strides.loss_to_heater),
        curve.temperature_c, curve.energy_j, k_per_joule, coldest_c, warmest_c)
    if bands_c is None:
        bands_c = _find_bands(
            strides, unheated_maps, heated_maps, curve, k_per_joule, coldest_c, warmest_c)
    return _in_steps(strides.first, len(trip.route), *bands_c)


def _find_bands(strides: Strides, unheated_maps: StrideMaps, heated_maps: StrideMaps,
                curve: ValueCurve, k_per_joule: float, coldest_c: float,
                warmest_c: float) -> FloatArray:
    """Return floor, low and high [deg C] of each stride's bands, (3, M, BANDS), from the curve on arrival."""
    # Empty unless found.
    bands_c = np.full((3, len(strides), BANDS), -np.inf)
    bands_c[0] = np.inf
    # What a joule in the battery is worth on arrival [J/J].
    joule_worth = 1.0
    for m in range(len(strides) - 1, -1, -1):
        after, idle = curve, unheated_maps[m]
        heated, unheated = (after.before(stride, joule_worth) for stride in (heated_maps[m], idle))
        curve, bands = cheaper_branch(
            heated, unheated, heating_pays(after, heated, unheated, unheated_maps.start_c[-1]))
        for slot, band in enumerate(bands[:BANDS]):
            bands_c[:, m, slot] = band
        if idle.needed_c > curve.temperature_c[0]:
            # Where the battery just delivers what the stride asks the curve has a kink.
            curve = curve.with_point(
                idle.needed_c, after.before_at(idle, idle.needed_c, joule_worth))
        curve = curve.within(coldest_c, warmest_c)
        joule_worth -= joule_worth * strides.loss_to_brake[m]
        if strides.loss_to_heater[m] > 0.0:
            heat_worth = k_per_joule * after.worth_j_per_k(strides.end_c[m])
            # Heat is worth no more than the charge that would buy it.
            joule_worth -= strides.loss_to_heater[m] * max(joule_worth - heat_worth, 0.0)
    return bands_c


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
