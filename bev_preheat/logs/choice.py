# SPDX-License-Identifier: Apache-2.0
"""Chooses the channels of a log that are readings of a signal, and the columns that hold its time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.files.times import Clock, find_clock, TIME_UNITS
from bev_preheat.files.units import is_stated, measures, split_unit
from bev_preheat.logs.signal_map import is_expression, matches, plain, SignalMap, Source

# Words of names that check, qualify, limit or request a reading, and those that do so at the end of a name.
WORDS = re.compile(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]+')
NO_READING = frozenset((
    'alive', 'checksum', 'chksum', 'chk', 'cks', 'cs', 'cnt', 'cntr', 'count', 'counter', 'crc', 'ctr', 'rolling',
    'bz', 'zaehler', 'qbit', 'qf', 'qual', 'quality', 'qualifier', 'valid', 'validity', 'invalid', 'plausible',
    'index', 'idx', 'position', 'pos', 'mux', 'select', 'selector', 'flag', 'fault', 'error', 'err', 'warning',
    'warn', 'alarm', 'alert', 'status', 'timeout', 'limit', 'lim', 'threshold', 'setpoint', 'target', 'soll',
    'request', 'req', 'requested', 'desired', 'goal', 'wanted', 'demand', 'cmd', 'enable', 'mode', 'derating',
    'peak', 'allowed', 'permitted', 'capability', 'cruise', 'tempomat', 'delta', 'diff', 'difference', 'spread',
    'rate', 'gradient', 'unknown'))
NO_READING_AT_END = frozenset(('id', 'no', 'nr', 'num', 'number', 'state', 'sel', 'bit', 'sna', 'active', 'q'))
# Sensors of one kind differ in these words, a number or a letter; not in the number of a car.
# A current or a power in one direction only; a name with a sign means both.
INTO = re.compile(r'regen|re[ck]up|(?<!dis)(?<!dis[ _])charg|(?<!ent)lad(e|ung)')
OUT_OF = re.compile(r'dis[ _]?charg|entlad')
SIGN = re.compile(r'[+=±]|positive?|negative?')
OF_A_KIND = re.compile(r'(?P<car>(car|veh(icle)?|auto)[ _]?\d+|^[^.]*/)|\d+|min(imum|imal)?|max(imum|imal)?|'
                       r'low(est)?|high(est)?|hot(test)?|warm(est)?|cold(est)?|front|rear|'
                       r'left|right|links|rechts|(?<![^\W_])[a-z](?![^\W_])')
MEAN = re.compile(r'mean|av(era)?g|mittel|mittler|durchschn|сред|平均', re.IGNORECASE)


class Candidates(NamedTuple):
    """Groups of channels that may be a signal, the best first; names that match but are no readings."""

    groups: tuple[tuple[str, ...], ...]
    excluded: tuple[str, ...]


def candidates(source: Source, units: Mapping[str, str]) -> Candidates:
    """
    Return the Candidates for a Source among channels, given with their units ('' if unknown).

    A name in a map means just that channel. Of the channels that an expression matches, those with the unit of
    another quantity and those with a name of a counter, check, qualifier or limit are excluded; only temperatures
    of the same kind make up a group, unless the map says how to combine all.
    """
    if source.at_least:
        found = tuple(name for name in units if any(_means(entry, name, units[name], source)
                                                    for entry in source.channels))
        return Candidates((found,) if found else (), ())
    groups: list[tuple[str, ...]] = []
    excluded: dict[str, None] = {}
    for entry in source.channels:
        found = tuple(name for name in units if _means(entry, name, units[name], source))
        if is_expression(entry) or not source.unit:
            wrong = [name for name in found if _is_no_reading(entry, name, units[name], source)]
            excluded.update(dict.fromkeys(wrong))
            found = tuple(name for name in found if name not in wrong)
        groups += [group for group in _grouped(found, units, source) if group not in groups]
    taken = {name for group in groups for name in group}
    return Candidates(tuple(groups), tuple(name for name in excluded if name not in taken))


def all_candidates(signal_map: SignalMap, units: Mapping[str, str]) -> dict[str, Candidates]:
    """Return the Candidates of each signal; a channel named for a signal is not used for an inherited one."""
    found = {signal: candidates(source, units) for signal, source in signal_map.sources.items()}
    own = {name for signal, each in found.items() if signal not in signal_map.inherited
           for group in each.groups for name in group}
    return {signal: each if signal not in signal_map.inherited else each._replace(
        groups=tuple(group for group in each.groups if own.isdisjoint(group))) for signal, each in found.items()}


def _means(entry: str, name: str, unit: str, source: Source) -> bool:
    """Return whether an entry matches a name, also followed by `[unit]`; see `matches` for `touches_last`."""
    if not is_expression(entry) and unit and not is_stated(name, unit) and not measures(unit, source.signal):
        # battery_temp_min is not the battery_temp in minutes.
        return plain(entry) in (plain(name), plain(name.rpartition('.')[2]))
    touches_last = not (is_stated(name, unit) and measures(unit, source.signal))
    return any(matches(entry, each, touches_last) for each in (name, f'{name} [{unit}]'))


def _is_no_reading(entry: str, name: str, unit: str, source: Source) -> bool:
    if not source.unit and is_stated(name, unit) and not measures(unit, source.signal):
        return True
    if not is_expression(entry):
        return False
    last = split_unit(name.rpartition('.')[2]).name
    into, out_of, sign = (each.search(last.lower()) is not None for each in (INTO, OUT_OF, SIGN))
    if source.signal in ('current_a', 'power_w') and into != out_of and not sign:
        return True
    words = [word.lower() for word in WORDS.findall(last)]
    return bool(words) and (not NO_READING.isdisjoint(words) or words[-1] in NO_READING_AT_END)


def _grouped(names: tuple[str, ...], units: Mapping[str, str], source: Source) -> list[tuple[str, ...]]:
    """Return groups of alike channels, the best first: with a unit, a mean, and the shortest name."""
    if source.combine == 'first':
        return [names[:1]] if names else []
    if source.combine:
        return [names] if names else []
    kinds: dict[str, list[str]] = {}
    for name in names:
        kind = name
        if source.signal.endswith('_c'):
            bare = split_unit(name)
            kind = bare.name if bare.unit and measures(bare.unit, source.signal) else name
            kind = OF_A_KIND.sub(lambda match: match['car'] or '#', kind.casefold())
        kinds.setdefault(kind, []).append(name)

    def rank(group: list[str]) -> tuple[bool, bool, int]:
        return (not is_stated(group[0], units[group[0]]), MEAN.search(group[0]) is None, len(group[0]))

    return [tuple(group) for group in sorted(kinds.values(), key=rank)]


# Names of times, the best first.
NAMES = (
    r'^(epoch|unix|posix)', r'^(time_?stamp|utc|date[ _/-]?time|zeitstempel|datum[ _/-]?(uhr)?zeit|ts)\b',
    r'^(device|log|local)[ _]?time', r'^last[ _]?(changed|updated|reported|seen)$',
    r'^(created|recorded|logged|received|fetched|updated)[ _]?(at|on)$', r'^(time|zeit)_', r'^tst$',
    r'^(time|zeit|tiempo|temps|tempo|время|时间|aika|tid|tijd|czas)\b',
    r'^(elapsed|(milli)?seconds|millis|secs?|sekunden|running|relative|uptime|rel)\b', r'gps[ _]?time',
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
        # In rows of a single reading, the time between readings of one channel shows its unit.
        firsts = [next((at for at, cell in enumerate(row) if cell and at != column), 0) for row in rows]
        usual = max(firsts, key=firsts.count, default=0)
        return find_clock([text for text, first in zip(texts(column), firsts) if first == usual], units[column],
                          decimal)

    dates = [at for at, name in enumerate(header) if DATE.match(name.strip())]
    times = [at for at, name in enumerate(header) if DAY_TIME.match(name.strip())]
    ranked = [at for entry in signal_map.time for at, name in enumerate(header) if matches(entry, name)]
    if not ranked and dates and times:
        joined = find_clock([f'{date} {time}' for date, time in zip(texts(dates[0]), texts(times[0]))])
        if joined is not None:
            return TimeColumn((dates[0], times[0]), joined)
    ranked += [at for pattern in NAMES for at, name in enumerate(header)
               if re.search(pattern, split_unit(name.rpartition('.')[2]).name, re.IGNORECASE)
               and not DURATION.search(name)]
    stated = dict(zip(header, units))
    may_be = {header[at]: stated[header[at]] for at in ranked}
    taken = {name for source in signal_map.sources.values() for group in candidates(source, may_be).groups[:1]
             for name in group}
    # A t_env_c is a temperature.
    ranked = [at for at in ranked if header[at] not in taken and (
        not stated[header[at]] or stated[header[at]] in TIME_UNITS)]
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
