# SPDX-License-Identifier: Apache-2.0
"""Finds separator, header and rows of a CSV file by its first lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import csv
from dataclasses import dataclass
import re

from bev_preheat.logs.cell_numbers import decimal_mark, NUMBER, read_numbers
from bev_preheat.logs.units import pint_unit

SEPARATORS = ('\t', ';', ',', '|')
SEPARATOR_LINE = re.compile('"?sep=(.)?"?', re.IGNORECASE)
# Lines that tell the layout.
SAMPLE_LINES = 400
# LeafSpy's later versions write a few values more than its header names.
MOST_UNNAMED, LEAST_NAMED = 8, 20


@dataclass(frozen=True)
class Layout:
    """
    Layout of a CSV file: separator (None: blanks), names of the columns, number of the header's line.

    `units` has a text for each column if a line of units follows the header, else ''. `first` is the number of the
    first line of values, `rows` are cells of the first ones, `cells` is the usual number of cells in a line.
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
    return line.startswith('#') or not line.strip(' \t"\r,;|')


def find_layout(lines: Sequence[str]) -> Layout | None:
    """Return the Layout of a file that begins with these lines, None if it is no table with a header."""
    wanted = [(number, line.lstrip('\ufeff')) for number, line in enumerate(lines[:SAMPLE_LINES], start=1)
              if not is_blank(line.lstrip('\ufeff'))]
    if wanted and (match := SEPARATOR_LINE.fullmatch(wanted[0][1].strip())):
        given, wanted = [match[1] or ','], wanted[1:]
    else:
        given = []
    best = None
    for separator in (*given, *SEPARATORS, None):
        layout = _layout(wanted, separator)
        if layout is not None and (best is None or len(layout.header) > len(best.header)):
            best = layout
        if best is not None and (given or separator == '|'):
            break
    return best


def _layout(lines: Sequence[tuple[int, str]], separator: str | None) -> Layout | None:
    rows = [(number, _trimmed(split_line(line, separator))) for number, line in lines]
    for at, (number, cells) in enumerate(rows[:-1]):
        if len(cells) < 2 or 2 * sum(map(_is_value, cells)) > len(cells) or not _are_names(cells):
            continue
        following = rows[at + 1:]
        units: tuple[str, ...] = ()
        if len(following) > 1 and _are_units(following[0][1]):
            units, following = tuple(following[0][1]), following[1:]
        # A header is followed by lines of as many cells, some with values.
        usual = Counter(len(cells) for _, cells in following).most_common(1)[0][0]
        near = usual >= 2 and abs(usual - len(cells)) <= max(MOST_UNNAMED, len(cells) // 2)
        # Empty last cells are trimmed.
        if not near or not any(_is_value(cell) for _, row in following[:50] for cell in row):
            continue
        body = tuple(tuple(row) for _, row in following)
        decimal = '.' if separator == ',' else decimal_mark(cell for row in body for cell in row)
        # A number distinguishes columns of the same name.
        seen: Counter[str] = Counter()
        header = []
        for name in cells:
            seen[name] += 1
            header.append(name if seen[name] == 1 else f'{name} #{seen[name]}')
        return Layout(separator, tuple(header), number, (*units, *('',) * (len(cells) - len(units))),
                      following[0][0], body, usual, decimal)
    return None


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
    known = sum(bool(pint_unit(cell)) for cell in given)
    return bool(given) and not any(map(_is_value, given)) and 2 * known >= len(given)
