# SPDX-License-Identifier: Apache-2.0
"""Recordings of CAN frames (text: candump, GVRET, CRTD, CSV; ASC, BLF, PCAN TRC), decoded by a DBC."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterator
from contextlib import nullcontext
from functools import partial
from itertools import chain, islice
import logging
from pathlib import Path
import re
from typing import Any, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import figure, InvalidInput, located, quoted
from bev_preheat.files.table import encoding_of, line_blocks, read_head
from bev_preheat.files.times import COUNTER, EARLIEST_S, iso_seconds, LATEST_S, Rounds
from bev_preheat.files.units import unit_named
from bev_preheat.logs.dbc import identifying_bits, J1939_GROUP, last_values, load_dbc, NoReading, part_of, scaled
from bev_preheat.logs.raw_log import Channel, Piece, pieces_of, RawLog, Remarks
from bev_preheat.logs.signal_map import SignalMap
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    import can

HEX = '[0-9A-Fa-f]'
BYTES = rf'(?P<data>(?:{HEX}{{1,2}}(?:[\s,]+|$)){{0,64}})'
# Patterns of a line by the name of its format.
LINES = {
    'candump': re.compile(
        rf'\((?P<time>\d{{1,12}}(?:\.\d+)?)\)\s+(?P<bus>\S+)\s+(?P<id>{HEX}{{3,8}})#(?:#{HEX})?'
        rf'(?:(?P<data>(?:{HEX}{{2}}){{0,64}})|(?P<remote>[Rr]\d?))(?:\s+[RTrt])?'),
    'candump on a screen': re.compile(
        rf'(?:\((?P<time>[0-9:. -]+)\)\s+)?(?P<bus>\S+)\s+(?:[RT]X [-BE\s]*)?(?P<id>{HEX}{{3}}|{HEX}{{8}})\s+'
        r'\[\d+\]\s*'
        rf'(?:{BYTES}|(?P<remote>remote request))(?:\'.*\'|ERRORFRAME)?'),
    'SavvyCAN GVRET': re.compile(
        rf'(?P<time>\d{{1,20}}),(?:0x)?(?P<id>{HEX}{{1,8}}),(?P<extended>true|false|[01]),'
        rf'(?:[RT]x,)?(?P<bus>\d+),\d+,{BYTES}',
        re.IGNORECASE),
    'CRTD': re.compile(
        rf'(?P<time>\d+(?:\.\d+)?)\s+(?P<bus>\d?)[RT](?P<extended>11|29)\s+(?P<id>{HEX}{{1,8}})\s*{BYTES}'),
    'python-can CSV': re.compile(
        rf'(?P<time>\d+(?:\.\d+)?),0x(?P<id>{HEX}{{1,8}}),(?P<extended>[01]),(?P<remote>1)?0?,[01],\d+,'
        r'(?P<coded>[A-Za-z0-9+/=]*)')}
# Lines that have no frame, such as a header and the comments of CRTD.
NO_FRAME = re.compile(r'Time Stamp,ID,.*|timestamp,arbitration_id,.*|\d+(\.\d+)?\s+C[A-Z]{2}\b.*', re.IGNORECASE)
# Headings of other tools: BUSMASTER, Microchip, Kvaser, Vehicle Spy.
OTHER_FRAMES = re.compile(rb'BUSMASTER|CAN BUS Analyzer|\bDLC\b|\bArb(itration)?[ _]?ID\b', re.IGNORECASE)
# GVRET counts microseconds.
SCALES = {'SavvyCAN GVRET': 1e-6}


def text_frames(path: str | Path, kind: str, encoding: str, remarks: Remarks | None) -> Iterator[can.Message]:
    """Yield the frames of a text of a kind; remark on other lines."""
    scale, rounds = SCALES.get(kind, 1.0), Rounds(COUNTER * SCALES[kind]) if kind in SCALES else None
    for first, lines in line_blocks(path, encoding):
        for number, line in enumerate(map(str.strip, lines), start=first):
            match = LINES[kind].fullmatch(line)
            if match:
                frame = _frame(path, number, match.groupdict(), scale)
                if rounds is not None:
                    frame.timestamp = float(rounds.continued(np.array([frame.timestamp]))[0])
                yield frame
            elif line and not NO_FRAME.fullmatch(line) and remarks is not None:
                remarks.add('line', f'{path}, line {number}: {quoted(line)} is no frame; it is dropped',
                            noun='line')


def _frame(path: str | Path, number: int, parts: dict[str, str | None], scale: float) -> can.Message:
    import can
    time, identifier = parts['time'], parts['id'] or ''
    if time is None:
        raise InvalidInput(f'{path}, line {number}: the frame has no time; record with candump -L')
    extended = parts.get('extended')
    is_extended = len(identifier) > 3 if extended is None else extended.lower() in ('true', '1', '29')
    if parts.get('coded') is not None:
        data = base64.b64decode(parts['coded'] or '', validate=False)
    else:
        data = b''.join(bytes.fromhex(each.zfill(2)) for each in re.findall(f'{HEX}{{1,2}}', parts['data'] or ''))
    seconds = iso_seconds(time) if ':' in time else float(time)
    is_remote = parts.get('remote') is not None
    return can.Message(seconds * scale, int(identifier, 16), is_extended, is_remote, channel=parts.get('bus'),
                       data=data)


# Identifiers in a message.
MOST_SHOWN = 5
# A trace of PCAN-View without a version names its columns first.
PCAN = re.compile(r';\s*Message Number|;-+\s*$|;\s*Start time:', re.IGNORECASE)
ASC = re.compile(r'^(date .*|base\s+(hex|dec)\s+timestamps\s+(absolute|relative).*)$',
                 re.MULTILINE | re.IGNORECASE)
# Of BLF: signature, lengths of header and object, type.
OBJECT_HEADER_BYTES = 16
# Frames that show whether times are intervals, and the share of times of a clock that go back.
FRAMES_SHOWING_INTERVALS, MOST_BACK = 50, 0.2


class CanFrames(RawLog):
    """An open recording of CAN frames; see RawLog. A channel is a signal of the DBC: message.signal."""

    place = 'frame'

    def __init__(self, path: str | Path, kind: str, encoding: str, databases: Collection[str | Path]) -> None:
        """Take the DBC files; raises InvalidInput if none is given, or if one cannot be read."""
        require('can', 'cantools')
        files = dbc_files(path, databases)
        if not files:
            raise needs_dbc(path, kind)
        self._path, self.format = path, f'CAN frames ({kind})'
        self._frames = partial(frames_of, path, kind, encoding)
        self._messages = {message.frame_id: message for file in files for message in load_dbc(file).messages}
        signals = {f'{message.name}.{signal.name}': signal
                   for message in self._messages.values() for signal in message.signals}
        self.channels = tuple(Channel(name, unit_named(signal.unit or ''),
                                      tuple(scaled(signal, raw) for raw in last_values(signal)))
                              for name, signal in signals.items())
        self._signals = signals

    def use(self, signal_map: SignalMap) -> None:
        """Tell by the first frame whether the times are those of a clock."""
        first = next(self._frames(None), None)
        self.absolute = first is not None and EARLIEST_S <= float(first.timestamp) <= LATEST_S

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted signals; see RawLog."""
        yield from pieces_of(self._readings(wanted, remarks))

    def _readings(self, wanted: Collection[str], remarks: Remarks) -> Iterator[tuple[str, float, float, int]]:
        names = {identifier: message for identifier, message in self._messages.items()
                 if any(f'{message.name}.{signal.name}' in wanted for signal in message.signals)}
        groups = {identifier & J1939_GROUP: message for identifier, message in names.items()
                  if identifying_bits(identifier, message.is_extended_frame) == J1939_GROUP}
        with located(self._path):
            parts = {message.name: part_of(message, [signal.name for signal in message.signals
                                                     if f'{message.name}.{signal.name}' in wanted])
                     for message in names.values()}
        nothing = {f'{message.name}.{signal.name}': NoReading(message, signal)
                   for message in names.values() for signal in message.signals}
        # The identifier and the bus of the first frame of each message.
        senders: dict[str, tuple[int, Any]] = {}
        number, others = 0, set()
        for number, frame in enumerate(self._frames(remarks), start=1):
            message = names.get(frame.arbitration_id)
            if message is None and frame.is_extended_id:
                message = groups.get(frame.arbitration_id & J1939_GROUP)
            if message is None or frame.is_error_frame or frame.is_remote_frame or not frame.data:
                others.add(frame.arbitration_id)
                continue
            sender = frame.arbitration_id, frame.channel
            if (first := senders.setdefault(message.name, sender)) != sender:
                words = (f'from {sender[0]:X}; those from {first[0]:X} count' if sender[0] != first[0] else
                         'from another bus; those of the first bus count')
                remarks.add(f'sender {message.name}', f'{self._path}, frame {number}: {message.name}: {words}',
                            noun='frame')
                continue
            try:
                values = parts[message.name].decode(bytes(frame.data), decode_choices=False, scaling=False,
                                                    allow_truncated=True)
            except Exception as error:
                # cantools raises errors of several packages for frames that do not fit the DBC.
                remarks.add(f'decode {message.name}', f'{self._path}, frame {number}: {message.name}: does not '
                            f'fit the DBC ({quoted(str(error))}); it is dropped', noun='frame')
                continue
            for signal, raw in values.items():
                name = f'{message.name}.{signal}'
                if name not in wanted or not isinstance(raw, int | float):
                    continue
                value = scaled(self._signals[name], raw)
                if word := nothing[name].word(raw):
                    remarks.add(f'{name} {word}', f'{self._path}, frame {number}: {name}: {figure(value)} means '
                                f'{quoted(word)}; it is dropped')
                else:
                    yield name, float(frame.timestamp), value, number
        if not senders:
            remarks.add('ids', f'{self._path}: none of its {number} frames has an identifier of the DBC '
                        f'({_hex(names)}); they have {_hex(others)}')


def _hex(identifiers: Collection[int]) -> str:
    shown = [f'{each:X}' for each in sorted(identifiers)[:MOST_SHOWN]]
    return ', '.join(shown) + (', …' if len(identifiers) > MOST_SHOWN else '')


def frames_of(path: str | Path, kind: str, encoding: str, remarks: Remarks | None) -> Iterator[Any]:
    """Yield the frames (can.Message) of a recording; remark on damage, which ends a binary file."""
    import can
    # It logs each object that it does not know.
    logging.getLogger('can').setLevel(logging.CRITICAL)
    try:
        reader: Any = nullcontext(text_frames(path, kind, encoding, remarks)) if kind in LINES else (
            can.ASCReader(path, relative_timestamp=False) if kind == 'ASC' else can.TRCReader(path)
            if kind == 'PCAN TRC' else _blf_reader(path))
        with reader as source:
            frames = iter(source)
            # Of damaged binary files the frames before the damage are not looked at ahead.
            head = list(islice(frames, {'candump on a screen': FRAMES_SHOWING_INTERVALS, 'ASC': 1}.get(kind, 0)))
            frames = chain(head, frames)
            if getattr(reader, 'timestamps_format', '') == 'relative':
                frames = _summed(frames, reader.start_time)
            elif _are_intervals(head):
                frames = _summed(frames, 0.0)
            yield from frames
    except (GeneratorExit, InvalidInput):
        raise
    except Exception as error:
        # python-can raises errors of several kinds for damaged files.
        if remarks is not None:
            remarks.add('frames', f'{path}: is damaged ({quoted(str(error))}); the frames before are used')


def _are_intervals(frames: list[Any]) -> bool:
    """Return whether times are those since the frame before, which rise and fall, or stay."""
    steps_s = np.diff([frame.timestamp for frame in frames])
    return len(steps_s) > 1 and bool(np.mean(steps_s < 0.0) > MOST_BACK or not steps_s[1:].any())


def _summed(frames: Iterator[Any], start_s: float) -> Iterator[Any]:
    """Yield frames with times from the start on, instead of those since the frame before."""
    time_s = start_s
    for frame in frames:
        time_s += frame.timestamp - start_s
        frame.timestamp = time_s
        yield frame


def _blf_reader(path: str | Path) -> Any:
    """Return python-can's reader of BLF; it raises at an object shorter than its header, and for a cut file."""
    import can

    class BlfReader(can.BLFReader):
        def __iter__(self) -> Any:
            yield from super().__iter__()
            if (size := Path(path).stat().st_size) < self.file_size:
                raise can.io.blf.BLFParseError(f'has {size} of the {self.file_size} bytes that its head names')

        def _parse_data(self, data: bytes) -> Iterator[Any]:
            sound = _sound_length(data)
            yield from super()._parse_data(data if sound is None else data[:sound])
            if sound is not None:
                raise can.io.blf.BLFParseError('an object is shorter than its header')

    return BlfReader(path)


def _sound_length(data: bytes) -> int | None:
    """Return the length of the BLF objects before an object shorter than its header, None without such."""
    at = 0
    while (at := data.find(b'LOBJ', at, at + 8)) >= 0 and at + OBJECT_HEADER_BYTES <= len(data):
        length = int.from_bytes(data[at + 8:at + 12], 'little')
        if length < OBJECT_HEADER_BYTES:
            return at
        at += length
    return None


def dbc_files(path: str | Path, databases: Collection[str | Path]) -> list[str | Path]:
    """Return the DBC files of a recording: those given, or the one beside it."""
    beside = Path(path).with_suffix('.dbc')
    return list(databases) or ([beside] if beside.is_file() else [])


def needs_dbc(path: str | Path, kind: str) -> InvalidInput:
    """Return the refusal of frames without a DBC."""
    return InvalidInput(f'{path}: CAN frames ({kind}) need a DBC: name it in a signal map (dbc: FILE), or put it '
                        f'beside the log as {Path(path).with_suffix(".dbc").name}')


def open_can_frames(path: str | Path, head: bytes, databases: Collection[str | Path]) -> CanFrames | None:
    """Return the open recording if a file begins as recordings of CAN frames do, else None."""
    kind, encoding = _kind_of(head)
    if not kind and encoding_of(head) and OTHER_FRAMES.search(head[:2000]):
        raise InvalidInput(f'{path}: seems to hold CAN frames in a form that is not read; save them as candump, '
                           'ASC, BLF, PCAN TRC, GVRET or CRTD')
    return CanFrames(path, kind, encoding, databases) if kind else None


def recorded_frames(path: str | Path) -> Iterator[Any]:
    """Yield the frames (can.Message) of a recording, without a DBC; refuse other files."""
    require('can')
    kind, encoding = _kind_of(read_head(path))
    if not kind:
        raise InvalidInput(f'{path}: is no recording of CAN frames; candump, ASC, BLF, PCAN TRC, GVRET and CRTD '
                           'files are')
    return frames_of(path, kind, encoding, None)


def _kind_of(head: bytes) -> tuple[str, str]:
    """Return (kind, encoding) of a recording by its first bytes, ('', '') if it is none."""
    if head[:4] == b'LOGG':
        return 'BLF', ''
    encoding = encoding_of(head)
    if encoding is None:
        return '', ''
    lines = [line.strip() for line in head.decode(encoding, 'replace').splitlines()[:50] if line.strip()]
    frames = [line for line in lines if not NO_FRAME.fullmatch(line)]
    for kind, pattern in LINES.items():
        if sum(bool(pattern.fullmatch(line)) for line in frames) > len(frames) // 2:
            return kind, encoding
    if any(line.startswith(';$FILEVERSION=') or PCAN.match(line) for line in lines[:5]):
        return 'PCAN TRC', encoding
    if ASC.search('\n'.join(lines[:5])) and re.search(r'^base\s', '\n'.join(lines), re.IGNORECASE | re.MULTILINE):
        return 'ASC', encoding
    return '', ''
