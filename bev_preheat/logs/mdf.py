# SPDX-License-Identifier: Apache-2.0
"""Measurement files of ASAM MDF (version 3 and 4), also with CAN frames and a DBC."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
import logging
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.logs.units import pint_unit, split_unit
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap

MAGIC = (b'MDF     ', b'UnFinMF ')
# Records that are read at once.
BATCH = 200_000


class Mdf:
    """An open MDF file; see RawLog."""

    format = 'MDF'
    place = 'record'
    times: tuple[str, ...] = ()
    decimal = '.'

    def __init__(self, path: str | Path, databases: Collection[str | Path]) -> None:
        """Read the list of channels; raises InvalidInput if the file is damaged."""
        require('asammdf')
        import asammdf
        logging.getLogger('asammdf').setLevel(logging.CRITICAL)
        for version in (asammdf.blocks.mdf_v3.MDF3, asammdf.blocks.mdf_v4.MDF4):
            _quieten(version)
        self._path = path
        try:
            file: Any = asammdf.MDF(path)
            if databases:
                file = file.extract_bus_logging({'CAN': [(str(each), 0) for each in databases]})
            self._file = file
            self._start_s = float(file.header.start_time.timestamp())
            self._at: dict[str, tuple[int, int]] = {}
            channels = []
            for number, group in enumerate(file.groups):
                for index, channel in enumerate(group.channels):
                    # The time's own channel.
                    if file.masters_db.get(number) == index:
                        continue
                    name = channel.name if channel.name not in self._at else f'{channel.name} #{number}'
                    self._at[name] = (number, index)
                    unit = getattr(channel, 'unit', '') or getattr(
                        getattr(channel, 'conversion', None), 'unit', '')
                    channels.append(Channel(name, pint_unit(unit or '') or split_unit(name).unit))
        except Exception as error:
            # asammdf raises errors of many kinds for damaged files.
            raise InvalidInput(f'{path}: cannot be read as MDF: '
                               f'{quoted(str(error) or type(error).__name__)}') from error
        self.channels = tuple(channels)
        self.absolute = self._start_s > 0.0

    def use(self, signal_map: SignalMap) -> None:
        """Do nothing: each group of channels has its own time."""

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels; see RawLog."""
        for name in wanted:
            group, index = self._at[name]
            count = int(self._file.groups[group].channel_group.cycles_nr)
            for first in range(0, count, BATCH):
                try:
                    signal = self._file.get(group=group, index=index, record_offset=first,
                                            record_count=min(BATCH, count - first), ignore_invalidation_bits=False)
                    values, time_s = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=float)
                except Exception as error:
                    remarks.add(f'mdf {name}', f'{self._path}: {name}: cannot be read from record {first} on '
                                f'({quoted(str(error) or type(error).__name__)})')
                    break
                if values.ndim != 1 or values.dtype.kind not in 'biuf':
                    if values.ndim != 1:
                        break
                    yield Piece(name, time_s + self._start_s, [_text(value) for value in values],
                                first + np.arange(1, len(values) + 1))
                else:
                    yield Piece(name, time_s + self._start_s, values.astype(float),
                                first + np.arange(1, len(values) + 1))


def _quieten(version: Any) -> None:
    """Silence the destructor of an asammdf class, which prints a traceback for a file that could not be opened."""
    destroy = version.__del__
    if getattr(destroy, 'is_quiet', False):
        return

    def quiet(self: Any) -> None:
        with suppress(Exception):
            destroy(self)

    quiet.is_quiet = True  # type: ignore[attr-defined]
    version.__del__ = quiet


def _text(value: Any) -> str:
    return value.decode('utf-8', 'replace').strip('\0 ') if isinstance(value, bytes) else str(value)


def open_mdf(path: str | Path, head: bytes, databases: Collection[str | Path]) -> Mdf | None:
    """Return the open file if it begins as MDF does, else None."""
    return Mdf(path, databases) if head[:8] in MAGIC else None
