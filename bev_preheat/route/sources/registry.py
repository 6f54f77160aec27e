# SPDX-License-Identifier: Apache-2.0
"""Chooses the reader of a route's file by its content; names and suffixes do not count."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.route.sources.headers import Header, read_header
from bev_preheat.route.text_table import read_text_table

if TYPE_CHECKING:
    from bev_preheat.route.sources.journey import Journey

# Largest file [bytes]; a day of samples at 10 Hz has less.
LARGEST_FILE = 64_000_000
# Enough text to recognise a format.
BEGINNING = 65536
# Format, module below this package, and its function, by the first sign of the text.
FORMATS = {
    'table': ('table', 'read_table'),
}


def read_journey(path: Path) -> Journey | None:
    """
    Return the Journey of a file; None if it is a route file with powers (route.csv_file reads it).

    Raises InvalidInput naming file, place, value and what to do.
    """
    module, function = FORMATS[format_of(path)] if not has_powers(path) else (None, None)
    if module is None:
        return None
    journey: Journey = getattr(import_module(f'{__package__}.{module}'), function)(path)
    return journey


def format_of(path: Path) -> str:
    """Return the key of FORMATS for a file; raise InvalidInput if it is too large or cannot be read."""
    beginning(path)
    return 'table'


def beginning(path: Path) -> bytes:
    """Return the beginning of a file; raise InvalidInput if the file is too large or cannot be read."""
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise InvalidInput(f'{path}: has {size / 1e6:.0f} MB; at most {LARGEST_FILE / 1e6:.0f} MB are read')
        with open(path, 'rb') as file:
            return file.read(BEGINNING)
    except OSError as error:
        raise InvalidInput(f'{path}: cannot be read: {error.strerror}') from error


def has_powers(path: Path) -> bool:
    """Return whether a table is a route file: with powers, or without any column that a table reader knows."""
    if format_of(path) != 'table':
        return False
    header = read_text_table(path, ()).header
    if any(name.startswith('propulsion_power') for name in header):
        return True
    known = {column.quantity for column in map(read_header, header) if isinstance(column, Header)}
    return not known & {'time', 'speed', 'duration', 'length'}
