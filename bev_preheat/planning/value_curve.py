# SPDX-License-Identifier: Apache-2.0
"""
The worth of a kelvin: battery energy for the rest of a trip, over temperature.

Algorithm 2 of the paper runs one temperature backward from the target, heated all the way. Here a whole curve runs
backward (`thresholds`): V_k(T), the battery energy for the rest of the trip from temperature T on, including
limits. Its points move with the vehicle's own dynamics, heated on the cheaper branch and unheated
elsewhere, so its kinks stay sharp.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.planning.strides import StrideMap

# Widest gap between points; if there are too many points, those that matter less than this [J] are dropped.
WIDEST_GAP_K = 1.0
MOST_POINTS = 32
CURVE_TOLERANCE_J = 100.0
# Heating that makes less difference than this [J] is left undecided.
INDIFFERENCE_J = 10.0
# Difference for the worth of a kelvin, which smooths the curve's kinks.
SLOPE_K = 1.0
# Heating by less than this [K] does not count; a band is at least this wide.
LEAST_GAIN_K = 1e-9
LEAST_FAN_K = 1e-6
# Floor, low and high of Thresholds [deg C].
Band = tuple[float, float, float]


class ValueCurve(NamedTuple):
    """
    Battery energy [J] for the rest of a trip, over temperature [deg C]: two arrays (P,).

    Temperatures do not fall; the curve is linear between points.
    """

    temperature_c: FloatArray
    energy_j: FloatArray

    def at(self, temperature_c: float) -> float:
        """Return the energy [J] at a temperature [deg C]; constant beyond the last points."""
        return float(np.interp(temperature_c, self.temperature_c, self.energy_j))

    def worth_j_per_k(self, temperature_c: float) -> float:
        """Return the worth of a kelvin [J/K] around a temperature, at least 0."""
        cooler_j, warmer_j = np.interp(
            (temperature_c - 0.5 * SLOPE_K, temperature_c + 0.5 * SLOPE_K),
            self.temperature_c, self.energy_j)
        worth_j_per_k: float = max(cooler_j - warmer_j, 0.0) / SLOPE_K
        return worth_j_per_k

    def before(self, stride: StrideMap, joule_worth: float) -> ValueCurve:
        """
        Return the curve before a stride: each point at its start temperature, plus the energy of the stride.

        `joule_worth` is the worth of a joule in the battery on arrival [J/J].
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
        """Return the curve within the reachable temperatures, with dense enough and few enough points."""
        first = max(int(np.searchsorted(self.temperature_c, coldest_c)) - 1, 0)
        last = int(np.searchsorted(self.temperature_c, warmest_c)) + 1
        part = ValueCurve(self.temperature_c[first:last], self.energy_j[first:last])
        return part._without_repetition()._dense()._thinned()

    def _without_repetition(self) -> ValueCurve:
        """Return the curve with one of the points from beyond the grid, which all lie at its end."""
        temperature_c = np.maximum.accumulate(self.temperature_c)
        apart = np.append(np.diff(temperature_c) > 0.0, True)
        return ValueCurve(temperature_c[apart], self.energy_j[apart])

    def _dense(self) -> ValueCurve:
        """Return the curve with a point in the middle of each gap that is too wide."""
        wide = np.flatnonzero(np.diff(self.temperature_c) > WIDEST_GAP_K) + 1
        if not len(wide):
            return self
        return ValueCurve(*(
            np.insert(values, wide, 0.5 * (values[wide] + values[wide - 1]))
            for values in (self.temperature_c, self.energy_j)))

    def _thinned(self) -> ValueCurve:
        """Return the curve; if it has too many points, without every other point on its neighbours' line."""
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
    Return for each piece of a curve whether a kelvin is worth more there than its heating costs.

    `heated` and `unheated` are `after` before a stride, point by point; shape (P - 1,). Beyond `warmest_c`
    [deg C] the curve is unknown, and nothing is heated there.
    """
    gained_k = unheated.temperature_c - heated.temperature_c
    # The heater's energy for a kelvin [J/K], at each point; nothing if all possible heating is free.
    asked = np.where(
        gained_k > LEAST_GAIN_K,
        (heated.energy_j - unheated.energy_j) / np.maximum(gained_k, LEAST_GAIN_K), -np.inf)
    pays: BoolArray = (after.energy_j[:-1] - after.energy_j[1:]
                       > asked[1:] * (after.temperature_c[1:] - after.temperature_c[:-1]))
    return pays & (heated.temperature_c[1:] < warmest_c)


def cheaper_branch(heated: ValueCurve, unheated: ValueCurve,
                   pays: BoolArray) -> tuple[ValueCurve, list[Band]]:
    """
    Return the cheaper of the two branches of a curve before a stride, and the heated one's bands.

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
    Return curve and band of the convex case: heat below the threshold, not above.

    Between the two, partial heating takes energy in proportion: a straight piece.
    """
    low_c, high_c = heated.temperature_c[split], unheated.temperature_c[split]
    fan = split + 1 if high_c > low_c + LEAST_FAN_K else split
    curve = ValueCurve(np.concatenate((heated.temperature_c[:fan], unheated.temperature_c[split:])),
                       np.concatenate((heated.energy_j[:fan], unheated.energy_j[split:])))
    return curve, (-np.inf, low_c, max(high_c, low_c + LEAST_GAIN_K))


def _lower(heated: ValueCurve, unheated: ValueCurve) -> tuple[ValueCurve, list[Band]]:
    """Return the lower of two curves at the points of both, and the heated one's bands."""
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
