# SPDX-License-Identifier: Apache-2.0
"""
Writes recordings in a thread of its own, so that no disk delays a command.

The planner hands its steps over and goes on. Once a second the thread makes bytes, and writes
them unchunked: after a crash every message that reached the disk can be read. If the disk is slow, full or gone,
entries are dropped and counted; the count is written as soon as writing works again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from io import FileIO
import json
import os
from pathlib import Path
from threading import Event, Thread
import time
from typing import Any, NamedTuple

from bev_preheat.optional_packages import require
from bev_preheat.recording.ring import file_name, make_room, mark_as_being_written

# Groups of entries that wait for the disk; 2 min of a planner that is fed ten times a second.
MOST_WAITING = 5000
# The thread collects groups for this time [s]: in one go, bytes cost half the time. A process
# that is killed loses them.
COLLECTING_S = 1.0
CATCHING_UP_S = 0.02
# After a millisecond of work the thread rests [s].
GROUPS_AT_ONCE, PAUSE_S = 50, 0.0005
# A new attempt after a failure [s].
REOPENED_AFTER_S = 30.0
LARGEST_RECORDING_BYTES = 64_000_000
LIBRARY = 'bev_preheat'
# Channels of the recorder itself; their messages are JSON.
BEGINNING_CHANNEL, STATE_CHANNEL, STEP_CHANNEL, GAP_CHANNEL = (
    'flight_recorder/beginning', 'flight_recorder/state', 'flight_recorder/step', 'flight_recorder/gap')
JSON = json.JSONEncoder(separators=(',', ':'), default=lambda each: each.as_dictionary())
JSON_SCHEMA = json.dumps({'type': 'object'}).encode()


class Kind(NamedTuple):
    """The kind of a channel's messages: name and definition of the type, their encodings, and what makes bytes."""

    type_name: str
    definition: bytes
    schema_encoding: str
    message_encoding: str
    encode: Callable[[Any], bytes]


# The kinds of the channels of plain values.
JSON_KINDS = {channel: Kind(f'bev_preheat/{channel.rpartition("/")[2].capitalize()}', JSON_SCHEMA, 'jsonschema',
                            'json', lambda values: JSON.encode(values).encode())
              for channel in (BEGINNING_CHANNEL, STATE_CHANNEL, STEP_CHANNEL, GAP_CHANNEL)}


class Entry(NamedTuple):
    """A message of a channel at an instant [ns]."""

    channel: str
    now_ns: int
    content: Any


class Recording(NamedTuple):
    """Where recordings go: the folder, the most bytes in it, and the life's identification and start as text."""

    folder: Path
    most_bytes: int
    life: str
    started: str


class _Collected:
    """The stream of an mcap Writer: bytes that wait for `put_down`; positions count from the file's start."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self.size = 0

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        self.size += len(data)
        return len(data)

    def tell(self) -> int:
        return self.size

    def put_down(self, file: FileIO) -> None:
        """Write them to an unbuffered file; after an OSError, which passes through, none of them is in it."""
        written, rest = self.size - sum(map(len, self._parts)), memoryview(b''.join(self._parts))
        self._parts = []
        try:
            while rest:
                rest = rest[file.write(rest) or 0:]
        except OSError:
            with suppress(OSError):
                file.truncate(written)
            raise


class RecordingWriter:
    """
    The thread that writes; `put` and `put_group` hand entries over and return at once.

    `head_of` is called in the thread: it returns the entries that a file starts with, a Beginning, and the
    planner's state after the groups so far.
    `report` is the sentence on a failure, '' while all is well; `dropped` counts the groups that were lost, `path`
    is that of the latest file.
    """

    def __init__(self, recording: Recording, kinds: dict[str, Kind],
                 head_of: Callable[[], Iterable[Entry]],
                 largest_file_bytes: int = LARGEST_RECORDING_BYTES) -> None:
        """Start the thread; raises MissingPackage without the package mcap."""
        require('mcap')
        self._recording, self._kinds = recording, {**kinds, **JSON_KINDS}
        self._largest_file_bytes = largest_file_bytes
        self._head_of, self._waiting = head_of, deque[Callable[[], Iterable[Entry]]]()
        self._news, self._hurry, self._ends = Event(), Event(), False
        self._file: FileIO | None = None
        self._path: Path | None = None
        self._retry_s = 0.0
        self._part = 0
        # Of the dropped groups, those that entries report, and those that written ones do.
        self._reported_drops = self._written_drops = 0
        # Groups that are collected and not written yet.
        self._collected = 0
        self.dropped, self.report, self.path = 0, '', ''
        self._mcap: Any = None
        self._bytes = _Collected()
        self._channels: dict[str, tuple[int, Callable[[Any], bytes]]] = {}
        self._thread = Thread(target=self._run, name='flight recorder', daemon=True)
        self._thread.start()

    def put(self, *entries: Entry) -> None:
        """Hand entries over that belong together; if too many groups wait, they are dropped."""
        self.put_group(lambda: entries)

    def put_group(self, entries_of: Callable[[], Iterable[Entry]]) -> None:
        """Hand a group of entries over, which `entries_of` returns; it is called in the thread."""
        if len(self._waiting) >= MOST_WAITING:
            self.dropped += 1
            return
        self._waiting.append(entries_of)
        # Cheaper than to wake the thread again while it collects.
        if not self._news.is_set():
            self._news.set()

    def catch_up(self) -> None:
        """Wait until the thread has taken all entries, so that none is dropped."""
        while self._waiting and self._thread.is_alive():
            self._hurry.set()
            time.sleep(CATCHING_UP_S)

    def close(self, patience_s: float = 2.0) -> None:
        """Write what waits and end the file; give up after `patience_s` [s]."""
        self._ends = True
        self._hurry.set()
        self._news.set()
        self._thread.join(patience_s)

    def _run(self) -> None:
        while True:
            self._news.wait()
            self._hurry.wait(COLLECTING_S)
            self._hurry.clear()
            self._news.clear()
            self._write_waiting()
            self._try(self._put_down)
            if self._ends:
                self._try(self._end_file)
                return

    def _write_waiting(self) -> None:
        while self._waiting:
            if self._file is None and (time.monotonic() < self._retry_s or not self._try(self._start_file)):
                # What cannot be written is lost, and memory stays bounded.
                self.dropped += len(self._waiting)
                self._waiting.clear()
                return
            group = self._waiting.popleft()
            if not self._try(partial(self._collect, group)):
                self.dropped += 1
            elif self._collected >= GROUPS_AT_ONCE and self._try(self._put_down) and not self._hurry.is_set():
                # Lets the planner go on, which would wait for the interpreter's lock.
                time.sleep(PAUSE_S)

    def _collect(self, entries_of: Callable[[], Iterable[Entry]]) -> None:
        for entry in entries_of():
            if self.dropped > self._reported_drops:
                self._add(Entry(GAP_CHANNEL, entry.now_ns, {'dropped': self.dropped - self._reported_drops}))
                self._reported_drops = self.dropped
            self._add(entry)
        self._collected += 1

    def _put_down(self) -> None:
        if self._file is not None:
            self._bytes.put_down(self._file)
            self._collected, self._written_drops = 0, self._reported_drops
            if self._bytes.size >= self._largest_file_bytes:
                self._end_file()
            elif os.fstat(self._file.fileno()).st_nlink == 0:
                # Somebody deleted it; the next steps go into another one.
                self._file.close()
                self._file = None

    def _start_file(self) -> None:
        folder = self._recording.folder
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / file_name(self._recording.started, self._recording.life, self._part)
        # Never over another file, nor through a link.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        mark_as_being_written(descriptor)
        self._path, self._file = path, os.fdopen(descriptor, 'wb', buffering=0)
        part, self._part = self._part, self._part + 1
        make_room(folder, max(self._recording.most_bytes - self._largest_file_bytes, 0), path)
        from mcap.writer import CompressionType, Writer
        self._bytes, self._channels = _Collected(), {}
        # Without chunks each message stands alone, so that a file without an end can be read up to its last one.
        stream: Any = self._bytes
        self._mcap = Writer(stream, use_chunking=False, compression=CompressionType.NONE)
        self._mcap.start('ros2', LIBRARY)
        for entry in self._head_of():
            if entry.channel == BEGINNING_CHANNEL:
                entry = entry._replace(content={**entry.content, 'part': part})
            self._add(entry)
        self._bytes.put_down(self._file)
        self.path, self.report = str(path), ''

    def _add(self, entry: Entry) -> None:
        name, now_ns, content = entry
        channel = self._channels.get(name)
        if channel is None:
            kind = self._kinds[name]
            channel = self._channels[name] = self._mcap.register_channel(
                name, kind.message_encoding, self._mcap.register_schema(
                    kind.type_name, kind.schema_encoding, kind.definition)), kind.encode
        number, encode = channel
        self._mcap.add_message(number, now_ns, encode(content), now_ns)

    def _end_file(self) -> None:
        if self._file is not None:
            self._mcap.finish()
            self._bytes.put_down(self._file)
            self._file.close()
            self._file = None

    def _try(self, action: Callable[[], None]) -> bool:
        """Do an action; after a failure give the file up for REOPENED_AFTER_S and return False."""
        try:
            action()
        except Exception as error:
            where = self._path or self._recording.folder
            reason = error.strerror if isinstance(error, OSError) else f'{type(error).__name__}: {error}'
            self.report = f'{where}: cannot be written: {reason}; the planner goes on without a recording'
            self._retry_s = time.monotonic() + REOPENED_AFTER_S
            if self._file is not None:
                with suppress(OSError):
                    self._file.close()
                self._file = None
            self.dropped += self._collected
            self._collected, self._reported_drops = 0, self._written_drops
            return False
        return True
