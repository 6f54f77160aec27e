# SPDX-License-Identifier: Apache-2.0
"""Finds separator, header, units and rows of a table by its first lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import csv
from dataclasses import dataclass
import re

from bev_preheat.files.number_text import decimal_mark, NUMBER, read_numbers
from bev_preheat.files.units import split_unit, unit_named

SEPARATORS = ('\t', ';', ',', '|')
SEPARATOR_LINE = re.compile('"?sep=(.)?"?[;,\\t]*', re.IGNORECASE)
# Lines that determine the layout.
SAMPLE_LINES = 400
# LeafSpy's later versions write a few values more than its header names.
MOST_UNNAMED, LEAST_NAMED = 8, 20


@dataclass(frozen=True)
class Layout:
    """
    Layout of a table: separator (None: blanks), names of the columns and their units, number of the header's line.

    `units` are those of a line of units below the header, else those in the names, '' if unknown. `first` is the
    number of the first line of values, `rows` are cells of the first ones, `cells` is the usual number of cells in
    a line.
    """

    separator: str | None
    header: tuple[str, ...]
    header_line: int
    units: tuple[str, ...]
    first: int
    rows: tuple[tuple[str, ...], ...]
    cells: int
    decimal: str


def split_line(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, stripped; empty ones at its end stay."""
    if separator is None:
        return line.split()
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):
        return [cell.strip(' "') for cell in line.split(separator)]


def is_blank(line: str) -> bool:
    """Return whether a line has no cell, or is a comment."""
    return line.lstrip(' "').startswith('#') or not line.strip(' \t"\r,;|')


def find_layout(lines: Sequence[str]) -> Layout | None:
    """Return the Layout of a file that begins with these lines, None if it is no table with a header."""
    wanted = [(number, line.lstrip('\ufeff')) for number, line in enumerate(lines[:SAMPLE_LINES], start=1)
              if not is_blank(line.lstrip('\ufeff'))]
    separators: tuple[str | None, ...] = (*SEPARATORS, None)
    if wanted and (match := SEPARATOR_LINE.fullmatch(wanted[0][1].strip())):
        separators, wanted = (match[1] or ',',), wanted[1:]
    found = [layout for separator in separators if (layout := _layout(wanted, separator)) is not None]
    # The separator that leaves most cells with values: 1,5;2,5 are two numbers, 2026-01-01 10:00 is one time.
    return max(found, key=lambda layout: sum(_is_value(cell) for row in layout.rows[:50] for cell in row),
               default=None)


def _layout(lines: Sequence[tuple[int, str]], separator: str | None) -> Layout | None:
    rows = [(number, _trimmed(split_line(_without_comment(line), separator))) for number, line in lines]
    first = None
    for at in range(len(rows) - 1):
        layout = _with_header(rows, at, separator)
        # A title may have as many cells as the header, which is just above the values.
        if layout is not None and any(map(_is_value, layout.rows[0])):
            return layout
        first = first or layout
    return first


def _with_header(rows: Sequence[tuple[int, list[str]]], at: int, separator: str | None) -> Layout | None:
    """Return the Layout with the header in a row; None if the row has no names or no values below."""
    number, cells = rows[at]
    if 2 * sum(map(_is_value, cells)) > len(cells) or not _are_names(cells):
        return None
    following = rows[at + 1:]
    units = [split_unit(name).unit for name in cells]
    if len(following) > 1 and _are_units(following[0][1]):
        for column, text in enumerate(following[0][1][:len(cells)]):
            units[column] = unit_named(text.strip('[]() ')) or units[column]
        following = following[1:]
    # A header is followed by lines of as many cells, some with values.
    usual = Counter(len(row) for _, row in following).most_common(1)[0][0]
    # Empty last cells are trimmed.
    near = usual >= 2 and abs(usual - len(cells)) <= max(MOST_UNNAMED, len(cells) // 2)
    if not near or not any(_is_value(cell) for _, row in following[:50] for cell in row):
        return None
    body = tuple(tuple(row) for _, row in following)
    decimal = '.' if separator == ',' else decimal_mark(cell for row in body for cell in row)
    # A number distinguishes columns of the same name.
    seen: Counter[str] = Counter()
    header = []
    for name in cells:
        seen[name] += 1
        header.append(name if seen[name] == 1 else f'{name} #{seen[name]}')
    return Layout(separator, tuple(header), number, tuple(units), following[0][0], body, usual, decimal)


def _without_comment(line: str) -> str:
    return line.partition('#')[0] if '#' in line and '"' not in line else line


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _is_value(cell: str) -> bool:
    cell = cell.replace(',', '.')
    is_number = NUMBER.fullmatch(cell) is not None and not read_numbers([cell])[1][0]
    return is_number or re.match(r'\d{1,4}[-/.:]\d', cell) is not None


def _are_names(cells: Sequence[str]) -> bool:
    named = sum(bool(re.search(r'[^\W\d_]', cell)) for cell in cells)
    return named >= 2 and 2 * named > len(cells)


def _are_units(cells: Sequence[str]) -> bool:
    given = [cell.strip('[]() ') for cell in cells if cell]
    known = sum(bool(unit_named(cell)) for cell in given)
    return bool(given) and not any(map(_is_value, given)) and 2 * known >= len(given)
