# SPDX-License-Identifier: Apache-2.0
"""Tables in text files: read in blocks of bounded size, or as a whole with every cell checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.number_text import ambiguous, is_clear, NUMBER, why_no_number
from bev_preheat.files.table_layout import find_layout, is_blank, Layout, LEAST_NAMED, MOST_UNNAMED, split_line
from bev_preheat.files.table_text import encoding_of, first_lines, HEAD_BYTES, line_blocks, read_head

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray


class TableFile:
    """The rows of a text file below the header of its Layout."""

    def __init__(self, path: str | Path, encoding: str, layout: Layout) -> None:
        """Take the file's encoding and Layout; raises InvalidInput if its lines do not fit its header."""
        self.path, self.layout, self.encoding = path, layout, encoding
        usual, named = layout.cells, len(layout.header)
        if usual > named and not (named >= LEAST_NAMED and usual - named <= MOST_UNNAMED):
            hint = '; with decimal commas, separate the columns by semicolons' if layout.separator == ',' else ''
            raise InvalidInput(f'{path}, line {layout.first}: has {usual} values; the header names '
                               f'{named} columns{hint}')
        self._least, self._most = min(usual, named), max(usual, named)

    def blocks(self, drop: Callable[[int, str], object]) -> Iterator[tuple[IntArray, list[tuple[str, ...]]]]:
        """Yield numbers of lines and the cells of each column; `drop` gets number and fault of other lines."""
        for first, lines in line_blocks(self.path, self.encoding):
            numbers, rows = self._rows(first, lines, drop)
            if rows:
                yield np.array(numbers, dtype=int), list(zip(*rows))

    def _rows(self, first: int, lines: Sequence[str],
              drop: Callable[[int, str], object]) -> tuple[list[int], list[list[str]]]:
        """Return line numbers and cells of the lines of values, all of the header's length."""
        layout, named = self.layout, len(self.layout.header)
        header = list(layout.header)
        numbers, rows = [], []
        for number, line in enumerate(lines, start=first):
            if number < layout.first or is_blank(line):
                continue
            text = line.partition('#')[0] if '#' in line and '"' not in line else line
            cells = split_line(text, layout.separator)
            while len(cells) > self._most and not cells[-1]:
                cells.pop()
            if not self._least <= len(cells) <= self._most:
                # A line cut short at the end of the file, or two lines written into one.
                drop(number, f'has {len(cells)} values; the header names {named} columns')
                continue
            cells = cells[:named] if len(cells) >= named else cells + [''] * (named - len(cells))
            # Logs that were joined repeat their header.
            if cells != header:
                numbers.append(number)
                rows.append(cells)
        return numbers, rows


def open_table(path: str | Path, head: bytes) -> TableFile | None:
    """Return the open table if a file's first bytes are those of a table with a header, else None."""
    encoding = encoding_of(head)
    if encoding is None:
        return None
    lines = first_lines(head, encoding)
    # The last line may be cut.
    layout = find_layout(lines[:-1] if len(head) >= HEAD_BYTES and len(lines) > 1 else lines)
    return None if layout is None else TableFile(path, encoding, layout)


@dataclass(frozen=True)
class Table:
    """
    Cells of a table as texts: those of each column below `header`, and the line number of each row.

    `units` has the unit of each column, '' if unknown; `comments` are lines above the header, with their numbers.
    """

    path: str | Path
    header: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[tuple[str, ...], ...]
    lines: Sequence[int]
    decimal: str = '.'
    # Commas between the columns leave the point to the decimals.
    is_sure_of_decimals: bool = True
    header_line: int = 0
    comments: tuple[tuple[int, str], ...] = ()
    # The name of a row that is no line of the file.
    row_name: str = ''

    def where(self, row: int) -> str:
        """Return a row's place for messages: file and line, or the row's own name and number."""
        return f'{self.row_name} {row + 1}' if self.row_name else f'{self.path}, line {self.lines[row]}'

    def texts(self, name: str) -> tuple[str, ...]:
        """Return the cells of a column."""
        return self.columns[self.header.index(name)]

    def numbers(self, name: str) -> FloatArray:
        """
        Return the numbers of a column, shape (N,).

        Raises InvalidInput naming line, column and text of each cell that is not a plain number, or if a number
        may have a thousands separator, because an error by a factor of a thousand gives a wrong trip.
        """
        texts = self.texts(name)
        plain = [text.replace(',', '.') for text in texts] if self.decimal == ',' else texts
        matches = map(NUMBER.fullmatch, plain)
        problems = [f'{self.where(at)}: {name}: {why_no_number(text)}'
                    for at, (text, match) in enumerate(zip(texts, matches)) if match is None or match[2]]
        unclear = '' if problems or self.is_sure_of_decimals else ambiguous(texts)
        if unclear and all(not is_clear(text) for column in self.columns for text in column):
            mark = ',' if ',' in unclear else '.'
            problems.append(
                f'{self.where(texts.index(unclear))}: {name}: {quoted(unclear)} can be read as '
                f'{unclear.replace(mark, "")} or as {unclear.replace(mark, ".").rstrip("0")}; write no thousands '
                'separator, or a number of digits other than three behind the decimal mark')
        if problems:
            raise InvalidInput(problems)
        return np.array(list(map(float, plain)))


def read_table(path: str | Path) -> Table:
    """Return the Table of a file; raises InvalidInput without a header, or naming each line of another length."""
    head = read_head(path)
    file = open_table(path, head)
    if file is None:
        raise InvalidInput(f'{path}: is no table; a line with the names of the columns must be above lines of '
                           'numbers, separated by commas, semicolons or tabs')
    layout, problems = file.layout, []
    numbers: list[int] = []
    columns: list[list[str]] = [[] for _ in layout.header]
    for block_numbers, cells in file.blocks(
            lambda number, fault: problems.append(f'{path}, line {number}: {fault}')):
        numbers += block_numbers.tolist()
        for column, texts in zip(columns, cells):
            column += texts
    if problems:
        raise InvalidInput(problems)
    above = first_lines(head, file.encoding)[:layout.header_line - 1]
    comments = tuple((number, text.strip('\ufeff"# \t,;')) for number, text in enumerate(above, start=1))
    return Table(path, layout.header, layout.units, tuple(map(tuple, columns)), numbers, layout.decimal,
                 layout.separator == ',', layout.header_line, comments)
