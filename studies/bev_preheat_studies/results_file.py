# SPDX-License-Identifier: Apache-2.0
"""
An append-only file of a study's results, from which a stopped study resumes.

JSON lines: the first identifies the study, each other line is a record. Floats are written with full
precision. A line is written immediately; an incomplete last line, left by a power failure, is dropped when
the file is opened again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
import fcntl
import json
import os
from typing import Any

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.output_files import AnyPath, check_writable, target_of

# Key of the first line; it identifies a results file.
STUDY = 'bev_preheat_study'
# Longest quotation of a differing value in a message.
LONGEST_VALUE = 60

# Plain values, as in JSON.
Plain = Any


class ResultsFile:
    """
    An open results file, as a context manager.

    Only one process can have it open at a time.
    """

    def __init__(self, path: AnyPath, study: Mapping[str, Plain]) -> None:
        """
        Open or create the file of the study that the plain values in `study` identify.

        Raises InvalidInput if it holds another study (the message names the difference), is not a results
        file, cannot be written or is in use.
        """
        check_writable(path)
        self._path = os.fspath(path)
        try:
            self._file = os.open(
                target_of(path), os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise InvalidInput(f'{self._path}: cannot be written: {error.strerror}') from error
        try:
            self._begin(json.loads(json.dumps(study)))
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> ResultsFile:
        """Return the file itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the file."""
        os.close(self._file)

    def records(self) -> Iterator[Plain]:
        """Return the records one at a time, oldest first."""
        with open(target_of(self._path), 'rb') as lines:
            next(lines, None)
            for number, line in enumerate(lines, start=2):
                yield self._parsed(line, number)

    def append(self, record: Plain) -> None:
        """Append a record; raise InvalidInput if the disk is full."""
        self._write((json.dumps(record) + '\n').encode())

    def _begin(self, study: Mapping[str, Plain]) -> None:
        # A file system without locks cannot detect a second process.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidInput(
                f'{self._path}: is in use by another running study') from None
        except OSError:
            pass
        self._drop_half_line()
        with open(target_of(self._path), 'rb') as lines:
            first = next(lines, None)
        if first is None:
            self._write((json.dumps({STUDY: study}) + '\n').encode())
            return
        found = self._parsed(first, 1)
        if not isinstance(found, dict) or not isinstance(found.get(STUDY), dict):
            raise InvalidInput(f'{self._path}: is not a results file of a study')
        problem = difference(found[STUDY], study)
        if problem:
            raise InvalidInput(f'{self._path}: holds another study: {problem}; choose another file')

    def _drop_half_line(self) -> None:
        """Cut the file after its last complete line."""
        size = end = os.fstat(self._file).st_size
        while end > 0:
            start = max(0, end - 65536)
            block = os.pread(self._file, end - start, start)
            newline = block.rfind(b'\n')
            if newline >= 0:
                end = start + newline + 1
                break
            end = start
        if end == 0 and size > 0 and not os.pread(self._file, 1, 0) == b'{':
            # A file without any line ending is not ours; keep it.
            raise InvalidInput(f'{self._path}: is not a results file of a study')
        if end < size:
            os.ftruncate(self._file, end)

    def _parsed(self, line: bytes, number: int) -> Plain:
        try:
            return json.loads(line)
        except ValueError:
            reason = ('is not a results file of a study' if number == 1
                      else f'line {number} is damaged: {quoted(line.decode(errors="replace"))}')
            raise InvalidInput(f'{self._path}: {reason}') from None

    def _write(self, line: bytes) -> None:
        # A single call, so that no signal can interrupt the line.
        try:
            written = os.write(self._file, line)
            if written < len(line):
                self._take_back(written)
                raise InvalidInput(f'{self._path}: cannot be written: the disk is full')
        except OSError as error:
            raise InvalidInput(f'{self._path}: cannot be written: {error.strerror}') from error

    def _take_back(self, written: int) -> None:
        with suppress(OSError):
            os.ftruncate(self._file, os.fstat(self._file).st_size - written)


def difference(found: Mapping[str, Plain], wanted: Mapping[str, Plain]) -> str:
    """Return the differences between two descriptions of a study as a text; '' if they agree."""
    problems = []
    for name in dict.fromkeys((*wanted, *found)):
        there, here = found.get(name), wanted.get(name)
        if there != here:
            problems.append(f'{name.replace("_", " ")} is {_shown(there)} in the file, {_shown(here)} here')
    return ', '.join(problems)


def _shown(value: Plain) -> str:
    if value is None:
        return 'not given'
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= LONGEST_VALUE else f'{text[:LONGEST_VALUE]}…'
