# SPDX-License-Identifier: Apache-2.0
"""Chooses the channels of a log that are readings of a signal; only alike channels are combined."""

from __future__ import annotations

from collections.abc import Mapping
import re
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.files.units import is_stated, measures, split_unit
from bev_preheat.logs.signal_map import is_expression, matches, plain

if TYPE_CHECKING:
    from bev_preheat.logs.signal_map import SignalMap, Source

# Words of names that check, qualify, limit or request a reading, and those that do so at the end of a name.
WORDS = re.compile(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\W\d_]+')
NO_READING = frozenset((
    'alive', 'checksum', 'chk', 'cks', 'cnt', 'cntr', 'count', 'counter', 'crc', 'ctr', 'rolling', 'bz', 'zaehler',
    'qbit', 'qf', 'qual', 'quality', 'qualifier', 'valid', 'validity', 'invalid', 'plausible', 'index', 'idx',
    'mux', 'select', 'selector', 'flag', 'fault', 'error', 'err', 'warning', 'warn', 'alarm', 'status', 'timeout',
    'limit', 'lim', 'threshold', 'setpoint', 'target', 'soll', 'request', 'req', 'cmd', 'enable', 'mode',
    'derating'))
NO_READING_AT_END = frozenset(('id', 'no', 'nr', 'num', 'number', 'state', 'sel', 'bit', 'sna', 'active'))
# Sensors of one kind differ in these words, a number or a letter; not in the number of a car.
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
    """
    Return the Candidates of each signal of a map among channels, as `candidates`.

    A channel that a map names for a signal is not also used for an inherited signal.
    """
    found = {signal: candidates(source, units) for signal, source in signal_map.sources.items()}
    own = {name for signal, each in found.items() if signal not in signal_map.inherited
           for group in each.groups for name in group}
    return {signal: each if signal not in signal_map.inherited else each._replace(
        groups=tuple(group for group in each.groups if own.isdisjoint(group))) for signal, each in found.items()}


def _means(entry: str, name: str, unit: str, source: Source) -> bool:
    """Return whether an entry matches a name, not that of its message alone unless the unit fits the signal."""
    if not is_expression(entry) and unit and not is_stated(name, unit) and not measures(unit, source.signal):
        # battery_temp_min is not the battery_temp in minutes.
        return plain(entry) in (plain(name), plain(name.rpartition('.')[2]))
    return matches(entry, name, not (is_stated(name, unit) and measures(unit, source.signal)))


def _is_no_reading(entry: str, name: str, unit: str, source: Source) -> bool:
    if not source.unit and is_stated(name, unit) and not measures(unit, source.signal):
        return True
    if not is_expression(entry):
        return False
    words = [word.lower() for word in WORDS.findall(split_unit(name.rpartition('.')[2]).name)]
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
