# SPDX-License-Identifier: Apache-2.0
"""Lines of a text file in blocks of bounded size, whatever its encoding and line ends."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path
import re

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import check_input

HEAD_BYTES = 1 << 18
BLOCK_CHARACTERS = 1 << 20
# No logger writes a longer line.
LONGEST_LINE = 1 << 22
# Characters that no text has.
NOT_TEXT = frozenset('\0\x01\x02\x03\x04\x05\x06\x07\x08\x0e\x0f')


def read_head(path: str | Path) -> bytes:
    """Return the first bytes of a file; raise InvalidInput if it cannot be read or is empty."""
    try:
        check_input(path)
        with open(path, 'rb') as file:
            head = file.read(HEAD_BYTES)
    except (OSError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f'{path}: cannot be read: {getattr(error, "strerror", None) or error}') from error
    if not head.strip():
        raise InvalidInput(f'{path}: is empty')
    return head


def encoding_of(head: bytes) -> str | None:
    """Return the encoding of a text by its first bytes, None if they are no text."""
    if head[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return 'utf-16'
    try:
        # The end may cut a character.
        text = codecs.getincrementaldecoder('utf-8-sig')().decode(head, final=len(head) < HEAD_BYTES)
        encoding = 'utf-8-sig'
    except UnicodeDecodeError:
        text, encoding = head.decode('cp1252', 'replace'), 'cp1252'
    odd = sum(character in NOT_TEXT for character in text)
    return None if odd > 0.001 * len(text) else encoding


def first_lines(head: bytes, encoding: str) -> list[str]:
    """Return the lines in the first bytes of a text; the last one may be cut."""
    return re.split('\r\n|[\r\n]', head.decode(encoding, 'replace'))


def line_blocks(path: str | Path, encoding: str) -> Iterator[tuple[int, list[str]]]:
    """
    Yield blocks of lines, without their ends, with the number of the first line.

    Raises InvalidInput on a line of more than LONGEST_LINE characters.
    """
    number, rest = 1, ''
    try:
        with open(path, encoding=encoding, errors='replace', newline=None) as file:
            while True:
                text = file.read(BLOCK_CHARACTERS)
                lines = (rest + text).split('\n')
                rest = lines.pop() if text else ''
                if len(rest) > LONGEST_LINE:
                    raise InvalidInput(f'{path}, line {number + len(lines)}: has more than {LONGEST_LINE} '
                                       'characters; this is no log of lines')
                if lines:
                    yield number, lines
                number += len(lines)
                if not text:
                    return
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or f'is not text ({encoding})'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
