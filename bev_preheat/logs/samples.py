# SPDX-License-Identifier: Apache-2.0
"""Collects the samples of a signal in bounded memory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.logs.recording import Series

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray

# Beyond this many samples of a channel, pairs of neighbours are averaged (six hours at 10 Hz).
MOST_SAMPLES = 200_000


class Samples:
    """Samples of one channel: times, values and places; at most twice MOST_SAMPLES, however long the log is."""

    def __init__(self) -> None:
        """Start without samples."""
        self._kept: list[tuple[FloatArray, FloatArray, IntArray]] = []
        self._count = 0
        # How many readings one kept sample is the mean of.
        self.averaged = 1
        self.readings = 0

    def add(self, time_s: FloatArray, values: FloatArray, places: IntArray) -> None:
        """Add samples; those that are not finite are left out."""
        good = np.isfinite(time_s) & np.isfinite(values)
        self.readings += int(good.sum())
        time_s, values, places = time_s[good], values[good], places[good]
        for _ in range(self.averaged.bit_length() - 1):
            time_s, values, places = _halved(time_s, values, places)
        self._kept.append((time_s, values, places))
        self._count += len(time_s)
        while self._count > 2 * MOST_SAMPLES:
            halved = _halved(*self.arrays())
            self._kept, self._count = [halved], len(halved[0])
            self.averaged *= 2

    def arrays(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Return times, values and places, each of shape (N,), in the order of the file."""
        if not self._kept:
            return np.empty(0), np.empty(0), np.empty(0, dtype=int)
        times, values, places = zip(*self._kept)
        return np.concatenate(times), np.concatenate(values), np.concatenate(places)


def _halved(time_s: FloatArray, values: FloatArray, places: IntArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the means of pairs of neighbours; an odd last sample stays."""
    pairs = len(time_s) // 2 * 2

    def mean(array: FloatArray) -> FloatArray:
        return np.concatenate([0.5 * (array[0:pairs:2] + array[1:pairs:2]), array[pairs:]])

    # A view would keep all places in memory.
    return mean(time_s), mean(values), places[::2].copy()


def combined(parts: list[Series], how: str, hold_s: float, at_least: int = 0) -> Series:
    """
    Return one Series of several channels: their mean, min or max at the instants of the longest.

    A channel takes part at an instant if it has a sample at most `hold_s` away; instants at which fewer than
    `at_least` channels take part are left out.
    """
    longest = max(parts, key=lambda part: len(part.time_s))
    rows = []
    for part in parts:
        at = np.clip(np.searchsorted(part.time_s, longest.time_s), 1, max(len(part.time_s) - 1, 1))
        before, after = at - 1, np.minimum(at, len(part.time_s) - 1)
        nearest_s = np.minimum(np.abs(part.time_s[before] - longest.time_s),
                               np.abs(part.time_s[after] - longest.time_s))
        rows.append(np.where(nearest_s <= hold_s, np.interp(longest.time_s, part.time_s, part.value), np.nan))
    table = np.array(rows)
    value = (np.nanmin(table, axis=0) if how == 'min' else np.nanmax(table, axis=0) if how == 'max' else
             np.nanmean(table, axis=0))
    enough = np.isfinite(table).sum(axis=0) >= at_least
    return Series(longest.time_s[enough], value[enough])
