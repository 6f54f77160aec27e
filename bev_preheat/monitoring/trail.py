# SPDX-License-Identifier: Apache-2.0
"""A history of bounded size: recent points as they came, older ones further apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

TRAIL_POINTS = 2000
# Points older than this are dropped [s].
HORIZON_S = 86400.0
# Rows of a full trail are at least this share of their age apart, divided by the most rows, and this time [s].
# Then some 3/4 of the rows are left, whatever the rate: their number grows with the logarithm of the horizon.
SHARE_OF_AGE, LEAST_APART_S = 14.0, 0.05


class Trail:
    """
    Rows of numbers, the instant [s] first, in order of time; at most `most` rows.

    A full trail drops the rows beyond the horizon, and others so that older rows are further apart. `generation`
    changes when rows were dropped, so that a reader knows that it has to read all rows again.
    """

    def __init__(self, most: int = TRAIL_POINTS, horizon_s: float = HORIZON_S) -> None:
        """Start empty."""
        self._most, self._horizon_s = most, horizon_s
        self._rows: list[tuple[float, ...]] = []
        self.generation = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self._rows)

    def add(self, row: tuple[float, ...]) -> None:
        """Add a row; one with the latest instant, or with an earlier one, replaces the later rows."""
        if self._rows and row[0] <= self._rows[-1][0]:
            self._rows.pop()
            while self._rows and row[0] <= self._rows[-1][0]:
                self._rows.pop()
            self.generation += 1
        self._rows.append(row)
        if len(self._rows) > self._most:
            self._thin(row[0])

    def clear(self) -> None:
        """Drop all rows."""
        if self._rows:
            self._rows.clear()
            self.generation += 1

    def since(self, count: int) -> Sequence[tuple[float, ...]]:
        """Return the rows after the first `count`."""
        return self._rows[count:]

    def _thin(self, now_s: float) -> None:
        share, kept, later_s = SHARE_OF_AGE / self._most, [self._rows[-1]], self._rows[-1][0]
        for row in reversed(self._rows[:-1]):
            age_s = now_s - row[0]
            if age_s > self._horizon_s:
                break
            if later_s - row[0] >= max(share * age_s, LEAST_APART_S):
                kept.append(row)
                later_s = row[0]
        self._rows = kept[::-1][-self._most:]
        self.generation += 1
