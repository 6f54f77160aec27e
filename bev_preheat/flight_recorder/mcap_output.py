# SPDX-License-Identifier: Apache-2.0
"""
Writes MCAP files: records by the package mcap, except for those that come with every step.

Its own `Writer.add_message` takes three times as much time as the bytes alone. Without chunks each message
stands alone, so that a file without an end can be read up to its last whole message.
"""

from __future__ import annotations

from contextlib import suppress
from struct import Struct
from typing import TYPE_CHECKING
import zlib

if TYPE_CHECKING:
    from collections.abc import Iterable
    from io import RawIOBase

    from mcap.records import Channel, McapRecord, MetadataIndex, Schema

MAGIC = b'\x89MCAP0\r\n'
# Opcode, length of the rest, channel, sequence, log time and publish time [ns], then the data.
MESSAGE = Struct('<BQHIQQ')
MESSAGE_OPCODE, MESSAGE_HEAD_BYTES = 0x05, 22
FOOTER = Struct('<BQQQ')
FOOTER_OPCODE, FOOTER_BYTES = 0x02, 20


class McapOutput:
    """
    An MCAP file that is being written, without chunks.

    Messages and channels are collected until `put_down`, metadata are written at once. An OSError of the file
    passes through, and none of the bytes that were to be written then stays in the file.
    """

    def __init__(self, file: RawIOBase, library: str) -> None:
        """Write the beginning of an open, empty file, which must not be buffered."""
        from mcap.records import Header
        self._file = file
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._collected: list[bytes] = []
        self._written = self._sequence = 0
        self._first_ns = self._last_ns = 0
        self._write(MAGIC + _bytes_of(Header(profile='ros2', library=library)))

    @property
    def size(self) -> int:
        """The number of bytes written."""
        return self._written

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write names with values."""
        from mcap.records import Metadata, MetadataIndex
        data = _bytes_of(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=self._written, length=len(data), name=name))
        self._write(data)

    def add_channel(self, topic: str, message_encoding: str, type_name: str, schema_encoding: str,
                    definition: bytes) -> int:
        """Collect a channel with the definition of its type; return its number."""
        from mcap.records import Channel, Schema
        number = len(self._channels) + 1
        self._schemas.append(Schema(id=number, name=type_name, encoding=schema_encoding, data=definition))
        self._channels.append(Channel(id=number, topic=topic, message_encoding=message_encoding, metadata={},
                                      schema_id=number))
        self._counts[number] = 0
        self._collected.append(_bytes_of(self._schemas[-1], self._channels[-1]))
        return number

    def add(self, channel: int, now_ns: int, data: bytes) -> None:
        """Collect a message of an instant [ns]."""
        self._sequence += 1
        self._counts[channel] += 1
        if self._sequence == 1 or now_ns < self._first_ns:
            self._first_ns = now_ns
        self._last_ns = max(self._last_ns, now_ns)
        self._collected.append(MESSAGE.pack(
            MESSAGE_OPCODE, MESSAGE_HEAD_BYTES + len(data), channel, self._sequence, now_ns, now_ns))
        self._collected.append(data)

    def put_down(self) -> None:
        """Write the collected messages."""
        collected, self._collected = self._collected, []
        self._write(b''.join(collected))

    def finish(self) -> None:
        """Write the end: all schemas and channels again, and the number of messages."""
        from mcap.opcode import Opcode
        from mcap.records import DataEnd, Statistics, SummaryOffset
        self.put_down()
        self._write(_bytes_of(DataEnd(data_section_crc=0)))
        begin, summary, offsets = self._written, b'', []
        statistics = Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=self._counts,
            chunk_count=0, message_count=self._sequence, message_end_time=self._last_ns,
            message_start_time=self._first_ns, metadata_count=len(self._metadata),
            schema_count=len(self._schemas))
        groups: tuple[tuple[Opcode, Iterable[McapRecord]], ...] = (
            (Opcode.SCHEMA, self._schemas), (Opcode.CHANNEL, self._channels), (Opcode.STATISTICS, [statistics]),
            (Opcode.METADATA_INDEX, self._metadata))
        for opcode, records in groups:
            data = _bytes_of(*records)
            offsets.append(SummaryOffset(group_opcode=opcode, group_start=begin + len(summary),
                                         group_length=len(data)))
            summary += data
        offset_start = begin + len(summary)
        summary += _bytes_of(*offsets)
        footer = FOOTER.pack(FOOTER_OPCODE, FOOTER_BYTES, begin, offset_start)
        self._write(summary + footer + zlib.crc32(summary + footer).to_bytes(4, 'little') + MAGIC)

    def _write(self, data: bytes) -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) or 0:]
        except OSError:
            # Nothing that counts as lost stays in the file.
            with suppress(OSError):
                self._file.truncate(self._written)
            raise
        self._written += len(data)


def _bytes_of(*records: McapRecord) -> bytes:
    from mcap.data_stream import RecordBuilder
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())
