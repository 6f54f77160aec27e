# SPDX-License-Identifier: Apache-2.0
"""
Writes all of the package's output files: whole or not at all, and only regular files.

A run checks its outputs before it computes anything (`check_outputs`). `write_whole` checks again,
because the file system may have changed meanwhile, writes a temporary file in the same folder and renames it
to the target: a reader, or a crash, finds the old contents or the new, never a part.
A device, pipe, socket or folder is never opened for writing and never replaced.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
import os
import stat
from typing import NamedTuple

from bev_preheat.errors import InvalidInput
from bev_preheat.optional_packages import require

AnyPath = str | os.PathLike[str]
PICTURE_SUFFIXES = ('.png', '.svg', '.pdf')
KINDS = ((stat.S_ISREG, ''), (stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a named pipe'),
         (stat.S_ISSOCK, 'a socket'), (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))
# Standard output as a file name, for options that allow it.
STANDARD_OUTPUT = '-'
STANDARD_STREAMS = {1: 'standard output', 2: 'standard error'}


class OutputFile(NamedTuple):
    """
    An output file of a run: the option that names it, and its path (None: not requested).

    `suffixes` are those allowed (empty: any). With `make_folder` its folder is created if needed.
    """

    option: str
    path: AnyPath | None
    suffixes: tuple[str, ...] = ()
    make_folder: bool = False


def expanded(path: AnyPath) -> str:
    """Return a path as text, with `~` replaced by the home folder."""
    return os.path.expanduser(os.fspath(path))


def target_of(path: AnyPath) -> str:
    """Return the absolute path that a write to `path` reaches: `~` expanded, all links followed."""
    return os.path.realpath(expanded(path))


def existing_file(path: AnyPath) -> os.stat_result | None:
    """
    Return the os.stat_result of the regular file at a path, or None.

    Raises InvalidInput if the path is not a regular file, or is invalid.
    """
    text = expanded(path)
    try:
        status = os.stat(text)
    except FileNotFoundError:
        if os.path.basename(text) in ('', '.', '..'):
            raise InvalidInput(f'{_shown(path)}: is a folder; a file is needed') from None
        return None
    except (OSError, ValueError) as error:
        raise InvalidInput(f'{_shown(path)}: cannot be a file: {_reason(error)}') from error
    kind = next((name for is_kind, name in KINDS if is_kind(status.st_mode)), 'not a regular file')
    if kind:
        raise InvalidInput(f'{_shown(path)}: is {kind}; only a regular file can be written')
    return status


def check_writable(path: AnyPath, make_folder: bool = False) -> None:
    """
    Raise InvalidInput if no file can be written at a path; changes and opens nothing.

    With `make_folder` the folder may be missing, if it can be created.
    """
    status, target = existing_file(path), target_of(path)
    if status is not None and not os.access(target, os.W_OK):
        raise InvalidInput(f'{_shown(path)}: cannot be written: the file is write-protected')
    folder = os.path.dirname(target)
    while make_folder and not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    if not os.path.isdir(folder):
        problem = 'is not a folder' if os.path.lexists(folder) else 'does not exist'
        raise InvalidInput(f'{_shown(path)}: cannot be written: {folder} {problem}')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InvalidInput(
            f'{_shown(path)}: cannot be written: the folder {folder} is write-protected')


def check_outputs(outputs: Iterable[OutputFile], inputs: Sequence[AnyPath] = ()) -> None:
    """
    Check OutputFiles before anything is computed; `inputs` are the paths of all files that are read.

    Raises InvalidInput, one problem per output, if it cannot be written, has no allowed suffix,
    is an input, or is the same file as another output or as a standard stream.
    """
    problems: list[str] = []
    earlier: list[tuple[str, AnyPath]] = []
    for output in outputs:
        if output.path is None:
            continue
        try:
            _check_suffix(output.path, output.suffixes)
            if output.suffixes is PICTURE_SUFFIXES:
                require('matplotlib')
            check_writable(output.path, output.make_folder)
            _check_no_standard_stream(output.path)
        except InvalidInput as error:
            problems += [f'{output.option}: {problem}' for problem in error.problems]
            continue
        for path in inputs:
            if _is_one_file(output.path, path):
                problems.append(f'{output.option}: {_shown(output.path)}: is the same file as the '
                                f'input {path}, which must not be overwritten')
                break
        for option, path in earlier:
            if _is_one_file(output.path, path):
                problems.append(f'{output.option}: {_shown(output.path)}: is the same file as '
                                f'{option}; each output needs its own file')
                break
        earlier.append((output.option, output.path))
    if problems:
        raise InvalidInput(problems)


def write_whole(path: AnyPath, contents: str | bytes, make_folder: bool = False) -> None:
    """
    Write bytes, or text as UTF-8, to a file: everything or, if anything fails, nothing.

    A link is followed, not replaced. An existing file keeps its mode and, if permitted, its owner;
    a new one follows the umask. With `make_folder` missing folders are created. Raises InvalidInput,
    naming the file and the reason, if it cannot be written.
    """
    if isinstance(contents, str):
        # A file name from a command line, quoted in a comment, may not be valid text.
        contents = contents.encode('utf-8', 'backslashreplace')
    check_writable(path, make_folder)
    target = target_of(path)
    try:
        if make_folder:
            os.makedirs(os.path.dirname(target), exist_ok=True)
        _replace(path, target, contents)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be written: {_reason(error)}') from error


def _replace(path: AnyPath, target: str, contents: bytes) -> None:
    before = existing_file(path)
    mode = 0o666 if before is None else stat.S_IMODE(before.st_mode)
    # A short name of its own, because the target's may already have the maximum length.
    temporary = os.path.join(os.path.dirname(target), f'.bev_preheat-{os.urandom(8).hex()}.tmp')
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode & 0o777)
    try:
        with open(handle, 'wb') as file:
            if before is not None:
                # Changing the owner clears mode bits, so the mode comes second.
                with suppress(PermissionError):
                    os.fchown(handle, before.st_uid, before.st_gid)
                os.fchmod(handle, mode)
            file.write(contents)
            file.flush()
            os.fsync(handle)
        # Check again, because the target may have changed.
        existing_file(path)
        os.replace(temporary, target)
    except BaseException:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def _check_suffix(path: AnyPath, suffixes: tuple[str, ...]) -> None:
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    if suffixes and suffix not in suffixes:
        raise InvalidInput(f'{_shown(path)}: must end in {" or ".join(suffixes)}')


def _check_no_standard_stream(path: AnyPath) -> None:
    status = existing_file(path)
    for descriptor, name in STANDARD_STREAMS.items():
        with suppress(OSError):
            if status is not None and os.path.samestat(status, os.fstat(descriptor)):
                raise InvalidInput(f'{_shown(path)}: {name} is redirected to this file')


def _is_one_file(first: AnyPath, second: AnyPath) -> bool:
    """Return whether two paths lead to the same file, which may not exist yet."""
    if target_of(first) == target_of(second):
        return True
    try:
        return os.path.samefile(expanded(first), expanded(second))
    except OSError:
        return False


def _shown(path: AnyPath) -> str:
    return os.fspath(path) or "''"


def _reason(error: Exception) -> str:
    # ValueError: a path with a NUL character; its message depends on the Python version.
    return getattr(error, 'strerror', None) or 'a path must not have a NUL character'
