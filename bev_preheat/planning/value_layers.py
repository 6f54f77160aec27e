# SPDX-License-Identifier: Apache-2.0
"""Values of temperatures at one instant, and the best mixture of a step's ends by them: `value_function`."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.tunables import BEYOND_PRICE, LEAST_HEATING_W, LEAST_MIXED_SHARE, MOST_SPREAD, SHORT_PRICE

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray, IntArray
    from bev_preheat.planning.steps_ahead import StepEnds


class Layer(NamedTuple):
    """Values [J] at one instant: temperatures (P,) [deg C], rows for a heater that was off and that was on."""

    grid_c: FloatArray
    values_j: FloatArray

    def worth_j(self, settled_c: FloatArray, is_on: BoolArray | bool, joules_per_k: float) -> FloatArray:
        """Return the value of temperatures; outside the layer the path must come back."""
        grid_c = self.grid_c
        place = (settled_c - grid_c[0]) / (grid_c[1] - grid_c[0])
        below = np.clip(place.astype(int), 0, len(grid_c) - 2)
        row_j = np.where(is_on, self.values_j[1, below], self.values_j[0, below])
        next_j = np.where(is_on, self.values_j[1, below + 1], self.values_j[0, below + 1])
        inside_j = row_j + np.clip(place - below, 0.0, 1.0) * (next_j - row_j)
        below_k, above_k = np.maximum(grid_c[0] - settled_c, 0.0), np.maximum(settled_c - grid_c[-1], 0.0)
        value_j: FloatArray = inside_j + (2.0 * SHORT_PRICE * below_k + BEYOND_PRICE * above_k) * joules_per_k
        return value_j

    def spread(self, variance_k2: float) -> Layer:
        """Return the values averaged over a deviation in temperature, of this variance [K^2]."""
        values_j, left = self.values_j.copy(), variance_k2 / (self.grid_c[1] - self.grid_c[0]) ** 2
        while left > 0.0:
            share = 0.5 * min(left, MOST_SPREAD)
            values_j[:, 1:-1] += share * (values_j[:, :-2] - 2.0 * values_j[:, 1:-1] + values_j[:, 2:])
            left -= MOST_SPREAD
        return self._replace(values_j=values_j)


class _Mixtures(NamedTuple):
    """Mixtures of two neighbouring ends from temperatures (P,): value [J], end, and share of the next end."""

    value_j: FloatArray
    end: IntArray
    share: FloatArray

    def with_better(self, value_j: FloatArray, end: int, share: FloatArray | float) -> _Mixtures:
        """Return the better of these and others from one end."""
        is_better = value_j < self.value_j
        return _Mixtures(np.where(is_better, value_j, self.value_j), np.where(is_better, end, self.end),
                         np.where(is_better, share, self.share))


class Choice(NamedTuple):
    """The mixture to take from one temperature: end, share of the next end, and whether they heat."""

    end: int
    share: float
    is_heating: bool

    def wanted_w(self, ends: StepEnds) -> float:
        """Return the command that leads there [W]."""
        if self.share > 0.0:
            low_w, high_w = ends.command_w[self.end, 0], ends.command_w[self.end + 1, 0]
            return float(low_w + self.share * (high_w - low_w))
        return float(ends.wanted_w[self.end])


class Best(NamedTuple):
    """The best mixtures that do not heat, and that do: without the price of switching on."""

    unheated: _Mixtures
    heated: _Mixtures

    def value_j(self, switch_on_j: float) -> FloatArray:
        """Return the value at a price of switching on [J]."""
        value_j: FloatArray = np.minimum(self.unheated.value_j, self.heated.value_j + switch_on_j)
        return value_j

    def only(self, switch_on_j: float) -> Choice:
        """Return the Choice at the one temperature."""
        is_heating = bool(self.unheated.value_j[0] > self.heated.value_j[0] + switch_on_j)
        mixture = self.heated if is_heating else self.unheated
        return Choice(int(mixture.end[0]), float(mixture.share[0]), is_heating)


def best_of(ends: StepEnds, following: Layer, joules_per_k: float, is_mixed: bool) -> Best:
    """
    Return the best of a step's ends and, if `is_mixed`, of their mixtures.

    Between two ends, the best lies at a temperature of the next layer, as values are straight in between.
    """
    points = ends.cost_j.shape[1]
    none = _Mixtures(np.full(points, np.inf), np.zeros(points, dtype=int), np.zeros(points))
    unheated, heated = none, none
    rows = list(zip(*ends[:3]))
    for end, (cost_j, settled_c, command_w) in enumerate(rows):
        is_heating = command_w > LEAST_HEATING_W
        value_j = cost_j + following.worth_j(settled_c, is_heating, joules_per_k)
        heated = heated.with_better(np.where(is_heating, value_j, np.inf), end, 0.0)
        unheated = unheated.with_better(np.where(is_heating, np.inf, value_j), end, 0.0)
    for end, (low, high) in enumerate(zip(rows, rows[1:]) if is_mixed else ()):
        cost_j, settled_c, command_w = (row[:, None] for row in low)
        more_j, wide_k, more_w = (next_row[:, None] - row[:, None] for row, next_row in zip(low, high))
        share = (following.grid_c - settled_c) / np.where(wide_k > 0.0, wide_k, np.nan)
        least_w = np.maximum(LEAST_HEATING_W, LEAST_MIXED_SHARE * (command_w + more_w))
        is_between = (share > 0.0) & (share <= 1.0) & (command_w + share * more_w > least_w)
        value_j = np.where(is_between, cost_j + share * more_j + following.values_j[1], np.inf)
        found = value_j.argmin(axis=1)[:, None]
        heated = heated.with_better(np.take_along_axis(value_j, found, 1)[:, 0], end,
                                    np.take_along_axis(share, found, 1)[:, 0])
    return Best(unheated, heated)
