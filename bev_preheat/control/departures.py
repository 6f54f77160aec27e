# SPDX-License-Identifier: Apache-2.0
"""Departures that recur each week, by the local clock of a time zone."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.local_time import in_words, instant_ns, local

if TYPE_CHECKING:
    from collections.abc import Iterator
    from datetime import time, tzinfo

DAYS_A_WEEK = 7


@dataclass(frozen=True)
class Departure:
    """
    A departure on some days of each week (0 = Monday), at a local time.

    `target_c` [deg C] None: the planner's default. `is_plugged_in`: the vehicle is expected to be at the grid.
    """

    name: str
    weekdays: frozenset[int]
    clock: time
    target_c: float | None
    is_plugged_in: bool


class Occurrence(NamedTuple):
    """A Departure at an instant [ns]."""

    instant_ns: int
    departure: Departure


@dataclass(frozen=True)
class Departures:
    """
    The Departures of a week in a time zone.

    `ambient_c` [deg C] is the ambient temperature to assume if no route has reported one; None: not given.
    """

    zone: tzinfo
    departures: tuple[Departure, ...]
    ambient_c: float | None = None

    @cached_property
    def _by_clock(self) -> tuple[Departure, ...]:
        return tuple(sorted(self.departures, key=lambda departure: departure.clock))

    def after(self, instant: int) -> Iterator[Occurrence]:
        """
        Yield each Occurrence after an instant [ns], in order; it never ends, except without departures.

        Two departures at the same instant, which a clock change can cause, are one: that with the earlier local time.
        """
        # A day early, because a local time that a clock change skips may belong to the day before.
        day, latest_ns = local(instant, self.zone).date() - timedelta(days=1), instant
        while self.departures:
            found = sorted((instant_ns(day, departure.clock, self.zone), number)
                           for number, departure in enumerate(self._by_clock) if day.weekday() in departure.weekdays)
            for at_ns, number in found:
                if at_ns > latest_ns:
                    latest_ns = at_ns
                    yield Occurrence(at_ns, self._by_clock[number])
            day += timedelta(days=1)

    def until(self, from_ns: int, until_ns: int) -> list[Occurrence]:
        """Return each Occurrence after one instant, up to and including another [ns]."""
        found = []
        for occurrence in self.after(from_ns):
            if occurrence.instant_ns > until_ns:
                break
            found.append(occurrence)
        return found

    def in_words(self, occurrence: Occurrence) -> str:
        """Return an Occurrence as its name and local time: work, Thu 2026-11-26 07:30 CET."""
        return f'{occurrence.departure.name}, {in_words(occurrence.instant_ns, self.zone)}'
