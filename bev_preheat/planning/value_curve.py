# SPDX-License-Identifier: Apache-2.0
"""
What a kelvin is worth: the battery energy that the rest of a trip costs, over temperature.

Algorithm 2 of the paper runs one temperature backward from the target, heated all the way. Here a
whole curve runs backward (`thresholds`): V_k(T), the battery energy that the rest of the trip costs
from temperature T on, limits and all. Its points move with the vehicle's own dynamics, heated where
that is the cheaper branch and unheated elsewhere, so its kinks stay sharp.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.planning.strides import StrideMap

# The curve's points: not further apart, and if there are more, those that say less [J] go.
WIDEST_GAP_K = 1.0
MOST_POINTS = 32
CURVE_TOLERANCE_J = 100.0
# Heating that makes no more difference than this [J] is no decision.
INDIFFERENCE_J = 10.0
# What a kelvin is worth is taken over this difference, which smooths the curve's kinks.
SLOPE_K = 1.0
# Heating that warms by less than this [K] does not warm; a band is at least as wide.
LEAST_GAIN_K = 1e-9
LEAST_FAN_K = 1e-6
# Floor, low and high of Thresholds [deg C].
Band = tuple[float, float, float]


class ValueCurve(NamedTuple):
    """
    Battery energy [J] that the rest of a trip costs, over temperature [deg C]: two arrays (P,).

    Temperatures do not fall; between two points the curve is straight.
    """

    temperature_c: FloatArray
    energy_j: FloatArray

    def at(self, temperature_c: float) -> float:
        """Return the energy [J] at a temperature [deg C]; beyond the points that of the last one."""
        return float(np.interp(temperature_c, self.temperature_c, self.energy_j))

    def worth_j_per_k(self, temperature_c: float) -> float:
        """Return what a kelvin is worth [J/K] about a temperature, never less than nothing."""
        cooler_j, warmer_j = np.interp(
            (temperature_c - 0.5 * SLOPE_K, temperature_c + 0.5 * SLOPE_K),
            self.temperature_c, self.energy_j)
        worth_j_per_k: float = max(cooler_j - warmer_j, 0.0) / SLOPE_K
        return worth_j_per_k

    def before(self, stride: StrideMap, joule_worth: float) -> ValueCurve:
        """
        Return the curve before a stride: each point where it comes from, with what the stride takes.

        `joule_worth` is what a joule in the battery is worth on arrival [J/J].
        """
        return ValueCurve(
            np.interp(self.temperature_c, stride.end_c, stride.start_c),
            self.energy_j + joule_worth * np.interp(
                self.temperature_c, stride.end_c, stride.energy_j))

    def before_at(self, stride: StrideMap, start_c: float, joule_worth: float) -> float:
        """Return the energy [J] at one temperature before a stride [deg C]."""
        end_c = np.interp(start_c, stride.start_c, stride.end_c)
        taken_j = np.interp(start_c, stride.start_c, stride.energy_j)
        return self.at(float(end_c)) + joule_worth * float(taken_j)

    def with_point(self, temperature_c: float, energy_j: float) -> ValueCurve:
        """Return the curve with one more point."""
        at = int(np.searchsorted(self.temperature_c, temperature_c))
        return ValueCurve(np.insert(self.temperature_c, at, temperature_c),
                          np.insert(self.energy_j, at, energy_j))

    def within(self, coldest_c: float, warmest_c: float) -> ValueCurve:
        """Return the curve where the trip can come, its points dense enough and few enough."""
        first = max(int(np.searchsorted(self.temperature_c, coldest_c)) - 1, 0)
        last = int(np.searchsorted(self.temperature_c, warmest_c)) + 1
        part = ValueCurve(self.temperature_c[first:last], self.energy_j[first:last])
        return part._without_repetition()._dense()._thinned()

    def _without_repetition(self) -> ValueCurve:
        """Of the points that come from beyond the grid, which all lie at its end, one is left."""
        temperature_c = np.maximum.accumulate(self.temperature_c)
        apart = np.append(np.diff(temperature_c) > 0.0, True)
        return ValueCurve(temperature_c[apart], self.energy_j[apart])

    def _dense(self) -> ValueCurve:
        """With a point in the middle of each gap that is too wide."""
        wide = np.flatnonzero(np.diff(self.temperature_c) > WIDEST_GAP_K) + 1
        if not len(wide):
            return self
        return ValueCurve(*(
            np.insert(values, wide, 0.5 * (values[wide] + values[wide - 1]))
            for values in (self.temperature_c, self.energy_j)))

    def _thinned(self) -> ValueCurve:
        """Of too many points, without every other one that lies on the line of its neighbours."""
        temperature_c, energy_j = self.temperature_c, self.energy_j
        if len(temperature_c) <= MOST_POINTS:
            return self
        line_j = np.interp(temperature_c[1:-1:2], temperature_c[::2], energy_j[::2])
        keep = np.ones(len(temperature_c), dtype=bool)
        keep[1:-1:2] = (
            (np.abs(energy_j[1:-1:2] - line_j) > CURVE_TOLERANCE_J)
            | (temperature_c[2::2][:len(line_j)] - temperature_c[:-2:2] > WIDEST_GAP_K))
        return ValueCurve(temperature_c[keep], energy_j[keep])


def heating_pays(after: ValueCurve, heated: ValueCurve, unheated: ValueCurve,
                 warmest_c: float) -> BoolArray:
    """
    Return for each piece of a curve whether a kelvin is worth more there than the heater takes.

    `heated` and `unheated` are `after` before a stride, point by point; shape (P - 1,). Nothing is
    known of what comes from beyond `warmest_c` [deg C], and nothing is heated there.
    """
    gained_k = unheated.temperature_c - heated.temperature_c
    # What the heater takes for a kelvin [J/K], at each point; nothing where all it can do is free.
    asked = np.where(
        gained_k > LEAST_GAIN_K,
        (heated.energy_j - unheated.energy_j) / np.maximum(gained_k, LEAST_GAIN_K), -np.inf)
    pays: BoolArray = (after.energy_j[:-1] - after.energy_j[1:]
                       > asked[1:] * (after.temperature_c[1:] - after.temperature_c[:-1]))
    return pays & (heated.temperature_c[1:] < warmest_c)


def cheaper_branch(heated: ValueCurve, unheated: ValueCurve,
                   pays: BoolArray) -> tuple[ValueCurve, list[Band]]:
    """
    Return the cheaper of the two branches of a curve before a stride, and where that is the heated.

    `pays` is that of `heating_pays`; the bands are (floor, low, high), the warmest first.
    """
    splits = (np.flatnonzero(pays & ~np.append(pays[1:], False)) + 1).tolist()
    if not splits:
        return unheated, []
    if pays[0] and len(splits) == 1:
        curve, band = _split(heated, unheated, splits[0])
        return curve, [band]
    return _lower(heated, unheated)


def _split(heated: ValueCurve, unheated: ValueCurve, split: int) -> tuple[ValueCurve, Band]:
    """
    Take the convex case: heat below the threshold, do not above.

    Between the two, heating in part takes what the heater takes: a straight piece.
    """
    low_c, high_c = heated.temperature_c[split], unheated.temperature_c[split]
    fan = split + 1 if high_c > low_c + LEAST_FAN_K else split
    curve = ValueCurve(np.concatenate((heated.temperature_c[:fan], unheated.temperature_c[split:])),
                       np.concatenate((heated.energy_j[:fan], unheated.energy_j[split:])))
    return curve, (-np.inf, low_c, max(high_c, low_c + LEAST_GAIN_K))


def _lower(heated: ValueCurve, unheated: ValueCurve) -> tuple[ValueCurve, list[Band]]:
    """Take the lower of two curves, at the points of both."""
    mesh_c = np.sort(np.concatenate((heated.temperature_c, unheated.temperature_c)))
    heated_j = np.interp(mesh_c, heated.temperature_c, heated.energy_j, right=np.inf)
    unheated_j = np.interp(mesh_c, unheated.temperature_c, unheated.energy_j, left=np.inf)
    heat = heated_j <= unheated_j + INDIFFERENCE_J
    keep, bands = np.ones(len(mesh_c), dtype=bool), []
    for last in np.flatnonzero(heat & ~np.append(heat[1:], False))[::-1].tolist():
        low_c = mesh_c[last]
        high_c = max(np.interp(low_c, heated.temperature_c, unheated.temperature_c),
                     low_c + LEAST_GAIN_K)
        colder = np.flatnonzero(~heat[:last])
        bands.append((mesh_c[colder[-1]] if len(colder) else -np.inf, low_c, high_c))
        keep &= (mesh_c <= low_c) | (mesh_c >= high_c)
    return ValueCurve(mesh_c[keep], np.minimum(heated_j, unheated_j)[keep]), bands
