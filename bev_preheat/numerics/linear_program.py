# SPDX-License-Identifier: Apache-2.0
"""
A linear program with few rows and many bounded variables: the simplex method.

(Planning never loads SciPy.) The variable that gains the most at the prices of the rows enters the basis, and
rises or falls until it or a basic variable reaches a bound. Each round leads from one feasible point to a
better one, so the method may be stopped after any round.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Cost of a unit of deficit in a row; gains and uses per unit of a variable are at most 1.
PENALTY = 1e3
# A variable that gains less per unit than this does not enter; one that changes less does not leave.
LEAST_GAIN = 1e-9
LEAST_CHANGE = 1e-11
MOST_ROUNDS = 256


def maximise(gains: FloatArray, uses: FloatArray, left: list[float], most: FloatArray) -> FloatArray:
    """
    Return the `x` (n,) with the greatest `gains @ x` under `uses @ x <= left` and `0 <= x <= most`.

    `gains` (n,) and `uses` (m, n) are scaled to at most 1. Rows with a negative `left` are met as far as possible,
    before any gain.
    """
    basis = _Basis(gains, uses, left, most)
    for _ in range(MOST_ROUNDS):
        entering = basis.find_entering()
        if entering is None or not basis.enter(entering):
            break
    return basis.found()


class _Basis:
    """
    The basic variables, neither 0 nor at their upper bound, one for each row, and the inverse of their uses.

    Variables come first, then the slack of each row, then its deficit.
    """

    def __init__(self, gains: FloatArray, uses: FloatArray, left: list[float], most: FloatArray) -> None:
        self._gains, self._uses, self._most = gains, uses, most
        rows, self._count = len(left), len(gains)
        lacks = [not each >= 0.0 for each in left]
        self._rows = range(rows)
        self._variables = [self._count + row + (rows if lacks[row] else 0) for row in self._rows]
        self._values = [abs(each) for each in left]
        self._worth = [-PENALTY if each else 0.0 for each in lacks]
        self._inverse = [[(-1.0 if lacks[row] else 1.0) if row == other else 0.0 for other in self._rows]
                         for row in self._rows]
        self._is_full, self._is_basic = (np.zeros(self._count, dtype=bool) for _ in range(2))

    def find_entering(self) -> int | None:
        """Return the variable that gains the most at the prices of the rows; None if no gain is large enough."""
        prices = [_sum(self._worth[row] * self._inverse[row][other] for row in self._rows)
                  for other in self._rows]
        gained = self._gains
        for price, used in zip(prices, self._uses):
            gained = gained - price * used
        gained = np.where(self._is_basic, 0.0, np.where(self._is_full, -gained, gained))
        entering, gain = int(gained.argmax()), float(gained.max())
        for row in self._rows:
            if -prices[row] > gain:
                entering, gain = self._count + row, -prices[row]
        return entering if gain > LEAST_GAIN else None

    def enter(self, entering: int) -> bool:
        """Let a variable rise, or fall, until it or a basic one reaches a bound; False if none does."""
        is_variable = entering < self._count
        direction = -1.0 if is_variable and self._is_full[entering] else 1.0
        bound = float(self._most[entering]) if is_variable else math.inf
        changes = [_sum(self._inverse[row][other] * float(self._uses[other, entering]) for other in self._rows)
                   if is_variable else self._inverse[row][entering - self._count] for row in self._rows]
        step, leaving, leaves_full = bound, -1, False
        for row in self._rows:
            room, fills = self._room(row, direction * changes[row])
            if room < step:
                step, leaving, leaves_full = max(room, 0.0), row, fills
        if not step < math.inf:
            return False
        self._values = [value - step * direction * change for value, change in zip(self._values, changes)]
        if leaving < 0:
            self._is_full[entering] = not self._is_full[entering]
            return True
        if self._variables[leaving] < self._count:
            self._is_basic[self._variables[leaving]] = False
            self._is_full[self._variables[leaving]] = leaves_full
        self._variables[leaving] = entering
        self._values[leaving] = bound - step if direction < 0.0 else step
        self._worth[leaving] = 0.0
        if is_variable:
            self._is_basic[entering], self._is_full[entering] = True, False
            self._worth[leaving] = float(self._gains[entering])
        leading = [value / changes[leaving] for value in self._inverse[leaving]]
        self._inverse = [leading if row == leaving else [
            value - changes[row] * lead for value, lead in zip(self._inverse[row], leading)]
            for row in self._rows]
        return True

    def _room(self, row: int, falls: float) -> tuple[float, bool]:
        """Return the step after which a row's variable, falling at a rate, is at a bound; whether at the upper."""
        if falls > LEAST_CHANGE:
            return self._values[row] / falls, False
        if falls < -LEAST_CHANGE and self._variables[row] < self._count:
            return (float(self._most[self._variables[row]]) - self._values[row]) / -falls, True
        return math.inf, False

    def found(self) -> FloatArray:
        """Return the values of all variables (n,)."""
        found = np.where(self._is_full, self._most, 0.0)
        for variable, value in zip(self._variables, self._values):
            if variable < self._count:
                found[variable] = min(max(value, 0.0), float(self._most[variable]))
        return found


def _sum(values: Iterable[float]) -> float:
    """Return the sum of values, added sequentially from 0.0 as in the core."""
    total = 0.0
    for value in values:
        total += value
    return total
