# SPDX-License-Identifier: Apache-2.0
"""How far the simulated car is along the route that its trip planner sent, and when that is told."""

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
    How the car says where it is: every `period_s` [s], with noise (standard deviation [m]).

    In the spans (from, until) [s] of `drop_outs` it does not.
    """

    period_s: float = 1.0
    noise_m: float = 0.0
    drop_outs: tuple[Span, ...] = ()


class Position:
    """
    Distances along the route that was sent last, when they are due; instants are those of the drive [s].

    After a detour the route that was sent before it says nothing of where the car is.
    """

    def __init__(self, reports: PositionReports | None, driven: Route, events: Sequence[Event],
                 random: np.random.Generator) -> None:
        """`driven` is the Route that is really driven; None reports nothing."""
        self._reports, self._random = reports, random
        self._places = Places.of_route(driven)
        self._detours_s = [event.at_s for event in events if event.kind is Kind.DETOUR]
        self._begins_s = 0.0
        self._count = 0

    def begin_route(self, at_s: float) -> None:
        """Count from where the car is at an instant [s]: there a route begins that was sent."""
        self._begins_s = at_s

    @property
    def next_s(self) -> float:
        """When the next report is due [s]; inf: never."""
        # Numbered, not summed up: sums of periods miss the battery states' instants.
        return math.inf if self._reports is None else self._count * self._reports.period_s

    def report_m(self, now_s: float) -> float | None:
        """Return the distance that is reported now [m]; None where none is due, or known."""
        if self._reports is None or now_s < self.next_s:
            return None
        # What was missed is not made up for.
        self._count = math.floor(now_s / self._reports.period_s + 1e-9) + 1
        noise_m = self._reports.noise_m * self._random.normal()
        is_lost = any(self._begins_s < detour_s <= now_s for detour_s in self._detours_s)
        if is_lost or within(now_s, self._reports.drop_outs):
            return None
        return max(0.0, self._places.distance_at_m(now_s)
                   - self._places.distance_at_m(self._begins_s) + noise_m)
