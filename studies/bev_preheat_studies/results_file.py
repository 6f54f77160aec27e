# SPDX-License-Identifier: Apache-2.0
"""
The results of a study: a file to which each result is appended, and from which a stopped study resumes.

JSON lines: the first describes the study, each other one is a record. Numbers are read back to the last bit.
A line is written at once; an incomplete one (power loss, full disk) is dropped when the file is opened again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import fcntl
from itertools import chain
import json
import os
from typing import Any

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.output_files import AnyPath, check_writable, target_of

# The key of the first line.
STUDY = 'bev_preheat_study'
# Longer values are cut in messages.
LONGEST_VALUE = 60

# Plain values, as in JSON.
Plain = Any


class ResultsFile:
    """An open results file of one process; a context manager that closes it."""

    def __init__(self, path: AnyPath, study: Mapping[str, Plain]) -> None:
        """
        Open or create the file of the study that `study` describes in plain values.

        Raises InvalidInput if the file holds another study (naming the difference), is not a results file,
        cannot be written or is in use.
        """
        check_writable(path)
        self._path = os.fspath(path)
        try:
            # Without a buffer each line is one system call, which no signal divides.
            self._file = open(target_of(path), 'ab+', buffering=0)
        except OSError as error:
            raise InvalidInput(f'{self._path}: cannot be written: {error.strerror}') from error
        try:
            self._begin(json.loads(json.dumps(study)))
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> ResultsFile:
        """Return the file itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the file."""
        self._file.close()

    def records(self) -> Iterator[Plain]:
        """Return the records one at a time, oldest first."""
        with open(target_of(self._path), 'rb') as lines:
            next(lines, None)
            for number, line in enumerate(lines, start=2):
                yield self._parsed(line, number)

    def append(self, record: Plain) -> None:
        """Append a record; raise InvalidInput if the disk is full."""
        line = (json.dumps(record) + '\n').encode()
        try:
            if self._file.write(line) < len(line):
                raise InvalidInput(f'{self._path}: cannot be written: the disk is full')
        except OSError as error:
            raise InvalidInput(f'{self._path}: cannot be written: {error.strerror}') from error

    def _begin(self, study: Mapping[str, Plain]) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InvalidInput(f'{self._path}: another running study writes to this file') from None
        except OSError:
            # Some file systems have no locks.
            pass
        first = self._drop_half_line()
        if not first:
            self.append({STUDY: study})
            return
        found = self._parsed(first, 1)
        if not isinstance(found, dict) or not isinstance(found.get(STUDY), dict):
            raise InvalidInput(f'{self._path}: is not a results file of a study')
        problem = difference(found[STUDY], study)
        if problem:
            raise InvalidInput(f'{self._path}: holds another study: {problem}; choose another file')

    def _drop_half_line(self) -> bytes:
        """Cut the file after its last complete line; return the first line, b'' if no line is complete."""
        with open(target_of(self._path), 'rb') as lines:
            first = next(lines, b'')
            if not first.endswith(b'\n') and not b'{'.startswith(first[:1]):
                # A text without an end of line belongs to somebody and must not be lost.
                raise InvalidInput(f'{self._path}: is not a results file of a study')
            whole = sum(len(line) for line in chain([first], lines) if line.endswith(b'\n'))
        if whole < os.fstat(self._file.fileno()).st_size:
            self._file.truncate(whole)
        return first if whole else b''

    def _parsed(self, line: bytes, number: int) -> Plain:
        try:
            return json.loads(line)
        except ValueError:
            reason = ('is not a results file of a study' if number == 1
                      else f'line {number} is damaged: {quoted(line.decode(errors="replace"))}')
            raise InvalidInput(f'{self._path}: {reason}') from None


def difference(found: Mapping[str, Plain], wanted: Mapping[str, Plain]) -> str:
    """Return the differences of two descriptions of a study in words; '' if they are equal."""
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
