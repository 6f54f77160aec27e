# SPDX-License-Identifier: Apache-2.0
"""Measurement files of ASAM MDF (3 and 4), also with CAN frames and a DBC, read in a process of their own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
import logging
import math
import multiprocessing
from pathlib import Path
import re
from typing import Any

import numpy as np

from bev_preheat.errors import figure, InvalidInput, located, quoted
from bev_preheat.files.units import split_unit, unit_named
from bev_preheat.logs.can_frames import dbc_files, needs_dbc
from bev_preheat.logs.dbc import load_dbc, NoReading, part_of
from bev_preheat.logs.raw_log import Channel, Piece, RawLog, Remarks
from bev_preheat.optional_packages import require

# Without a reading in this time [s] the reader has lost its way in the file.
LONGEST_WAIT_S = 60.0
MOST_MEMORY_BYTES = 8 << 30


class ReaderLost(Exception):
    """The reader crashed, or yielded nothing for too long."""


def in_child(reader: Callable[..., Iterator[Any]], *arguments: Any) -> Iterator[Any]:
    """
    Yield the values of a generator function that runs in a process of its own.

    Raises its exceptions; ReaderLost if it crashes or yields nothing for LONGEST_WAIT_S. Where processes cannot be
    forked it runs in this one.
    """
    if 'fork' not in multiprocessing.get_all_start_methods():
        yield from reader(*arguments)
        return
    context = multiprocessing.get_context('fork')
    here, there = context.Pipe(duplex=False)
    child = context.Process(target=_run, args=(there, reader, arguments), daemon=True)
    child.start()
    there.close()
    try:
        while True:
            if not here.poll(LONGEST_WAIT_S):
                raise ReaderLost(f'nothing could be read for {LONGEST_WAIT_S:g} s')
            try:
                kind, value = here.recv()
            except EOFError:
                raise ReaderLost('its reader crashed') from None
            if kind == 'end':
                return
            if kind == 'error':
                raise value
            yield value
    finally:
        here.close()
        child.kill()
        child.join()


def _run(there: Any, reader: Callable[..., Iterator[Any]], arguments: tuple[Any, ...]) -> None:
    with suppress(ImportError, ValueError, OSError):
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, resource.getrlimit(resource.RLIMIT_AS)[1]))
    try:
        for value in reader(*arguments):
            there.send(('value', value))
        there.send(('end', None))
    except Exception as error:
        # Some exceptions of other packages cannot be sent.
        there.send(('error', error if type(error).__module__.startswith(('builtins', 'bev_preheat'))
                    else RuntimeError(str(error) or type(error).__name__)))


# Names of the channels of bus logging.
FRAMES = re.compile(r'^CAN_(Data|Remote|Error)')
MAGIC = (b'MDF     ', b'UnFinMF ')
# Records that are read at once.
RECORDS_AT_ONCE = 200_000


class Mdf(RawLog):
    """An open MDF file; see RawLog."""

    format = 'MDF'
    place = 'record'

    def __init__(self, path: str | Path, databases: Collection[str | Path]) -> None:
        """Read the list of channels; raises InvalidInput if the file is damaged."""
        require('asammdf')
        self._path, self._databases = path, tuple(map(str, dbc_files(path, databases)))
        try:
            start_s, found = next(in_child(_described, path, self._databases))
        except Exception as error:
            # asammdf raises errors of many kinds for damaged files, and crashes on some.
            raise InvalidInput(f'{path}: cannot be read as MDF: '
                               f'{quoted(str(error) or type(error).__name__)}') from error
        self._at: dict[str, tuple[int, int]] = {}
        channels = []
        for group, index, own_name, unit in found:
            name = own_name if own_name not in self._at else f'{own_name} #{group}'
            self._at[name] = (group, index)
            channels.append(Channel(name, unit_named(unit) or split_unit(name).unit))
        if channels and all(FRAMES.search(channel.name) for channel in channels):
            raise needs_dbc(path, 'MDF')
        self.channels = tuple(channels)
        self._messages = [message for file in self._databases for message in load_dbc(file).messages]
        self._start_s = start_s
        self.absolute = start_s > 0.0

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels; each group of channels has its own time."""
        places = {name: self._at[name] for name in wanted}
        nothing = {}
        for message in self._messages:
            with located(self._path):
                part = part_of(message, [signal.name for signal in message.signals if signal.name in places])
            nothing.update({signal.name: (signal, NoReading(message, signal)) for signal in part.signals})
        try:
            for name, first, time_s, values, problem in in_child(_readings, self._path, self._databases, places):
                if problem:
                    remarks.add(f'mdf {name}', f'{self._path}: {name}: cannot be read from record {first} on '
                                f'({quoted(problem)})')
                    continue
                at = first + np.arange(1, len(values) + 1)
                if name in nothing:
                    values = _without_nothing(*nothing[name], values, f'{self._path}, record', at, remarks)
                yield Piece(name, time_s + self._start_s, values, at)
        except ReaderLost as error:
            remarks.add('mdf', f'{self._path}: is damaged ({error}); the records before are used')


def _without_nothing(signal: Any, nothing: NoReading, values: Any, where: str, at: Any, remarks: Remarks) -> Any:
    """Return the numbers of a signal of the DBC, with NaN for those above the highest of J1939."""
    if nothing.highest_raw == math.inf or not isinstance(values, np.ndarray):
        return values
    raws = np.round((values - signal.offset) / signal.scale)
    wrong = raws > nothing.highest_raw
    if wrong.any():
        first = int(np.argmax(wrong))
        remarks.add(f'{signal.name} j1939', f'{where} {at[first]}: {signal.name}: {figure(values[first])} means '
                    f'{quoted(nothing.word(raws[first]))}; it is dropped', int(wrong.sum()))
    return np.where(wrong, np.nan, values)


def _open(path: str | Path, databases: Collection[str]) -> Any:
    import asammdf
    logging.getLogger('asammdf').setLevel(logging.CRITICAL)
    for version in (asammdf.blocks.mdf_v3.MDF3, asammdf.blocks.mdf_v4.MDF4):
        _quieten(version)
    file = asammdf.MDF(path)
    return file.extract_bus_logging({'CAN': [(each, 0) for each in databases]}) if databases else file


def _described(path: str | Path,
               databases: Collection[str]) -> Iterator[tuple[float, list[tuple[int, int, str, str]]]]:
    """Yield the start [s] of a file, and group, index, name and unit of each channel but those of the time."""
    file = _open(path, databases)
    found = []
    for number, group in enumerate(file.groups):
        for index, channel in enumerate(group.channels):
            if file.masters_db.get(number) != index:
                unit = getattr(channel, 'unit', '') or getattr(getattr(channel, 'conversion', None), 'unit', '')
                found.append((number, index, str(channel.name), str(unit or '')))
    yield float(file.header.start_time.timestamp()), found


def _readings(path: str | Path, databases: Collection[str],
              places: dict[str, tuple[int, int]]) -> Iterator[tuple[str, int, Any, Any, str]]:
    """Yield name, number of the first record, times [s] and values of channels; or the problem with them."""
    file = _open(path, databases)
    for name, (group, index) in places.items():
        count = int(file.groups[group].channel_group.cycles_nr)
        for first in range(0, count, RECORDS_AT_ONCE):
            try:
                signal = file.get(group=group, index=index, record_offset=first,
                                  record_count=min(RECORDS_AT_ONCE, count - first), ignore_invalidation_bits=False)
                values, time_s = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=float)
            except Exception as error:
                yield name, first, None, None, str(error) or type(error).__name__
                break
            if values.ndim != 1:
                break
            yield name, first, time_s, (values.astype(float) if values.dtype.kind in 'biuf' else
                                        [_text(value) for value in values]), ''


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
