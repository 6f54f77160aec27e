# SPDX-License-Identifier: Apache-2.0
"""Position reports of the simulated car along the route sent last."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import TYPE_CHECKING

from bev_preheat.route.places import Places
from bev_preheat.simulation.sensors import Span, within
from bev_preheat.simulation.traffic import Event, Kind

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from bev_preheat.route.segments import Route


@dataclass(frozen=True)
class PositionReports:
    """
    Position reports of the car: every `period_s` [s], with noise (standard deviation [m]).

    None in the spans (from, until) [s] of `drop_outs`.
    """

    period_s: float = 1.0
    noise_m: float = 0.0
    drop_outs: tuple[Span, ...] = ()


class Position:
    """
    Reported distances along the route sent last; instants are those of the drive [s].

    After a detour the route sent before it gives no position.
    """

    def __init__(self, reports: PositionReports | None, driven: Route, events: Sequence[Event],
                 random: np.random.Generator) -> None:
        """Start with the Route actually driven; `reports` None: no reports."""
        self._reports, self._random = reports, random
        self._places = Places.of_route(driven)
        self._detours_s = [event.at_s for event in events if event.kind is Kind.DETOUR]
        self._begins_s = 0.0
        self._count = 0

    def begin_route(self, at_s: float) -> None:
        """Restart at the car's place at an instant [s], where a newly sent route begins."""
        self._begins_s = at_s

    @property
    def next_s(self) -> float:
        """Instant of the next report [s]; inf: never."""
        # Multiples of the period, because sums would drift from the battery states' instants.
        return math.inf if self._reports is None else self._count * self._reports.period_s

    def report_m(self, now_s: float) -> float | None:
        """Return the distance reported now [m]; None if no report is due, or the place is unknown."""
        if self._reports is None or now_s < self.next_s:
            return None
        # Missed reports are not repeated.
        self._count = math.floor(now_s / self._reports.period_s + 1e-9) + 1
        noise_m = self._reports.noise_m * self._random.normal()
        is_lost = any(self._begins_s < detour_s <= now_s for detour_s in self._detours_s)
        if is_lost or within(now_s, self._reports.drop_outs):
            return None
        return max(0.0, self._places.distance_at_m(now_s)
                   - self._places.distance_at_m(self._begins_s) + noise_m)
