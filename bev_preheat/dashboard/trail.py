# SPDX-License-Identifier: Apache-2.0
"""A history of bounded size: recent points as they came, older ones further apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

MOST_POINTS = 2000
# Points older than this are dropped [s].
HORIZON_S = 86400.0


class Trail:
    """
    Rows of numbers, the instant [s] first, in order of time; at most `most` of them.

    A full trail drops the rows beyond the horizon and every second row of its older half. `generation` changes
    when rows were dropped, so that a reader knows that it has to read all of them again.
    """

    def __init__(self, most: int = MOST_POINTS, horizon_s: float = HORIZON_S) -> None:
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
        self._rows = [row for row in self._rows if row[0] >= now_s - self._horizon_s]
        if len(self._rows) > self._most:
            half = len(self._rows) // 2
            self._rows = self._rows[:half:2] + self._rows[half:]
        self.generation += 1
