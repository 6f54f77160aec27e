# SPDX-License-Identifier: Apache-2.0
"""Recordings of CAN frames (candump, ASC, BLF), decoded by a DBC."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import closing
import logging
from pathlib import Path
import re
from typing import Any, cast, TextIO, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import check_input
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.logs.text_lines import encoding_of, line_blocks, read_head
from bev_preheat.logs.times import EARLIEST_S, LATEST_S
from bev_preheat.logs.units import pint_unit
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap

CANDUMP = re.compile(r'\(\d{1,12}(?:\.\d+)?\)\s+\S+\s+[0-9A-Fa-f]{3,8}#(?:#[0-9A-Fa-f])?'
                     r'(?:(?:[0-9A-Fa-f]{2}){0,64}|[Rr]\d?)(?:\s+[RTrt])?')
ASC = re.compile(r'^(date .*|base\s+(hex|dec)\s+timestamps\s+(absolute|relative).*)$',
                 re.MULTILINE | re.IGNORECASE)
BATCH = 20_000


class CanFrames:
    """An open recording of CAN frames; see RawLog. A channel is a signal of the DBC: message.signal."""

    place = 'frame'
    decimal = '.'

    def __init__(self, path: str | Path, kind: str, encoding: str, databases: Collection[str | Path]) -> None:
        """Take the DBC files; raises InvalidInput if none is given, or if one cannot be read."""
        require('can', 'cantools')
        self._path, self._kind, self._encoding = path, kind, encoding
        self.format = f'CAN frames ({kind})'
        self.absolute = True
        self._messages = _messages(path, kind, databases)
        self.channels = tuple(
            Channel(f'{message.name}.{signal.name}', pint_unit(signal.unit or ''))
            for message in self._messages.values() for signal in message.signals)

    def use(self, signal_map: SignalMap) -> None:
        """Tell by the first frame whether the times are those of a clock."""
        first = next(self._frames(None), None)
        self.absolute = first is not None and EARLIEST_S <= float(first.timestamp) <= LATEST_S

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted signals; see RawLog."""
        names = {identifier: message for identifier, message in self._messages.items()
                 if any(f'{message.name}.{signal.name}' in wanted for signal in message.signals)}
        readings: dict[str, list[tuple[float, float, int]]] = {}
        for number, frame in enumerate(self._frames(remarks), start=1):
            message = names.get(frame.arbitration_id)
            if message is None or frame.is_error_frame or frame.is_remote_frame or not frame.data:
                continue
            try:
                values = message.decode(bytes(frame.data), decode_choices=False, allow_truncated=True)
            except Exception as error:
                # cantools raises errors of several packages for frames that do not fit the DBC.
                remarks.add(f'decode {message.name}', f'{self._path}, frame {number}: {message.name}: does not '
                                                      'fit the '
                            f'DBC ({quoted(str(error))}); it is dropped', noun='frame')
                continue
            for signal, value in values.items():
                name = f'{message.name}.{signal}'
                if name in wanted and isinstance(value, int | float):
                    readings.setdefault(name, []).append((float(frame.timestamp), float(value), number))
            if number % BATCH == 0:
                yield from _pieces(readings)
                readings = {}
        yield from _pieces(readings)

    def _frames(self, remarks: Remarks | None) -> Iterator[Any]:
        return frames_of(self._path, self._kind, self._encoding, remarks)


def frames_of(path: str | Path, kind: str, encoding: str, remarks: Remarks | None) -> Iterator[Any]:
    """Yield the frames (can.Message) of a recording; remark on a damaged one, which ends an ASC or BLF file."""
    import can
    # It logs each object that it does not know.
    logging.getLogger('can').setLevel(logging.CRITICAL)
    try:
        if kind == 'candump':
            yield from can.CanutilsLogReader(cast(TextIO, _Lines(_sound_lines(path, encoding, remarks))))
            return
        reader = (can.ASCReader(path, relative_timestamp=False) if kind == 'ASC' else can.BLFReader(path))
        with closing(_Stopping(reader)):
            yield from reader
    except GeneratorExit:
        raise
    except Exception as error:
        # python-can raises errors of several kinds for damaged files.
        if remarks is not None:
            remarks.add('frames', f'{path}: is damaged ({quoted(str(error))}); the frames before are used')


def _sound_lines(path: str | Path, encoding: str, remarks: Remarks | None) -> Iterator[str]:
    for first, lines in line_blocks(path, encoding):
        for number, line in enumerate(lines, start=first):
            if CANDUMP.fullmatch(line.strip()):
                yield line
            elif line.strip() and remarks is not None:
                remarks.add('line', f'{path}, line {number}: {quoted(line.strip())} is no frame; it is dropped',
                            noun='line')


class _Lines:
    """Sound lines in the shape of a file, for python-can."""

    def __init__(self, lines: Iterator[str]) -> None:
        self._lines = lines

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def read(self, size: int = -1) -> str:
        return ''

    def close(self) -> None:
        """Leave the file to the iterator that reads it."""


class _Stopping:
    """Closes a reader of python-can, whose method is called stop."""

    def __init__(self, reader: Any) -> None:
        self.close = reader.stop


def _pieces(readings: dict[str, list[tuple[float, float, int]]]) -> Iterator[Piece]:
    for name, rows in readings.items():
        time_s, values, places = (np.array(column) for column in zip(*rows))
        yield Piece(name, time_s, values, places)


def _messages(path: str | Path, kind: str, databases: Collection[str | Path]) -> dict[int, Any]:
    """Return the messages of DBC files by their identifiers."""
    beside = Path(path).with_suffix('.dbc')
    files = list(databases) or ([beside] if beside.is_file() else [])
    if not files:
        raise InvalidInput(f'{path}: CAN frames ({kind}) need a DBC: name it in a signal map (dbc: FILE), or '
                           'put it '
                           f'beside the log as {beside.name}')
    return {message.frame_id: message for file in files for message in load_dbc(file).messages}


def load_dbc(file: str | Path) -> Any:
    """Return the cantools Database of a DBC file; raises InvalidInput if it cannot be read."""
    require('cantools')
    import cantools
    check_input(file)
    try:
        return cantools.database.load_file(str(file), strict=False)
    except Exception as error:
        # cantools raises errors of its parser, of files and of encodings.
        raise InvalidInput(f'{file}: cannot be read as a DBC: {quoted(" ".join(str(error).split()))}') from error


def open_can_frames(path: str | Path, head: bytes, databases: Collection[str | Path]) -> CanFrames | None:
    """Return the open recording if a file begins as candump, ASC or BLF do, else None."""
    kind, encoding = _kind_of(head)
    return CanFrames(path, kind, encoding, databases) if kind else None


def recorded_frames(path: str | Path) -> Iterator[Any]:
    """
    Yield the frames (can.Message) of a candump, ASC or BLF file, without a DBC.

    Raises InvalidInput if the file cannot be read or is none of these.
    """
    require('can')
    kind, encoding = _kind_of(read_head(path))
    if not kind:
        raise InvalidInput(f'{path}: is no recording of CAN frames; candump, ASC and BLF files are')
    return frames_of(path, kind, encoding, None)


def _kind_of(head: bytes) -> tuple[str, str]:
    """Return (kind, encoding) of a recording by its first bytes, ('', '') if it is none."""
    if head[:4] == b'LOGG':
        return 'BLF', ''
    encoding = encoding_of(head)
    if encoding is None:
        return '', ''
    lines = [line.strip() for line in head.decode(encoding, 'replace').splitlines()[:50] if line.strip()]
    if sum(bool(CANDUMP.fullmatch(line)) for line in lines) > len(lines) // 2:
        return 'candump', encoding
    if ASC.search('\n'.join(lines[:5])) and re.search(r'^base\s', '\n'.join(lines), re.IGNORECASE | re.MULTILINE):
        return 'ASC', encoding
    return '', ''
