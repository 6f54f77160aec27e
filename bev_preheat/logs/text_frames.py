# SPDX-License-Identifier: Apache-2.0
"""CAN frames that are written a line each: candump, SavvyCAN (GVRET), CRTD and python-can's CSV."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, UTC
from pathlib import Path
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table_text import line_blocks
from bev_preheat.files.times import COUNTER, Rounds

if TYPE_CHECKING:
    from bev_preheat.logs.raw_log import Remarks

HEX = '[0-9A-Fa-f]'
BYTES = rf'(?P<data>(?:{HEX}{{1,2}}(?:[\s,]+|$)){{0,64}})'
# Patterns of a line by the name of its format.
LINES = {
    'candump': re.compile(
        rf'\((?P<time>\d{{1,12}}(?:\.\d+)?)\)\s+\S+\s+(?P<id>{HEX}{{3,8}})#(?:#{HEX})?'
        rf'(?:(?P<data>(?:{HEX}{{2}}){{0,64}})|(?P<remote>[Rr]\d?))(?:\s+[RTrt])?'),
    'candump on a screen': re.compile(
        rf'(?:\((?P<time>[0-9:. -]+)\)\s+)?\S+\s+(?:[RT]X [-BE\s]*)?(?P<id>{HEX}{{3}}|{HEX}{{8}})\s+\[\d+\]\s*'
        rf'(?:{BYTES}|(?P<remote>remote request))(?:\'.*\'|ERRORFRAME)?'),
    'SavvyCAN GVRET': re.compile(
        rf'(?P<time>\d{{1,20}}),(?P<id>{HEX}{{1,8}}),(?P<extended>true|false|[01]),(?:[RT]x,)?\d+,\d+,{BYTES}',
        re.IGNORECASE),
    'CRTD': re.compile(rf'(?P<time>\d+(?:\.\d+)?)\s+\d?[RT](?P<extended>11|29)\s+(?P<id>{HEX}{{1,8}})\s*{BYTES}'),
    'python-can CSV': re.compile(
        rf'(?P<time>\d+(?:\.\d+)?),0x(?P<id>{HEX}{{1,8}}),(?P<extended>[01]),(?P<remote>1)?0?,[01],\d+,'
        r'(?P<coded>[A-Za-z0-9+/=]*)')}
# Lines that have no frame, such as a header and the comments of CRTD.
NO_FRAME = re.compile(r'Time Stamp,ID,.*|timestamp,arbitration_id,.*|\d+(\.\d+)?\s+C[A-Z]{2}\b.*', re.IGNORECASE)
# GVRET counts microseconds.
SCALES = {'SavvyCAN GVRET': 1e-6}


@dataclass
class Frame:
    """A CAN frame, with the names of can.Message."""

    timestamp: float
    arbitration_id: int
    data: bytes
    is_extended_id: bool
    is_remote_frame: bool = False
    is_error_frame: bool = False


def text_kind(lines: list[str]) -> str:
    """Return the format of a file by its first lines, '' if they are no frames."""
    lines = [line for line in lines if not NO_FRAME.fullmatch(line)]
    return next((kind for kind, pattern in LINES.items()
                 if sum(bool(pattern.fullmatch(line)) for line in lines) > len(lines) // 2), '')


def text_frames(path: str | Path, kind: str, encoding: str, remarks: Remarks | None) -> Iterator[Frame]:
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


def _frame(path: str | Path, number: int, parts: dict[str, str | None], scale: float) -> Frame:
    time, identifier = parts['time'], parts['id'] or ''
    if time is None:
        raise InvalidInput(f'{path}, line {number}: the frame has no time; record with candump -L')
    extended = parts.get('extended')
    is_extended = len(identifier) > 3 if extended is None else extended.lower() in ('true', '1', '29')
    if parts.get('coded') is not None:
        data = base64.b64decode(parts['coded'] or '', validate=False)
    else:
        data = b''.join(bytes.fromhex(each.zfill(2)) for each in re.findall(f'{HEX}{{1,2}}', parts['data'] or ''))
    return Frame(_seconds(time) * scale, int(identifier, 16), data, is_extended, parts.get('remote') is not None)


def _seconds(text: str) -> float:
    if ':' in text:
        return datetime.fromisoformat(text.strip()).replace(tzinfo=UTC).timestamp()
    return float(text)
