# SPDX-License-Identifier: Apache-2.0
"""The folder of recordings: names of its files, and its size, which the oldest files give way to."""

from __future__ import annotations

from contextlib import ExitStack, suppress
import fcntl
import os
from pathlib import Path
import re
import stat
import tempfile
from typing import Any

from bev_preheat.errors import InvalidInput
from bev_preheat.files.output_files import AnyPath
from bev_preheat.optional_packages import is_installed

SUFFIX = '.mcap'
# Only files with such names are ever deleted.
OWN_NAME = re.compile(r'flight_[0-9]{8}T[0-9]{6}_[0-9a-f]{8}_[0-9]{4}\.mcap')


def check_folder(folder: str | os.PathLike[str]) -> None:
    """Raise InvalidInput if a path is there and is not a folder, or its folder cannot be made; change nothing."""
    path = Path(folder).expanduser()
    try:
        status = os.stat(path)
    except FileNotFoundError:
        if os.path.islink(path):
            raise InvalidInput(f'{folder}: is a link to {os.readlink(path)}, which does not exist') from None
        return
    except (OSError, ValueError) as error:
        raise InvalidInput(f'{folder}: cannot be a folder: {getattr(error, "strerror", None) or error}') from error
    if not stat.S_ISDIR(status.st_mode):
        raise InvalidInput(f'{folder}: is not a folder; recordings need a folder of their own')


def file_name(started: str, life: str, part: int) -> str:
    """Return the name of a life's part; `started` is the instant as YYYYMMDDThhmmss."""
    return f'flight_{started}_{life}_{part:04d}{SUFFIX}'


def recordings_in(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the recordings of a folder, oldest first; raises OSError if it cannot be read."""
    found = [path for path in Path(folder).expanduser().iterdir() if OWN_NAME.fullmatch(path.name)]
    return sorted(found, key=lambda path: path.name)


def mark_as_being_written(descriptor: int) -> None:
    """Mark an open file, until it is closed or its process ends, so that no other planner deletes it."""
    # Some network file systems have no locks.
    with suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)


def is_being_written(path: Path) -> bool:
    """Return whether a process has marked a file."""
    try:
        # A pipe of that name must not block.
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


def make_room(folder: str | os.PathLike[str], most_bytes: int, kept: Path) -> list[Path]:
    """Delete the oldest recordings beyond `most_bytes`, not `kept` nor those being written; return the deleted."""
    sizes = {}
    for path in recordings_in(folder):
        with suppress(OSError):
            status = os.lstat(path)
            if stat.S_ISREG(status.st_mode):
                sizes[path] = status.st_size
    total, deleted = sum(sizes.values()), []
    for path, size in sizes.items():
        if total <= most_bytes:
            break
        if path == kept or is_being_written(path):
            continue
        with suppress(OSError):
            os.unlink(path)
            total -= size
            deleted.append(path)
    return deleted


def recording_beside(path: AnyPath) -> Path:
    """Return the path of a recording beside another output of the drive."""
    return Path(f'{os.path.splitext(path)[0]}{SUFFIX}')


class KeptRecording:
    """A planner's recording, kept at `path`; without the package mcap nothing is recorded."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._folder: Path | None = None

    def parameters(self, stack: ExitStack) -> dict[str, Any]:
        """Return the planner's parameters that make it record; `stack` deletes the working folder."""
        if not is_installed('mcap'):
            return {}
        # In the same folder, so that keeping it renames a file.
        self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory(
            prefix='.recording_', dir=self.path.parent)))
        return {'flight_recorder': self._folder}

    def keep(self) -> Path | None:
        """Keep a planner's recording under names in order; return its path, None without one. Raises OSError."""
        parts = [] if self._folder is None else recordings_in(self._folder)
        kept = [self.path] if len(parts) == 1 else [self.path.with_name(part.name) for part in parts]
        for part, path in zip(parts, kept, strict=True):
            os.replace(part, path)
        return kept[0] if kept else None
