# SPDX-License-Identifier: Apache-2.0
"""
Departures that recur each week and prices of energy from the grid, by the local clock of a time zone; their files.

Rules for clock changes are those of RFC 5545 (section 3.3.5): a local time that occurs twice means the first
occurrence; a skipped one is read with the offset before the gap, so 02:30 becomes 03:30. A time with its own
offset names its instant, whatever the zone.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta, tzinfo, UTC
from functools import partial
from itertools import pairwise, takewhile
from pathlib import Path
import re
from typing import NamedTuple, TypeVar
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.checked_yaml import FileData, load_checked_yaml
from bev_preheat.numerics import FloatArray, NS_PER_S

CLOCK = re.compile(r'([01]?\d|2[0-3]):([0-5]\d)')
DATED = re.compile(r'(\d{4})-(\d\d)-(\d\d)[ T]([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d)(?:\.0+)?)?'
                   r'(?: ?(?:(Z)|([+-])([01]\d|2[0-3]):?([0-5]\d)))?')
DAYS = ('monday', 'tuesday', 'wednesday', 'thursday', 'friday', 'saturday', 'sunday')
# The names in the database are shorter.
LONGEST_ZONE_NAME = 100
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def zone_of(name: str) -> tzinfo:
    """Return the time zone of an IANA name; raise InvalidInput if it is unknown on this computer."""
    if name == 'UTC':
        return UTC
    try:
        if len(name) > LONGEST_ZONE_NAME:
            raise ValueError
        return ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise InvalidInput(
            f'time_zone: {quoted(name)} is unknown on this computer; it must be a name of the IANA time zone '
            'database, such as Europe/Berlin or UTC (Debian package tzdata)') from error


def clock_time(text: str) -> time:
    """Return the time of day of a text HH:MM; raise InvalidInput."""
    match = CLOCK.fullmatch(text)
    if match is None:
        raise InvalidInput(f'{quoted(text)} is not allowed; it must be HH:MM, 0:00 ... 23:59')
    return time(int(match[1]), int(match[2]))


def dated_instant_ns(text: str, zone: tzinfo) -> int:
    """Return the instant [ns] of a text YYYY-MM-DD HH:MM in a zone, or with its own offset; raise InvalidInput."""
    match = DATED.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        *numbers, utc, sign, hours, minutes = match.groups(default='')
        moment = datetime(*(int(number or 0) for number in numbers))  # type: ignore[arg-type]
        if utc or sign:
            offset = timedelta(hours=int(hours or 0), minutes=int(minutes or 0))
            return _ns_of(moment.replace(tzinfo=UTC) - (-offset if sign == '-' else offset))
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f'{quoted(text)} is not allowed; it must be YYYY-MM-DD HH:MM, if need be with an '
                           'offset: YYYY-MM-DD HH:MM+01:00') from error
    return instant_ns(moment.date(), moment.time(), zone)


def instant_ns(day: date, clock: time, zone: tzinfo) -> int:
    """Return the instant [ns] at which the clocks of a zone show a time on a day."""
    # fold=0 follows RFC 5545 for both kinds of clock change.
    return _ns_of(datetime.combine(day, clock.replace(fold=0), zone))


def _ns_of(moment: datetime) -> int:
    elapsed = moment - EPOCH
    return (elapsed.days * 86400 + elapsed.seconds) * NS_PER_S


def local(instant: int, zone: tzinfo) -> datetime:
    """Return the local date and time of an instant [ns], in whole seconds."""
    return (EPOCH + timedelta(seconds=instant // NS_PER_S)).astimezone(zone)


def in_words(instant: int, zone: tzinfo) -> str:
    """Return an instant [ns] as weekday, date, local time and zone: Thu 2026-11-26 07:30 CET."""
    moment = local(instant, zone)
    # strftime's %a depends on the locale.
    return f'{DAYS[moment.weekday()][:3].capitalize()} {moment:%Y-%m-%d %H:%M} {moment.tzname()}'


DAYS_A_WEEK = 7


@dataclass(frozen=True)
class Departure:
    """
    A departure on some days of each week (0 = Monday), at a local time.

    `target_c` [deg C] None: the planner's default. `is_plugged_in`: the vehicle is expected to be at the grid. A
    warmer battery is cooled to `most_c` [deg C]; None: it may be warmer.
    """

    name: str
    weekdays: frozenset[int]
    clock: time
    target_c: float | None
    is_plugged_in: bool
    most_c: float | None = None


class Occurrence(NamedTuple):
    """A Departure at an instant [ns]."""

    instant_ns: int
    departure: Departure


@dataclass(frozen=True)
class Departures:
    """The Departures of a week in a time zone; `ambient_c` [deg C] is assumed if no route has reported one."""

    zone: tzinfo
    departures: tuple[Departure, ...]
    ambient_c: float | None = None

    def after(self, instant: int) -> Iterator[Occurrence]:
        """
        Yield each Occurrence after an instant [ns], in order; it never ends, except without departures.

        Two departures at the same instant, which a clock change can cause, are one: that with the earlier
        local time.
        """
        # A day early, because a local time that a clock change skips may belong to the day before.
        day, latest_ns = local(instant, self.zone).date() - timedelta(days=1), instant
        by_clock = sorted(self.departures, key=lambda departure: departure.clock)
        while by_clock:
            # Sorting is stable.
            for occurrence in sorted(
                    [Occurrence(instant_ns(day, departure.clock, self.zone), departure)
                     for departure in by_clock if day.weekday() in departure.weekdays],
                    key=lambda occurrence: occurrence.instant_ns):
                if occurrence.instant_ns > latest_ns:
                    latest_ns = occurrence.instant_ns
                    yield occurrence
            day += timedelta(days=1)

    def until(self, from_ns: int, until_ns: int) -> list[Occurrence]:
        """Return each Occurrence after one instant, up to and including another [ns]."""
        return list(takewhile(lambda occurrence: occurrence.instant_ns <= until_ns, self.after(from_ns)))

    def in_words(self, occurrence: Occurrence) -> str:
        """Return an Occurrence as its name and local time: work, Thu 2026-11-26 07:30 CET."""
        return f'{occurrence.departure.name}, {in_words(occurrence.instant_ns, self.zone)}'


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
                     for first, last in pairwise(edges))

    def _daily_periods(self, from_ns: int, until_ns: int) -> list[PricePeriod]:
        first_day = local(from_ns, self.zone).date() - timedelta(days=2)
        days = (local(until_ns, self.zone).date() - first_day).days + 3
        # At a clock change two may begin at the same instant: the later one counts.
        begins = {instant_ns(first_day + timedelta(days=day), price.clock, self.zone): price.price_per_kwh
                  for day in range(days) for price in self.daily}
        return [PricePeriod(first, last, begins[first]) for first, last in pairwise(sorted(begins))]

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


Value = TypeVar('Value')
DEPARTURES_SCHEMA = Path(__file__).with_name('departures_schema.yaml')
PRICES_SCHEMA = Path(__file__).with_name('grid_prices_schema.yaml')


def load_departures(path: str | Path) -> Departures:
    """Return the Departures of a YAML file; raise InvalidInput naming file, key, value and allowed values."""
    reading = _Reading(path, DEPARTURES_SCHEMA)
    contents = reading.contents
    departures = [reading.departure(index, node) for index, node in enumerate(contents['departures'])]
    reading.find_duplicates([departure for departure in departures if departure is not None])
    reading.refuse_problems()
    return Departures(reading.zone, tuple(filter(None, departures)), _number(contents, 'ambient_temperature_c'))


def load_grid_prices(path: str | Path) -> GridPrices:
    """Return the GridPrices of a YAML file; raise InvalidInput naming file, key, value and allowed values."""
    reading = _Reading(path, PRICES_SCHEMA)
    contents = reading.contents
    if 'daily' not in contents and 'dated' not in contents:
        reading.problems.append('daily: is missing, and so is dated; give daily, dated or both')
    prices = GridPrices(reading.zone, reading.daily(contents.get('daily', [])),
                        reading.dated(contents.get('dated', [])), contents.get('currency', ''))
    reading.refuse_problems()
    return prices


def _number(node: FileData, key: str) -> float | None:
    """Return an optional number as a float: YAML reads 20 as an integer, which a ROS message refuses."""
    return float(node[key]) if key in node else None


class _Reading:
    """The contents of one file, its time zone, and its problems so far, as sentences without the file's name."""

    def __init__(self, path: str | Path, schema: Path) -> None:
        self._path = Path(path).expanduser()
        self.contents = contents = load_checked_yaml(self._path, schema)
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
            _number(node, 'target_battery_temperature_c'), node['plugged_in'],
            _number(node, 'maximum_arrival_temperature_c'))

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
        clocks = [self._read(f'daily[{index}].from', partial(clock_time, node['from']))
                  for index, node in enumerate(nodes)]
        prices = [DailyPrice(clock, float(node['price_per_kwh']))
                  for clock, node in zip(clocks, nodes) if clock is not None]
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
