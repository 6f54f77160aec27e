# SPDX-License-Identifier: Apache-2.0
"""A week's departures, and prices of energy from the grid, as YAML files (see their schemas)."""

from __future__ import annotations

from collections import Counter
from datetime import UTC
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from bev_preheat.control.departures import (
    clock_time,
    DailyPrice,
    dated_instant_ns,
    DAYS,
    Departure,
    Departures,
    GridPrices,
    in_words,
    PricePeriod,
    zone_of,
)
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import tzinfo

Value = TypeVar('Value')
DEPARTURES_SCHEMA = Path(__file__).with_name('departures_schema.yaml')
PRICES_SCHEMA = Path(__file__).with_name('grid_prices_schema.yaml')


def load_departures(path: str | Path) -> Departures:
    """Return the Departures of a YAML file; raise InvalidInput naming file, key, value and allowed values."""
    path = Path(path).expanduser()
    contents = load_checked_yaml(path, DEPARTURES_SCHEMA)
    reading = _Reading(path, contents)
    departures = [reading.departure(index, node) for index, node in enumerate(contents['departures'])]
    reading.find_duplicates([departure for departure in departures if departure is not None])
    reading.refuse_problems()
    return Departures(reading.zone, tuple(filter(None, departures)), _number(contents, 'ambient_temperature_c'))


def load_grid_prices(path: str | Path) -> GridPrices:
    """Return the GridPrices of a YAML file; raise InvalidInput naming file, key, value and allowed values."""
    path = Path(path).expanduser()
    contents = load_checked_yaml(path, PRICES_SCHEMA)
    reading = _Reading(path, contents)
    if 'daily' not in contents and 'dated' not in contents:
        reading.problems.append('daily: is missing, and so is dated; at least one of them must be given')
    prices = GridPrices(reading.zone, reading.daily(contents.get('daily', [])),
                        reading.dated(contents.get('dated', [])), contents.get('currency', ''))
    reading.refuse_problems()
    return prices


def _number(node: FileData, key: str) -> float | None:
    """Return an optional number as a float: YAML reads 20 as an integer, which a ROS message refuses."""
    return float(node[key]) if key in node else None


class _Reading:
    """The problems of one file so far, as sentences without the file's name, and its time zone."""

    def __init__(self, path: Path, contents: FileData) -> None:
        self._path = path
        self.problems: list[str] = []
        self.zone: tzinfo = self._read('', lambda: zone_of(contents['time_zone'])) or UTC

    def refuse_problems(self) -> None:
        """Raise InvalidInput if there is any problem."""
        if self.problems:
            raise InvalidInput([f'{self._path}: {problem}' for problem in self.problems])

    def _read(self, key: str, read: Callable[[], Value]) -> Value | None:
        """Return the value that `read` returns; note its refusal and return None."""
        try:
            return read()
        except InvalidInput as error:
            self.problems += [f'{key}: {problem}' if key else problem for problem in error.problems]
            return None

    # Departures

    def departure(self, index: int, node: FileData) -> Departure | None:
        """Return a Departure; None if its time is refused."""
        clock = self._read(f'departures[{index}].time', lambda: clock_time(node['time']))
        return None if clock is None else Departure(
            node['name'], frozenset(map(DAYS.index, node['weekdays'])), clock,
            _number(node, 'target_battery_temperature_c'), node['plugged_in'])

    def find_duplicates(self, departures: list[Departure]) -> None:
        """Note names and times that are given twice."""
        for name, count in Counter(departure.name for departure in departures).items():
            if count > 1:
                self.problems.append(f'departures: duplicate name {quoted(name)} ({count} times)')
        taken = Counter((day, departure.clock) for departure in departures for day in departure.weekdays)
        for (day, clock), count in taken.items():
            if count > 1:
                self.problems.append(f'departures: {count} departures on {DAYS[day]} at {clock:%H:%M}; '
                                     'only one is allowed')

    # Prices

    def daily(self, nodes: list[FileData]) -> tuple[DailyPrice, ...]:
        """Return the DailyPrices in the order of the day."""
        prices = []
        for index, node in enumerate(nodes):
            clock = self._read(f'daily[{index}].from', partial(clock_time, node['from']))
            if clock is not None:
                prices.append(DailyPrice(clock, float(node['price_per_kwh'])))
        for clock, count in Counter(price.clock for price in prices).items():
            if count > 1:
                self.problems.append(f'daily: {count} prices from {clock:%H:%M} on; only one is allowed')
        return tuple(sorted(prices, key=lambda price: price.clock))

    def dated(self, nodes: list[FileData]) -> tuple[PricePeriod, ...]:
        """Return the PricePeriods of dated prices; each lasts until the next, unless it says until when."""
        begins = [self._instant(f'dated[{index}].from', node['from']) for index, node in enumerate(nodes)]
        periods: list[PricePeriod] = []
        for index, (node, from_ns) in enumerate(zip(nodes, begins)):
            if 'until' in node:
                until_ns = self._instant(f'dated[{index}].until', node['until'])
            elif index + 1 < len(nodes):
                until_ns = begins[index + 1]
            else:
                self.problems.append(f'dated[{index}].until: is missing; the last price needs its end')
                continue
            if from_ns is None or until_ns is None:
                continue
            if until_ns <= from_ns:
                self.problems.append(f'dated[{index}]: ends {in_words(until_ns, self.zone)}, not after its begin; '
                                     'prices must be in order')
            elif periods and from_ns < periods[-1].until_ns:
                self.problems.append(f'dated[{index}].from: {in_words(from_ns, self.zone)} lies before the end '
                                     'of the price before it; prices must be in order, without overlap')
            else:
                periods.append(PricePeriod(from_ns, until_ns, float(node['price_per_kwh'])))
        return tuple(periods)

    def _instant(self, key: str, text: str) -> int | None:
        return self._read(key, lambda: dated_instant_ns(text, self.zone))
