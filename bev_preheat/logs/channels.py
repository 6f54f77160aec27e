# SPDX-License-Identifier: Apache-2.0
"""A log before its signals are decoded: named channels, read piece by piece."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap
    from bev_preheat.numerics.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Channel:
    """
    A channel (column, PID, CAN signal, field of a topic) and its unit ('' if not given).

    `full` has the value of a raw one with all bits set, if the log tells how it is coded.
    """

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


class RawLog(Protocol):
    """A log file that was opened: its format, its channels, and the pieces of those that are wanted."""

    format: str
    # The word for a place in messages: line, message.
    place: str
    # Decimal mark of values that are texts.
    decimal: str
    absolute: bool
    channels: tuple[Channel, ...]
    # Names of the channels that hold the time, known after `use`.
    times: tuple[str, ...]

    def use(self, signal_map: SignalMap) -> None:
        """Take the map's choices that concern reading, such as the channel of the time, before `pieces`."""

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels, in bounded memory; remark on what cannot be read."""
