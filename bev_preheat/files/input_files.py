# SPDX-License-Identifier: Apache-2.0
"""Reads text and MCAP files, and refuses all that is no regular file: a pipe blocks, a device never ends."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

AnyPath = str | os.PathLike[str]
LARGEST_TEXT = 64_000_000


def check_input(path: AnyPath) -> None:
    """Raise InvalidInput unless a path is a regular file or a link to one; `~` is the home folder."""
    file = os.path.expanduser(path)
    # pathlib's is_file() raises if a name is too long or a folder is not accessible.
    if not os.path.isfile(file):
        raise InvalidInput(f'{path}: ' + (
            'is a folder; a file is needed' if os.path.isdir(file) else
            'is not a regular file' if os.path.exists(file) else 'no such file'))


def read_text(path: AnyPath, encoding: str = 'utf-8') -> str:
    """Return a file's text; raise InvalidInput if it cannot be read, is no UTF-8 or has more than 64 MB."""
    check_input(path)
    try:
        with open(os.path.expanduser(path), encoding=encoding) as file:
            text = file.read(LARGEST_TEXT + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'is not UTF-8 text'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
    if len(text) > LARGEST_TEXT:
        raise InvalidInput(f'{path}: is larger than {LARGEST_TEXT / 1e6:.0f} MB')
    return text


# A damaged length must not make the reader ask for all memory.
LARGEST_RECORD_BYTES = 100_000_000


def mcap_messages(path: Path, note: Callable[[str], object]) -> Iterator[tuple[str, str, int, bytes, bytes]]:
    """
    Yield channel, type, instant [ns], bytes and the type's definition of each message as written.

    A damaged record ends it, and is noted. Raises InvalidInput if the file cannot be read, and MissingPackage
    without the package mcap.
    """
    require('mcap')
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader
    channels: dict[int, Channel] = {}
    schemas: dict[int, Schema] = {}
    try:
        with open(path, 'rb') as file:
            for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    channel = channels[record.channel_id]
                    schema = schemas.get(channel.schema_id)
                    name, text = ('', b'') if schema is None else (schema.name, schema.data)
                    yield channel.topic, name, record.log_time, record.data, text
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error
    except Exception as error:
        # Damaged bytes raise errors of many kinds, also of the libraries that decompress chunks.
        note(f'ends in the middle ({type(error).__name__})')
