# SPDX-License-Identifier: Apache-2.0
"""Chooses the column, or the columns of date and time of day, that hold the time of a log."""

from __future__ import annotations

from collections.abc import Sequence
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.files.times import Clock, find_clock, TIME_UNITS
from bev_preheat.logs.choice import candidates
from bev_preheat.logs.signal_map import matches, SignalMap

# Names of times, the best first.
NAMES = (
    r'^(epoch|unix|posix)', r'^(time_?stamp|utc|date[ _/-]?time|zeitstempel|datum[ _/-]?(uhr)?zeit|ts)\b',
    r'^(device|log|local)[ _]?time', r'^last[ _]?(changed|updated|reported|seen)$',
    r'^(created|recorded|logged|received)[ _]?(at|on)$', r'^(time|zeit)_',
    r'^(time|zeit|tiempo|temps|tempo|время|时间|aika|tid|tijd|czas)\b',
    r'^(elapsed|seconds|secs?|sekunden|running|relative|uptime|rel)\b', r'gps[ _]?time',
    r'^(date|datum)$', r'^t([ _]|$)', r'time|zeit|timestamp|date')
DATE = re.compile(r'^(date|datum|fecha|дата|日期|day)$', re.IGNORECASE)
DAY_TIME = re.compile(r'^(time|zeit|uhrzeit|hora|время|时间|clock|time of day)$', re.IGNORECASE)
DURATION = re.compile(r'dur(ation|ée)|dauer|remaining|to[ _]full|charge[ _]time', re.IGNORECASE)


# Share of the steps of a time that do not go back.
LEAST_RISING = 0.8


class TimeColumn(NamedTuple):
    """Numbers of the columns that hold the time (two: date, time of day), and the Clock that reads them."""

    columns: tuple[int, ...]
    clock: Clock


def find_time_column(header: Sequence[str], units: Sequence[str], rows: Sequence[Sequence[str]], decimal: str,
                     signal_map: SignalMap) -> TimeColumn | None:
    """Return the TimeColumn of a table, None if it has no time; no signal's channel is the time."""
    def texts(column: int) -> list[str]:
        return [row[column] if column < len(row) else '' for row in rows]

    def clock_of(column: int) -> Clock | None:
        return find_clock(texts(column), units[column], decimal)

    dates = [at for at, name in enumerate(header) if DATE.match(name.strip())]
    times = [at for at, name in enumerate(header) if DAY_TIME.match(name.strip())]
    ranked = [at for entry in signal_map.time for at, name in enumerate(header) if matches(entry, name)]
    if not ranked and dates and times:
        joined = find_clock([f'{date} {time}' for date, time in zip(texts(dates[0]), texts(times[0]))])
        if joined is not None:
            return TimeColumn((dates[0], times[0]), joined)
    ranked += [at for pattern in NAMES for at, name in enumerate(header)
               if re.search(pattern, name.rpartition('.')[2].strip(), re.IGNORECASE) and not DURATION.search(name)]
    stated = dict(zip(header, units))
    may_be = {header[at]: stated[header[at]] for at in ranked}
    taken = {name for source in signal_map.sources.values() for group in candidates(source, may_be).groups[:1]
             for name in group}
    # A t_env_c is a temperature.
    ranked = [at for at in ranked if header[at] not in taken and (
        not stated[header[at]] or stated[header[at]] in TIME_UNITS)] or ranked
    fallback = None
    for at in dict.fromkeys(ranked):
        clock = clock_of(at)
        if clock is None:
            continue
        seconds = clock.seconds(texts(at))
        finite = seconds[np.isfinite(seconds)]
        found = TimeColumn((at,), clock_of(at) or clock)
        # The time moves on; a constant column is a setting, a falling column a measurement.
        if finite.size > 1 and finite[-1] != finite[0] and np.mean(np.diff(finite) >= 0.0) >= LEAST_RISING:
            return found
        fallback = fallback or found
    return fallback
