# SPDX-License-Identifier: Apache-2.0
"""
The results of a study: a file to which each result is appended, and from which a stopped study resumes.

JSON lines: the first identifies the study and the sources that compute it, because others may compute another
result; each other line is a result. Numbers are read back to the last bit. A line is written at once; an
incomplete one (power loss, full disk) is dropped when the file is opened again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
import fcntl
from functools import cache
from hashlib import sha256
from itertools import chain
import json
import os
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints, TypeVar

import numpy as np

import bev_preheat
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import version
from bev_preheat.files.output_files import AnyPath, check_writable, target_of

Result = TypeVar('Result')
# The key of the first line.
STUDY = 'bev_preheat_study'
# Longer values are cut in messages.
LONGEST_VALUE = 60
# The product and its studies.
PACKAGES = (Path(bev_preheat.__file__).resolve().parent, Path(__file__).resolve().parent)
# Hexadecimal digits that distinguish sources and inputs.
DIGITS = 12


class ResultsFile:
    """An open results file of one process; a context manager that closes it."""

    def __init__(self, path: AnyPath, identity: Mapping[str, Any]) -> None:
        """
        Open or create the file of the study with this `identity`, in plain values, and these sources.

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
            self._begin(json.loads(json.dumps({**identity, 'program': sources()})))
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> ResultsFile:
        """Return the file itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the file."""
        self._file.close()

    def results(self, kind: type[Result]) -> Iterator[Result]:
        """Return the results of a type in the file; raise InvalidInput if a line is none."""
        with open(target_of(self._path), 'rb') as lines:
            next(lines, None)
            for number, line in enumerate(lines, start=2):
                try:
                    yield value_of(kind, self._parsed(line, number))
                except (AttributeError, KeyError, TypeError) as error:
                    raise InvalidInput(f'{self._path}: line {number} is not a result of this study') from error

    def append(self, record: Any) -> None:
        """Append a record; raise InvalidInput if the disk is full."""
        line = (json.dumps(record) + '\n').encode()
        try:
            if self._file.write(line) < len(line):
                raise InvalidInput(f'{self._path}: cannot be written: the disk is full')
        except OSError as error:
            raise InvalidInput(f'{self._path}: cannot be written: {error.strerror}') from error

    def _begin(self, study: dict[str, Any]) -> None:
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
        problems = [f'{name.replace("_", " ")} is {_shown(found[STUDY].get(name))} in the file, '
                    f'{_shown(study.get(name))} here' for name in dict.fromkeys((*study, *found[STUDY]))
                    if found[STUDY].get(name) != study.get(name)]
        if problems:
            raise InvalidInput(f'{self._path}: holds another study: {", ".join(problems)}; choose another file')

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

    def _parsed(self, line: bytes, number: int) -> Any:
        try:
            return json.loads(line)
        except ValueError:
            reason = ('is not a results file of a study' if number == 1
                      else f'line {number} is damaged: {quoted(line.decode(errors="replace"))}')
            raise InvalidInput(f'{self._path}: {reason}') from None


def value_of(kind: Any, plain: Any) -> Any:
    """Return a dataclass, or a tuple or dictionary of dataclasses, from plain values; the inverse of `asdict`."""
    arguments = get_args(kind)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        fields = {name: value_of(hints[name], value) for name, value in plain.items()}
        return kind(**fields)  # type: ignore[operator]
    if get_origin(kind) is tuple:
        return tuple(value_of(arguments[0], item) for item in plain)
    if get_origin(kind) is dict:
        return {key: value_of(arguments[1], item) for key, item in plain.items()}
    if NoneType in arguments and plain is not None:
        return value_of(next(each for each in arguments if each is not NoneType), plain)
    return plain


def _shown(value: Any) -> str:
    if value is None:
        return 'not given'
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= LONGEST_VALUE else f'{text[:LONGEST_VALUE]}…'


@cache
def sources() -> str:
    """Return version and digest of the Python files and data of both packages, as a text."""
    digest = sha256()
    for package in PACKAGES:
        for path in sorted(package.rglob('*')):
            if path.suffix in ('.py', '.yaml'):
                digest.update(path.relative_to(package.parent).as_posix().encode())
                digest.update(path.read_bytes())
    return f'{version()} ({digest.hexdigest()[:DIGITS]})'


def digest_of(value: Any) -> str:
    """Return a digest of a tree of dataclasses, arrays and plain values; equal trees have equal digests."""
    return sha256(json.dumps(value, default=_plain).encode()).hexdigest()[:DIGITS]


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return {type(value).__name__: {name: getattr(value, name) for name in value.__dataclass_fields__}}
