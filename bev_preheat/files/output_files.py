# SPDX-License-Identifier: Apache-2.0
"""
The only writer of output files: whole or not at all, and regular files only.

A run checks its outputs before it computes anything (`check_outputs`). `write_whole` checks again, writes a
temporary file in the same folder and renames it: a reader, or a crash, finds the old contents or the new,
never a part. A device, pipe, socket or folder is never opened for writing and never replaced.
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
# The path of standard output, for options that allow it.
STANDARD_OUTPUT = '-'


class OutputFile(NamedTuple):
    """An output: option, path (None: not requested), allowed suffixes, and whether a missing folder is made."""

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
    """Return the os.stat_result of a regular file, None if nothing is there; raise InvalidInput for all else."""
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
    """Raise InvalidInput if a file cannot be written, its folder made if allowed; change and open nothing."""
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
        raise InvalidInput(f'{_shown(path)}: cannot be written: the folder {folder} is write-protected')


def check_outputs(outputs: Iterable[OutputFile], inputs: Sequence[AnyPath] = ()) -> None:
    """Refuse outputs, before anything is computed, that cannot be written, are an input or another output."""
    problems: list[str] = []
    earlier: list[tuple[str, AnyPath]] = []
    for output in outputs:
        if output.path is None:
            continue
        try:
            if output.suffixes and os.path.splitext(os.fspath(output.path))[1].lower() not in output.suffixes:
                raise InvalidInput(f'{_shown(output.path)}: must end in {" or ".join(output.suffixes)}')
            if output.suffixes is PICTURE_SUFFIXES:
                require('matplotlib')
            check_writable(output.path, output.make_folder)
        except InvalidInput as error:
            problems += [f'{output.option}: {problem}' for problem in error.problems]
            continue
        start = f'{output.option}: {_shown(output.path)}: is the same file as'
        read = [path for path in inputs if _is_one_file(output.path, path)]
        written = [option for option, path in earlier if _is_one_file(output.path, path)]
        problems += [f'{start} the input {path}, which must not be overwritten' for path in read[:1]]
        problems += [f'{start} {option}; each output needs its own file' for option in written[:1]]
        earlier.append((output.option, output.path))
    if problems:
        raise InvalidInput(problems)


def write_whole(path: AnyPath, contents: str | bytes, make_folder: bool = False,
                outlasts_power: bool = True) -> None:
    """
    Write bytes, or text as UTF-8, to a file: everything or, if anything fails, nothing.

    A link is followed, not replaced. An existing file keeps its mode and, if permitted, its owner; a new one
    follows the umask. `make_folder` creates missing folders. If it need not outlast the computer's power, it is
    not waited for until it is on the disk. Raises InvalidInput with file and reason if it cannot be written.
    """
    if isinstance(contents, str):
        # A comment may quote a file name that is not valid text.
        contents = contents.encode('utf-8', 'backslashreplace')
    check_writable(path, make_folder)
    target = target_of(path)
    try:
        if make_folder:
            os.makedirs(os.path.dirname(target), exist_ok=True)
        _replace(path, target, contents, outlasts_power)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be written: {_reason(error)}') from error


def _replace(path: AnyPath, target: str, contents: bytes, outlasts_power: bool) -> None:
    before = existing_file(path)
    mode = 0o666 if before is None else stat.S_IMODE(before.st_mode)
    # A short name, because the target's may have the maximum length.
    temporary = os.path.join(os.path.dirname(target), f'.bev_preheat-{os.urandom(8).hex()}.tmp')
    handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode & 0o777)
    try:
        with open(handle, 'wb') as file:
            if before is not None:
                # Changing the owner clears mode bits, so set the mode second.
                with suppress(PermissionError):
                    os.fchown(handle, before.st_uid, before.st_gid)
                os.fchmod(handle, mode)
            file.write(contents)
            file.flush()
            if outlasts_power:
                os.fsync(handle)
        # A pipe or device may have taken the place of the file.
        existing_file(path)
        os.replace(temporary, target)
    except BaseException:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def _is_one_file(first: AnyPath, second: AnyPath) -> bool:
    """Return whether two paths lead to the same file, which need not exist."""
    if target_of(first) == target_of(second):
        return True
    try:
        return os.path.samefile(expanded(first), expanded(second))
    except OSError:
        return False


def _shown(path: AnyPath) -> str:
    return os.fspath(path) or "''"


def _reason(error: Exception) -> str:
    # A NUL character raises ValueError, with a text that depends on Python's version.
    return getattr(error, 'strerror', None) or 'a path must not have a NUL character'
