# SPDX-License-Identifier: Apache-2.0
"""Reads a planner's entries of /diagnostics: regime, signals in doubt, preheating on or off, next departure."""

from __future__ import annotations

from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.control.sensitivity_watch import SENSITIVITY
from bev_preheat.errors import shortened

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from bev_preheat.monitoring.seen import EntrySeen

IN_DOUBT = ' in doubt since [s]'
SHARE = 'share of the command [1]'
LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
# Messages come from any publisher; they must not fill the page.
LONGEST_TEXT, MOST_ENTRIES, MOST_DOUBTS = 600, 24, 12


class Departure(NamedTuple):
    """The next departure in words ('' for none), the state of its preparation, and the skipped departures."""

    next_words: str
    state: str
    skipped: str


class Diagnosis(NamedTuple):
    """
    The planner's entries as the page shows them.

    `is_enabled` is None if it is unknown, `goal` the goal of prepare_battery in words, '' for none; `departure` is
    None without departures. `heater_share` (0 ... 1) is the share of the command that the heater delivers by
    the planner's estimate. `sensitivity` is that of the plan, in words.
    """

    entries: tuple[EntrySeen, ...] = ()
    regime: str = ''
    doubts: tuple[str, ...] = ()
    is_enabled: bool | None = None
    goal: str = ''
    departure: Departure | None = None
    heater_share: float = 1.0
    sensitivity: str = ''

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for the page."""
        return {
            'entries': [[entry.name, LEVELS[min(max(entry.level, 0), 3)], shortened(entry.message, LONGEST_TEXT)]
                        for entry in self.entries],
            'regime': self.regime, 'doubts': list(self.doubts), 'enabled': self.is_enabled, 'goal': self.goal,
            'sensitivity': self.sensitivity,
            'departure': None if self.departure is None else self.departure._asdict()}


def diagnose(entries: Iterable[EntrySeen]) -> Diagnosis:
    """Return the Diagnosis of a planner's entries."""
    by_name: dict[str, EntrySeen] = {}
    for entry in entries:
        if len(by_name) < MOST_ENTRIES:
            by_name[entry.name] = entry
    signals, preheating, departures, heater = (
        _values(by_name, name) for name in ('signals', 'preheating', 'departures', 'heater'))
    doubts = tuple(shortened(key.removesuffix(IN_DOUBT), 60) for key in signals if key.endswith(IN_DOUBT))
    departure = None
    if 'departures' in by_name:
        departure = Departure(*(shortened(departures.get(key, ''), LONGEST_TEXT)
                                for key in ('next departure', 'state', 'skipped')))
    return Diagnosis(
        tuple(by_name[name] for name in sorted(by_name)), shortened(signals.get('regime', ''), 60),
        doubts[:MOST_DOUBTS], {'true': True, 'false': False}.get(preheating.get('enabled', '')),
        shortened(preheating.get('goal of prepare_battery', ''), LONGEST_TEXT), departure,
        _share(heater.get(SHARE, '')), shortened(preheating.get(SENSITIVITY, ''), LONGEST_TEXT))


def _share(text: str) -> float:
    """Return a share as a number; 1 if the text has no number."""
    try:
        share = float(text)
    except ValueError:
        return 1.0
    return share if 0.0 <= share <= 1.0 else 1.0


def _values(entries: Mapping[str, EntrySeen], name: str) -> Mapping[str, str]:
    return entries[name].values if name in entries else {}
