# SPDX-License-Identifier: Apache-2.0
"""CSV with one line an instant and one column a channel, as most loggers and spreadsheets write it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.logs.csv_lines import find_layout, is_blank, Layout, LEAST_NAMED, MOST_UNNAMED, split_line
from bev_preheat.logs.remarks import Remarks
from bev_preheat.logs.signal_map import SignalMap
from bev_preheat.logs.text_lines import encoding_of, line_blocks
from bev_preheat.logs.time_column import find_time_column, TimeColumn
from bev_preheat.logs.units import pint_unit, split_unit


class WideCsv:
    """An open CSV log; see RawLog."""

    format = 'CSV'
    place = 'line'

    def __init__(self, path: str | Path, head: bytes, layout: Layout) -> None:
        """Take the first bytes of the file and its Layout."""
        self._path, self._layout = path, layout
        self._encoding = encoding_of(head) or 'utf-8'
        self.decimal, self.absolute = layout.decimal, False
        self.channels = tuple(Channel(name, pint_unit(unit) or split_unit(name).unit)
                              for name, unit in zip(layout.header, layout.units))
        self._time: TimeColumn | None = None
        self._least, self._most = self._lengths()

    def _lengths(self) -> tuple[int, int]:
        """Return the smallest and largest number of cells that a line may have."""
        usual, named = self._layout.cells, len(self._layout.header)
        if usual > named and not (named >= LEAST_NAMED and usual - named <= MOST_UNNAMED):
            hint = '; with decimal commas, separate the columns by semicolons' if self._layout.separator == ',' else ''
            raise InvalidInput(f'{self._path}, line {self._layout.first}: has {usual} values; the header names '
                               f'{named} columns{hint}')
        return min(usual, named), max(usual, named)

    def use(self, signal_map: SignalMap) -> None:
        """Choose the column of the time; raises InvalidInput if there is none."""
        layout = self._layout
        self._time = find_time_column(layout.header, layout.units, layout.rows, layout.decimal, signal_map.time)
        if self._time is None:
            raise InvalidInput(f'{self._path}, line {layout.header_line}: no column holds the time; the columns are '
                               f'{quoted(", ".join(layout.header))}; name it (time_s) or give a signal map with time')
        self.absolute = self._time.clock.absolute

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted columns; see RawLog."""
        assert self._time is not None
        if self._time.clock.remark:
            remarks.add('clock', f'{self._path}: {self._time.clock.remark}')
        columns = {at: name for at, name in enumerate(self._layout.header) if name in wanted}
        for first, lines in line_blocks(self._path, self._encoding):
            numbers, rows = self._rows(first, lines, remarks)
            if not rows:
                continue
            cells = list(zip(*rows))
            time_s = self._time.clock.seconds(
                [' '.join(parts) for parts in zip(*(cells[at] for at in self._time.columns))])
            bad = ~np.isfinite(time_s)
            if bad.any():
                at = int(np.argmax(bad))
                remarks.add('time', f'{self._path}, line {numbers[at]}: '
                            f'{quoted(cells[self._time.columns[0]][at])} is not a time; the line is dropped',
                            int(bad.sum()), 'line')
            for column, name in columns.items():
                yield Piece(name, time_s, cells[column], numbers)

    def _rows(self, first: int, lines: Sequence[str], remarks: Remarks) -> tuple[np.ndarray, list[list[str]]]:
        """Return line numbers and cells of the lines of values, all of the header's length."""
        separator, named = self._layout.separator, len(self._layout.header)
        numbers, rows = [], []
        for number, line in enumerate(lines, start=first):
            if number < self._layout.first or is_blank(line):
                continue
            cells = split_line(line.partition('#')[0] if '#' in line and '"' not in line else line, separator)
            while len(cells) > self._most and not cells[-1]:
                cells.pop()
            if not self._least <= len(cells) <= self._most:
                # A line cut short at the end of the file, or two lines written into one.
                remarks.add('length', f'{self._path}, line {number}: has {len(cells)} values; the header names '
                            f'{named} columns; the line is dropped', noun='line')
                continue
            if tuple(cells[:named]) == self._layout.header:
                # Logs that were joined repeat their header.
                continue
            numbers.append(number)
            rows.append(cells[:named] if len(cells) >= named else cells + [''] * (named - len(cells)))
        return np.array(numbers, dtype=int), rows


def open_wide_csv(path: str | Path, head: bytes) -> WideCsv | None:
    """Return the open log if a file's first bytes are those of a table with a header, else None."""
    encoding = encoding_of(head)
    if encoding is None:
        return None
    layout = find_layout(_lines(head, encoding))
    return None if layout is None else WideCsv(path, head, layout)


def _lines(head: bytes, encoding: str) -> list[str]:
    lines = head.decode(encoding, 'replace').splitlines()
    # The last line may be cut.
    return lines[:-1] if len(head) >= 1 << 18 and len(lines) > 1 else lines
