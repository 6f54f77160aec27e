# SPDX-License-Identifier: Apache-2.0
"""A log before its signals are decoded: named channels, read piece by piece, and remarks on the reading."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from bev_preheat.logs.signal_map import SignalMap
from bev_preheat.numerics import FloatArray, IntArray

READINGS_AT_ONCE = 200_000


@dataclass
class _Cause:
    first: str
    noun: str
    count: int


class Remarks:
    """Collects the causes of remarks in the order in which they appear."""

    def __init__(self) -> None:
        self._causes: dict[str, _Cause] = {}

    def add(self, cause: str, first: str, count: int = 1, noun: str = 'sample') -> None:
        """Add `count` cases of a cause; `first` is the sentence on the first case, with its place."""
        if cause in self._causes:
            self._causes[cause].count += count
        elif count:
            self._causes[cause] = _Cause(first, noun, count)

    def add_shared(self, cause: str, first: str, count: int, noun: str) -> None:
        """Add cases of a cause that channels share, such as a faulty line; the largest count is kept."""
        if cause in self._causes:
            self._causes[cause].count = max(self._causes[cause].count, count)
        else:
            self.add(cause, first, count, noun)

    def extend(self, other: Remarks) -> None:
        """Add the causes of others."""
        for cause, found in other._causes.items():
            self.add(cause, found.first, found.count, found.noun)

    def sentences(self) -> tuple[str, ...]:
        """Return a sentence for each cause."""
        return tuple(cause.first if cause.count == 1 else
                     f'{cause.first} (and {cause.count - 1} more {cause.noun}{"s" if cause.count > 2 else ""})'
                     for cause in self._causes.values())


@dataclass(frozen=True)
class Channel:
    """A channel of a log, its unit ('': not given), and the values of a raw one with all bits set, if known."""

    name: str
    unit: str = ''
    full: tuple[float, ...] = ()


@dataclass(frozen=True)
class Piece:
    """
    Successive readings of one channel: times [s], values as numbers or texts, and places; N of each.

    Times count from the epoch if the log is `absolute`, else from any instant; NaN where a reading has no time. A
    place is a line number, or the number of a message.
    """

    channel: str
    time_s: FloatArray
    values: FloatArray | Sequence[str]
    places: IntArray


def pieces_of(readings: Iterator[tuple[str, float, float, int]]) -> Iterator[Piece]:
    """Yield the Pieces of single readings (channel, time [s], value, place), in bounded memory."""
    while block := list(islice(readings, READINGS_AT_ONCE)):
        channels: dict[str, list[tuple[float, float, int]]] = {}
        for name, *reading in block:
            channels.setdefault(name, []).append(reading)  # type: ignore[arg-type]
        for name, rows in channels.items():
            yield Piece(name, *(np.array(column) for column in zip(*rows)))


class RawLog:
    """A log file that was opened: its format, its channels, and the pieces of those that are wanted."""

    format: str
    # The word for a place in messages: line, message.
    place: str
    # Decimal mark of values that are texts.
    decimal = '.'
    absolute = True
    channels: tuple[Channel, ...]
    # Names of the channels that hold the time, known after `use`.
    times: tuple[str, ...] = ()

    def use(self, signal_map: SignalMap) -> None:
        """Take the map's choices that concern reading, such as the channel of the time, before `pieces`."""

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels, in bounded memory; remark on what cannot be read."""
        raise NotImplementedError
