# SPDX-License-Identifier: Apache-2.0
"""Rows of a CSV file with a known layout, in blocks of bounded size."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.logs.csv_lines import find_layout, is_blank, Layout, LEAST_NAMED, MOST_UNNAMED, split_line
from bev_preheat.logs.text_lines import encoding_of, HEAD_BYTES, line_blocks
from bev_preheat.logs.time_column import TimeColumn

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.numerics.arrays import FloatArray, IntArray


class Block(NamedTuple):
    """Successive rows: times [s] (NaN: none), cells by column, numbers of the lines."""

    time_s: FloatArray
    cells: list[tuple[str, ...]]
    numbers: IntArray


class CsvRows:
    """The rows of a CSV file below its header."""

    def __init__(self, path: str | Path, encoding: str, layout: Layout) -> None:
        """Take the file's encoding and Layout; raises InvalidInput if its lines do not fit its header."""
        self.path, self.layout, self._encoding = path, layout, encoding
        usual, named = layout.cells, len(layout.header)
        if usual > named and not (named >= LEAST_NAMED and usual - named <= MOST_UNNAMED):
            hint = '; with decimal commas, separate the columns by semicolons' if layout.separator == ',' else ''
            raise InvalidInput(f'{path}, line {layout.first}: has {usual} values; the header names '
                               f'{named} columns{hint}')
        self._least, self._most = min(usual, named), max(usual, named)

    def blocks(self, time: TimeColumn, remarks: Remarks) -> Iterator[Block]:
        """Yield the rows; remark on lines of another length and on those without a time."""
        if time.clock.remark:
            remarks.add('clock', f'{self.path}: {time.clock.remark}')
        for numbers, cells in self.cells(remarks):
            time_s = time.clock.seconds([' '.join(parts) for parts in zip(*(cells[at] for at in time.columns))])
            bad = ~np.isfinite(time_s)
            if bad.any():
                at = int(np.argmax(bad))
                remarks.add('time', f'{self.path}, line {numbers[at]}: '
                            f'{quoted(cells[time.columns[0]][at])} is not a time; the line is dropped',
                            int(bad.sum()), 'line')
            yield Block(time_s, cells, numbers)

    def cells(self, remarks: Remarks | None = None) -> Iterator[tuple[IntArray, list[tuple[str, ...]]]]:
        """Yield numbers of lines, and the cells of each column."""
        for first, lines in line_blocks(self.path, self._encoding):
            numbers, rows = self._rows(first, lines, remarks)
            if rows:
                yield np.array(numbers, dtype=int), list(zip(*rows))

    def _rows(self, first: int, lines: Sequence[str],
              remarks: Remarks | None) -> tuple[list[int], list[list[str]]]:
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
                if remarks is not None:
                    remarks.add('length', f'{self.path}, line {number}: has {len(cells)} values; the header names '
                                f'{named} columns; the line is dropped', noun='line')
                continue
            cells = cells[:named] if len(cells) >= named else cells + [''] * (named - len(cells))
            # Logs that were joined repeat their header.
            if cells != header:
                numbers.append(number)
                rows.append(cells)
        return numbers, rows


def open_rows(path: str | Path, head: bytes) -> CsvRows | None:
    """Return the rows of a file if its first bytes are those of a table with a header, else None."""
    encoding = encoding_of(head)
    if encoding is None:
        return None
    lines = head.decode(encoding, 'replace').splitlines()
    # The last line may be cut.
    layout = find_layout(lines[:-1] if len(head) >= HEAD_BYTES and len(lines) > 1 else lines)
    return None if layout is None else CsvRows(path, encoding, layout)
