# SPDX-License-Identifier: Apache-2.0
"""Reads the messages of MCAP files, also of files that a killed writer left unfinished."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

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
