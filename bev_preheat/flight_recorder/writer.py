# SPDX-License-Identifier: Apache-2.0
"""
Writes recordings in a thread of its own, so that no disk delays a command.

The planner hands entries over and goes on. The thread makes bytes of them, and writes them unchunked: after a
crash every message that reached the disk can be read. If the disk is slow, full or gone, entries are dropped
and counted; the count is written as soon as writing works again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
import json
import os
from pathlib import Path
from threading import Event, Thread
import time
from typing import Any, IO, NamedTuple

from bev_preheat.flight_recorder.ring import file_name, make_room, mark_as_being_written
from bev_preheat.optional_packages import require

# Entries that wait for the disk; 2 min of a planner that is fed ten times a second.
MOST_WAITING = 5000
# The thread collects entries for this time [s], so that it does not compute while the planner does.
COLLECTING_S = 0.1
FLUSH_PERIOD_S = 1.0
CATCHING_UP_S = 0.02
# A new attempt after a failure [s].
RETRY_S = 30.0
LARGEST_FILE_BYTES = 64_000_000
LIBRARY = 'bev_preheat'
# Channels of the recorder itself; their messages are JSON.
BEGINNING_CHANNEL, STEP_CHANNEL, GAP_CHANNEL = (
    'flight_recorder/beginning', 'flight_recorder/step', 'flight_recorder/gap')
JSON_SCHEMA = json.dumps({'type': 'object'}).encode()
JSON = json.JSONEncoder(separators=(',', ':'))


class Kind(NamedTuple):
    """The kind of a channel's messages: name and definition of the type, their encodings, and what makes bytes."""

    type_name: str
    definition: bytes
    schema_encoding: str
    message_encoding: str
    encode: Callable[[Any], bytes]


def json_kind(name: str) -> Kind:
    """Return the Kind of plain values."""
    return Kind(f'bev_preheat/{name}', JSON_SCHEMA, 'jsonschema', 'json',
                lambda values: JSON.encode(
                    values if isinstance(values, dict) else values.as_dictionary()).encode())


JSON_KINDS = {BEGINNING_CHANNEL: json_kind('Beginning'), STEP_CHANNEL: json_kind('Step'),
              GAP_CHANNEL: json_kind('Gap')}


class Entry(NamedTuple):
    """A message of a channel at an instant [ns]."""

    channel: str
    now_ns: int
    content: Any


class Recording(NamedTuple):
    """Where recordings go: the folder, the most bytes in it, and the life's identification and start in words."""

    folder: Path
    most_bytes: int
    life: str
    started: str


class RecordingWriter:
    """
    The thread that writes; `put` hands entries over and returns at once.

    `head` are the entries that the next file starts with: a Beginning, and the messages that still hold; the
    planner replaces them from time to time. `report` is the sentence on a failure, '' while all is well;
    `dropped` counts the steps that were lost, `path` is that of the latest file.
    """

    def __init__(self, recording: Recording, kinds: dict[str, Kind],
                 head: tuple[Entry, ...], metadata: dict[str, dict[str, str]] | None = None,
                 largest_file_bytes: int = LARGEST_FILE_BYTES) -> None:
        """Start the thread; raises MissingPackage without the package mcap."""
        require('mcap')
        self.head = head
        self._recording, self._kinds = recording, {**kinds, **JSON_KINDS}
        self._metadata, self._largest_file_bytes = metadata or {}, largest_file_bytes
        self._waiting: deque[tuple[Entry, ...]] = deque()
        self._news, self._ends = Event(), False
        self._file: IO[bytes] | None = None
        self._path: Path | None = None
        self._retry_s = 0.0
        self._part = 0
        self._reported_drops = 0
        self.dropped, self.report, self.path = 0, '', ''
        self._thread = Thread(target=self._run, name='flight recorder', daemon=True)
        self._thread.start()

    def put(self, *entries: Entry) -> None:
        """Hand entries over that belong together; if too many wait, they are dropped."""
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
            return
        self._waiting.append(entries)
        # Cheaper than to wake the thread again while it collects.
        if not self._news.is_set():
            self._news.set()

    def catch_up(self) -> None:
        """Wait until the thread has taken all entries, so that none is dropped."""
        while self._waiting and self._thread.is_alive():
            time.sleep(CATCHING_UP_S)

    def close(self, patience_s: float = 2.0) -> None:
        """Write what waits and end the file; give up after `patience_s` [s]."""
        self._ends = True
        self._news.set()
        self._thread.join(patience_s)

    def _run(self) -> None:
        flushed_s = time.monotonic()
        while True:
            self._news.wait()
            if not self._ends:
                time.sleep(COLLECTING_S)
            self._news.clear()
            self._write_waiting()
            if (self._file is not None and time.monotonic() - flushed_s >= FLUSH_PERIOD_S) or self._ends:
                flushed_s = time.monotonic()
                self._try(self._flush)
            if self._ends:
                self._try(self._end_file)
                return

    def _write_waiting(self) -> None:
        while self._waiting:
            if self._file is None and not self._open():
                # What cannot be written is lost, and memory stays bounded.
                self.dropped += len(self._waiting)
                self._waiting.clear()
                return
            entries = self._waiting.popleft()
            if not self._try(partial(self._write_group, entries)):
                self.dropped += 1

    def _write_group(self, entries: tuple[Entry, ...]) -> None:
        if self.dropped > self._reported_drops:
            self._write(Entry(GAP_CHANNEL, entries[0].now_ns, {'dropped': self.dropped - self._reported_drops}))
            self._reported_drops = self.dropped
        for entry in entries:
            self._write(entry)
        assert self._file is not None
        if self._file.tell() >= self._largest_file_bytes:
            self._end_file()

    def _open(self) -> bool:
        if time.monotonic() < self._retry_s:
            return False
        return self._try(self._start_file)

    def _start_file(self) -> None:
        from mcap.writer import CompressionType, Writer
        folder = self._recording.folder
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / file_name(self._recording.started, self._recording.life, self._part)
        # Never over another file, nor through a link.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        mark_as_being_written(descriptor)
        self._path, self._file = path, os.fdopen(descriptor, 'wb')
        part, self._part = self._part, self._part + 1
        make_room(folder, max(self._recording.most_bytes - self._largest_file_bytes, 0), path)
        self._writer = Writer(self._file, use_chunking=False, compression=CompressionType.NONE)
        self._writer.start(profile='ros2', library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._sequence = 0
        for name, values in self._metadata.items():
            self._writer.add_metadata(name, values)
        for entry in self.head:
            if entry.channel == BEGINNING_CHANNEL:
                entry = entry._replace(content={**entry.content, 'part': part})
            self._write(entry)
        self.path, self.report = str(path), ''

    def _write(self, entry: Entry) -> None:
        channel = self._channels.get(entry.channel)
        kind = self._kinds[entry.channel]
        if channel is None:
            schema = self._writer.register_schema(kind.type_name, kind.schema_encoding, kind.definition)
            channel = self._channels[entry.channel] = self._writer.register_channel(
                entry.channel, kind.message_encoding, schema)
        self._sequence += 1
        self._writer.add_message(channel, entry.now_ns, kind.encode(entry.content), entry.now_ns, self._sequence)

    def _flush(self) -> None:
        if self._file is not None:
            self._file.flush()

    def _end_file(self) -> None:
        if self._file is not None:
            self._writer.finish()
            self._file.close()
            self._file = None

    def _try(self, action: Callable[[], None]) -> bool:
        """Do an action; after a failure give the file up for RETRY_S and return False."""
        try:
            action()
        except Exception as error:
            where = self._path or self._recording.folder
            reason = error.strerror if isinstance(error, OSError) else f'{type(error).__name__}: {error}'
            self.report = f'{where}: cannot be written: {reason}; the planner goes on without a recording'
            self._retry_s = time.monotonic() + RETRY_S
            if self._file is not None:
                with suppress(OSError):
                    self._file.close()
                self._file = None
            return False
        return True
