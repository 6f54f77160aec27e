# SPDX-License-Identifier: Apache-2.0
"""Planned distance from the start over planned time, and back; at a stop one distance has a span of time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.route.segments import Route


@dataclass(frozen=True, eq=False)
class Places:
    """Distance from the start [m] over planned time [s], linear between points; both from 0, shapes (M,)."""

    time_s: FloatArray
    distance_m: FloatArray

    @classmethod
    def of_route(cls, route: Route) -> Places:
        """Return the Places of a route."""
        return cls(route.time_s, np.concatenate(([0.0], np.cumsum(route.duration_s * route.speed_mps))))

    @classmethod
    def joined(cls, parts: Iterable[tuple[float, Places]]) -> Places:
        """Return the Places of several parts in a row: (start of each [s], its Places)."""
        times_s, distances_m, length_m = [], [], 0.0
        for start_s, places in parts:
            times_s.append(start_s + places.time_s)
            distances_m.append(length_m + places.distance_m)
            length_m += places.length_m
        return cls(np.concatenate(times_s), np.concatenate(distances_m))

    @property
    def length_m(self) -> float:
        """Distance from the start to the end [m]."""
        return float(self.distance_m[-1])

    def distance_at_m(self, time_s: float) -> float:
        """Return the distance [m] at a planned time [s]."""
        return float(np.interp(time_s, self.time_s, self.distance_m))

    def earliest_s(self, distance_m: float) -> float:
        """Return the first planned time [s] at or beyond a distance [m]; -inf at the start, else the end's."""
        at = int(np.searchsorted(self.distance_m, distance_m, side='left'))
        if at == 0:
            return -math.inf
        return self._between_s(at, distance_m) if at < len(self.time_s) else float(self.time_s[-1])

    def latest_s(self, distance_m: float) -> float:
        """Return the last planned time [s] at or before a distance [m]; inf at the end, else the start's."""
        at = int(np.searchsorted(self.distance_m, distance_m, side='right'))
        if at == len(self.time_s):
            return math.inf
        return self._between_s(at, distance_m) if at > 0 else float(self.time_s[0])

    def _between_s(self, at: int, distance_m: float) -> float:
        """Return the time of a distance between the points `at` - 1 and `at`, which differ."""
        before_m, after_m = self.distance_m[at - 1], self.distance_m[at]
        before_s, after_s = self.time_s[at - 1], self.time_s[at]
        share = (distance_m - before_m) / (after_m - before_m)
        return float(before_s + share * (after_s - before_s))
