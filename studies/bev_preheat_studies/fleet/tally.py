# SPDX-License-Identifier: Apache-2.0
"""
Counts, sums and histograms of a fleet, of the same size for a thousand trips and for a million.

All are integers (sums in thousandths of a unit), so that the total does not depend on the order of the
blocks. Quantiles come from histograms with fixed bins.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from bev_preheat.numerics.arrays import FloatArray

    IntArray = NDArray[np.int64]

# The quantities summed for each way and group; those with a histogram have a bin width.
HEATER_WH, BOUGHT_WH, CHARGING_S, ARRIVAL_C, REACHED = (
    'heater_wh', 'bought_wh', 'charging_s', 'arrival_c', 'reached')
SAVED_S, MORE_WH = 'saved_s', 'more_wh'
QUANTITIES = (HEATER_WH, BOUGHT_WH, CHARGING_S, ARRIVAL_C, REACHED, SAVED_S, MORE_WH)
BIN_WIDTHS = {SAVED_S: 15.0, MORE_WH: 50.0}
PER_UNIT = 1000

# A trip belongs to these groups: all, its car, its temperature, its length, and temperature with length.
ALL = 'all'
AMBIENT_EDGES_C = (-15.0, -10.0, -5.0, 0.0, 5.0)
LENGTH_EDGES_MIN = (30.0, 60.0, 90.0)


def names_of(edges: tuple[float, ...], unit: str) -> list[str]:
    """Return the names of the intervals between edges on a scale."""
    return [f'below {edges[0]:g} {unit}',
            *(f'{low:g} to {high:g} {unit}' for low, high in zip(edges, edges[1:])),
            f'from {edges[-1]:g} {unit}']


AMBIENTS, LENGTHS = names_of(AMBIENT_EDGES_C, 'degC'), names_of(LENGTH_EDGES_MIN, 'min')


def groups_of(car: str, ambient_c: float, length_min: float) -> tuple[str, ...]:
    """Return the names of a trip's groups; the last group has no histogram."""
    return groups_of_all([car], np.array([ambient_c]), np.array([length_min]))[0]


def groups_of_all(cars: Sequence[str], ambient_c: FloatArray,
                  length_min: FloatArray) -> list[tuple[str, ...]]:
    """Return `groups_of` each of K trips; arguments of shape (K,)."""
    parts = zip(cars, np.searchsorted(AMBIENT_EDGES_C, ambient_c, side='right').tolist(),
                np.searchsorted(LENGTH_EDGES_MIN, length_min, side='right').tolist())
    return [_names(*part) for part in parts]


@cache
def _names(car: str, ambient: int, length: int) -> tuple[str, ...]:
    return (ALL, car, AMBIENTS[ambient], LENGTHS[length], f'{AMBIENTS[ambient]}, {LENGTHS[length]}')


@dataclass
class Tally:
    """
    Counts: trips by group, excluded trips by reason, sums and histograms.

    `sums` {(way, group, quantity): thousandths}, `bins` {(way, group, quantity): {bin: trips}}.
    """

    trips: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    sums: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    bins: dict[tuple[str, str, str], Counter[int]] = field(default_factory=dict)

    def count(self, groups: Sequence[tuple[str, ...]], ways: Sequence[str], values: FloatArray) -> None:
        """Count trips: the groups of each (`groups_of`), and `values` (trips, ways, QUANTITIES)."""
        thousandths = np.rint(PER_UNIT * values).astype(np.int64)
        binned = {QUANTITIES.index(name): np.floor(
            values[:, :, QUANTITIES.index(name)] / width).astype(np.int64)
            for name, width in BIN_WIDTHS.items()}
        alike: dict[tuple[str, ...], list[int]] = {}
        for trip, names in enumerate(groups):
            alike.setdefault(names, []).append(trip)
        members: dict[str, list[int]] = {}
        for names, trips in alike.items():
            for name in names:
                members.setdefault(name, []).extend(trips)
        without_bins = {names[-1] for names in alike}
        for group, trips in members.items():
            self.trips[group] += len(trips)
            sums = thousandths[trips].sum(axis=0).tolist()
            for way, of_way in zip(ways, sums):
                for quantity, thousandth in zip(QUANTITIES, of_way):
                    self.sums[way, group, quantity] += thousandth
            if group not in without_bins:
                for at, places in binned.items():
                    for number, way in enumerate(ways):
                        self._count_bins((way, group, QUANTITIES[at]), places[trips, number])

    def _count_bins(self, key: tuple[str, str, str], places: IntArray) -> None:
        low = int(places.min())
        counts = np.bincount(places - low).tolist()
        self.bins.setdefault(key, Counter()).update(
            {low + at: trips for at, trips in enumerate(counts) if trips})

    @property
    def counted(self) -> int:
        """Number of drawn trips, including those left out."""
        return self.trips[ALL] + self.left_out.total()

    def with_other(self, other: Tally) -> Tally:
        """Return the sum of both tallies; `self` is unchanged."""
        both = Tally()
        both.add(self)
        both.add(other)
        return both

    def add(self, other: Tally) -> None:
        """Add another Tally to this one."""
        self.trips.update(other.trips)
        self.left_out.update(other.left_out)
        self.sums.update(other.sums)
        for key, places in other.bins.items():
            self.bins.setdefault(key, Counter()).update(places)

    def mean(self, way: str, group: str, quantity: str) -> float | None:
        """Return the mean of a quantity over a group's trips; None for an empty group."""
        trips = self.trips[group]
        return self.sums[way, group, quantity] / PER_UNIT / trips if trips else None

    def quantile(self, way: str, group: str, quantity: str, share: float) -> float | None:
        """Return the quantile of a quantity for a share 0 ... 1 of a group's trips, to a bin's width."""
        places = self.bins.get((way, group, quantity))
        if not places:
            return None
        width, wanted, below = BIN_WIDTHS[quantity], share * places.total(), 0
        for place in sorted(places):
            inside = places[place]
            if below + inside >= wanted:
                return width * (place + (wanted - below) / inside)
            below += inside
        return width * (max(places) + 1)

    def as_record(self) -> dict[str, Any]:
        """Return the tally as plain values for JSON."""
        record: dict[str, Any] = {'trips': dict(self.trips), 'left_out': dict(self.left_out),
                                  'quantities': list(QUANTITIES), 'sums': {}, 'bins': {}}
        for way, group in dict.fromkeys(key[:2] for key in self.sums):
            record['sums'].setdefault(way, {})[group] = [
                self.sums[way, group, quantity] for quantity in QUANTITIES]
        for (way, group, quantity), places in self.bins.items():
            # The number of the first bin, then the counts from that bin on.
            low, high = min(places), max(places)
            record['bins'].setdefault(way, {}).setdefault(group, {})[quantity] = [
                low, *(places[place] for place in range(low, high + 1))]
        return record


def tally_from(record: dict[str, Any]) -> Tally:
    """Return the Tally of a dictionary made by `as_record`."""
    tally = Tally(Counter(record['trips']), Counter(record['left_out']))
    for way, groups in record['sums'].items():
        for group, values in groups.items():
            tally.sums.update({(way, group, quantity): value
                               for quantity, value in zip(record['quantities'], values)})
    for way, groups in record['bins'].items():
        for group, quantities in groups.items():
            for quantity, (low, *counts) in quantities.items():
                tally.bins[way, group, quantity] = Counter(
                    {low + at: trips for at, trips in enumerate(counts) if trips})
    return tally
