# SPDX-License-Identifier: Apache-2.0
"""Reads text files, and refuses everything that is no regular file: a pipe blocks, a device never ends."""

from __future__ import annotations

import os

from bev_preheat.errors import InvalidInput

AnyPath = str | os.PathLike[str]
LARGEST_TEXT = 64_000_000


def check_input(path: AnyPath) -> None:
    """Raise InvalidInput unless a path is a regular file or a link to one; `~` is the home folder."""
    file = os.path.expanduser(path)
    # pathlib's is_file() raises if a name is too long or a folder is not accessible.
    if not os.path.isfile(file):
        raise InvalidInput(f'{path}: ' + (
            'is a folder; a file is needed' if os.path.isdir(file) else
            'is not a regular file' if os.path.exists(file) else 'no such file'))


def read_text(path: AnyPath, encoding: str = 'utf-8') -> str:
    """Return a file's text; raise InvalidInput if it cannot be read, is no UTF-8 or has more than 64 MB."""
    check_input(path)
    try:
        with open(os.path.expanduser(path), encoding=encoding) as file:
            text = file.read(LARGEST_TEXT + 1)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'is not UTF-8 text'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
    if len(text) > LARGEST_TEXT:
        raise InvalidInput(f'{path}: is larger than {LARGEST_TEXT / 1e6:.0f} MB')
    return text
