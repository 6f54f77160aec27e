# SPDX-License-Identifier: Apache-2.0
"""
The latest reading of each live channel, in the signal's own unit, with its instant and the latest doubt.

Instants are on a steady clock: steps of the system's clock change no age.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from threading import Lock
import time
from typing import TYPE_CHECKING

from bev_preheat.bus.live_map import CELLS
from bev_preheat.errors import figure, InvalidInput
from bev_preheat.files.units import check_unit, conversion, own_unit
from bev_preheat.logs.choice import candidates

if TYPE_CHECKING:
    from bev_preheat.logs.signal_map import Source

# A stamp this far from the system's clock is another clock's: some adapters count from their own start [s].
FAR_S = 3600.0
# The latest doubt about a channel is shown for this time [s].
DOUBT_SHOWN_S = 10.0


def steady_s() -> float:
    """Return the seconds since the computer started, including those in which it slept."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def age_of_stamp(stamp_s: float | None, wall_s: float | None = None) -> float:
    """
    Return the age [s] of something stamped by the system's clock [s since the epoch], at least 0.

    A stamp that is not of this clock, or none, has the age 0.
    """
    if stamp_s is None or not stamp_s:
        return 0.0
    age_s = (time.time() if wall_s is None else wall_s) - stamp_s
    return age_s if 0.0 <= age_s <= FAR_S else 0.0


@dataclass(frozen=True)
class Reading:
    """A value, and the instant [s] at which it was known to hold."""

    value: float
    instant_s: float


class LiveChannel:
    """One channel as one signal: validity, scale, sign, unit."""

    def __init__(self, name: str, source: Source, channel_unit: str) -> None:
        """
        Take the unit in which the bus has the channel ('' if it names none).

        Raises InvalidInput if neither map nor bus names a unit, or if the bus's unit measures another quantity.
        """
        self.name = name
        self._source = source
        unit = source.unit or channel_unit
        if not unit:
            raise InvalidInput(f'{name} has no unit; name it in the signal map (unit: ...)')
        try:
            check_unit(unit, source.signal)
        except InvalidInput as error:
            raise InvalidInput([f'{name}: {problem}' for problem in error.problems]) from error
        self._conversion = conversion(unit, own_unit(source.signal))

    def read(self, number: float) -> float:
        """Return a reading in the signal's own unit; raises InvalidInput if it means none or is implausible."""
        source = self._source
        if not math.isfinite(number):
            raise InvalidInput(f'{self.name}: {number} is no reading')
        if any(abs(number - nothing) <= 1e-9 * max(abs(nothing), 1.0) for nothing in source.no_reading):
            raise InvalidInput(f'{self.name}: {figure(number)} means no reading')
        own: float = source.in_own_unit(number, source.scales[0], self._conversion)
        low, high = source.plausible
        if not low <= own <= high:
            raise InvalidInput(f'{self.name}: {figure(own)} {own_unit(source.signal)} is implausible; '
                               f'{figure(low)} ... {figure(high)} is allowed')
        return own


class Readings:
    """
    The latest valid reading and the latest doubt of each (signal, channel); safe for several threads.

    Instants are seconds of one clock, that of the caller.
    """

    def __init__(self) -> None:
        """Start without any."""
        self._lock = Lock()
        self._latest: dict[tuple[str, str], Reading] = {}
        self._doubts: dict[str, tuple[float, str]] = {}

    def put(self, signal: str, channel: str, value: float, instant_s: float) -> None:
        """Record a valid reading."""
        with self._lock:
            self._latest[signal, channel] = Reading(value, instant_s)

    def drop(self, signal: str, channel: str) -> None:
        """Drop the reading of a channel, because it no longer holds."""
        with self._lock:
            self._latest.pop((signal, channel), None)

    def doubt(self, cause: str, sentence: str, instant_s: float) -> None:
        """Record that something of `cause` (a channel, a message) was dropped, and why."""
        with self._lock:
            self._doubts[cause] = (instant_s, sentence)

    def latest(self, signal: str, channel: str) -> Reading | None:
        """Return the latest valid Reading; None before the first."""
        with self._lock:
            return self._latest.get((signal, channel))

    def doubts(self, now_s: float) -> dict[str, str]:
        """Return the sentences on doubts of the last DOUBT_SHOWN_S, by cause."""
        with self._lock:
            return {cause: sentence for cause, (instant_s, sentence) in self._doubts.items()
                    if 0.0 <= now_s - instant_s <= DOUBT_SHOWN_S}

    def forget(self) -> None:
        """Drop all readings, because their instants no longer count (a clock that fell back)."""
        with self._lock:
            self._latest.clear()
            self._doubts.clear()


def live_channels(sources: Mapping[str, Source], units: Mapping[str, str],
                  where: str) -> dict[str, tuple[tuple[LiveChannel, ...], ...]]:
    """
    Return the channels of each signal among those of a bus: a tuple for each entry of its Source that has any.

    `units` maps the bus's channels to their units ('' if unknown). Raises InvalidInput for channels
    without a unit; `where` names the map.
    """
    found, problems = {}, []
    for signal, source in sources.items():
        groups, key = [], f'{where}: live.{signal}' if signal == CELLS else f'{where}: signals.{signal}'
        for names in _groups(source, units):
            try:
                groups.append(tuple(LiveChannel(name, source, units[name]) for name in names))
            except InvalidInput as error:
                problems += [f'{key}: {problem}' for problem in error.problems]
            if len(names) < source.at_least:
                problems.append(f'{key}.at_least: {source.at_least} channels are needed, but the bus has only '
                                f'{", ".join(names)}')
        found[signal] = tuple(groups)
    if problems:
        raise InvalidInput(problems)
    return found


def _groups(source: Source, units: Mapping[str, str]) -> list[tuple[str, ...]]:
    """Return the channels of each entry that matches any, in the map's order of preference."""
    parts = [source] if source.at_least else [source.only(entry) for entry in source.channels]
    found = [candidates(part, units) for part in parts]
    # Of an entry that means nothing but wrong channels, the error names them.
    return [group for each in found for group in each.groups[:1] or filter(None, [each.excluded])]
