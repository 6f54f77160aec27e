# SPDX-License-Identifier: Apache-2.0
"""Prices of energy from the grid: recurring each day by a local clock, and of certain days."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from datetime import timedelta
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.control.local_time import instant_ns, local
from bev_preheat.numerics.factors import NS_PER_S

if TYPE_CHECKING:
    from datetime import time, tzinfo

    from bev_preheat.numerics.arrays import FloatArray


class DailyPrice(NamedTuple):
    """A price per kWh from a local time of each day until the next DailyPrice; negative: the grid pays."""

    clock: time
    price_per_kwh: float


class PricePeriod(NamedTuple):
    """A price per kWh from one instant until another [ns]; None: unknown."""

    from_ns: int
    until_ns: int
    price_per_kwh: float | None


@dataclass(frozen=True)
class GridPrices:
    """
    Prices per kWh in a time zone: `daily`, by time of day, and `dated`, in order, which outrank them.

    `currency` is for tables and figures, '' if not given.
    """

    zone: tzinfo
    daily: tuple[DailyPrice, ...] = ()
    dated: tuple[PricePeriod, ...] = ()
    currency: str = ''

    def periods(self, from_ns: int, until_ns: int) -> tuple[PricePeriod, ...]:
        """Return PricePeriods without gaps from one instant until another [ns]; () for an empty time."""
        if until_ns <= from_ns:
            return ()
        daily = self._daily_periods(from_ns, until_ns)
        edges = sorted({from_ns, until_ns, *(
            edge for period in (*daily, *self.dated) for edge in (period.from_ns, period.until_ns)
            if from_ns < edge < until_ns)})
        return tuple(PricePeriod(first, last, _price_at(self.dated, first, _price_at(daily, first, None)))
                     for first, last in zip(edges, edges[1:]))

    def _daily_periods(self, from_ns: int, until_ns: int) -> list[PricePeriod]:
        if not self.daily:
            return []
        day = local(from_ns, self.zone).date() - timedelta(days=2)
        last_day = local(until_ns, self.zone).date() + timedelta(days=2)
        begins: dict[int, float] = {}
        while day <= last_day:
            for price in self.daily:
                # At a clock change two may begin at the same instant: the later one counts.
                begins[instant_ns(day, price.clock, self.zone)] = price.price_per_kwh
            day += timedelta(days=1)
        instants = sorted(begins)
        return [PricePeriod(first, last, begins[first]) for first, last in zip(instants, instants[1:])]

    def step_prices(self, start_ns: int, time_s: FloatArray) -> FloatArray:
        """
        Return the mean price per kWh of each step (N,) between instants `time_s` [s] (N + 1,) after one [ns].

        An unknown price counts as the highest known one between the first and the last instant, so that such a
        step is used only if the others do not suffice; 0 if all are unknown.
        """
        periods = self.periods(start_ns, start_ns + round(float(time_s[-1]) * NS_PER_S))
        known = [period.price_per_kwh for period in periods if period.price_per_kwh is not None]
        highest = max(known, default=0.0)
        edges_s = np.array([0.0, *((period.until_ns - start_ns) / NS_PER_S for period in periods)])
        prices = np.array([highest if period.price_per_kwh is None else period.price_per_kwh
                           for period in periods])
        # The integral of the price over time is exact at every instant.
        paid = np.interp(time_s, edges_s, np.concatenate(([0.0], np.cumsum(prices * np.diff(edges_s)))))
        means: FloatArray = np.diff(paid) / np.diff(time_s)
        return means

    def unknown_from_ns(self, from_ns: int, until_ns: int) -> int | None:
        """Return the first instant [ns] without a price between two instants; None if all are known."""
        return next((period.from_ns for period in self.periods(from_ns, until_ns)
                     if period.price_per_kwh is None), None)

    def is_known(self, from_ns: int, until_ns: int) -> bool:
        """Return whether any price between two instants [ns] is known."""
        return any(period.price_per_kwh is not None for period in self.periods(from_ns, until_ns))


def _price_at(periods: tuple[PricePeriod, ...] | list[PricePeriod], instant: int,
              otherwise: float | None) -> float | None:
    """Return the price of the period, in order and without overlap, that holds an instant [ns]."""
    number = bisect_right(periods, instant, key=lambda period: period.from_ns) - 1
    if number < 0 or periods[number].until_ns <= instant:
        return otherwise
    return periods[number].price_per_kwh
