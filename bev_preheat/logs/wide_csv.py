# SPDX-License-Identifier: Apache-2.0
"""CSV with one line an instant and one column a channel, as most loggers and spreadsheets write it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.logs.csv_rows import CsvRows, open_rows
from bev_preheat.logs.time_column import find_time_column, TimeColumn
from bev_preheat.logs.units import pint_unit, split_unit

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap


class WideCsv:
    """An open CSV log; see RawLog."""

    format = 'CSV'
    place = 'line'
    times: tuple[str, ...] = ()

    def __init__(self, rows: CsvRows) -> None:
        """Take the rows of the file."""
        self._rows = rows
        layout = rows.layout
        self.decimal, self.absolute = layout.decimal, False
        self.channels = tuple(Channel(name, pint_unit(unit) or split_unit(name).unit)
                              for name, unit in zip(layout.header, layout.units))
        self._time: TimeColumn | None = None

    def use(self, signal_map: SignalMap) -> None:
        """Choose the column of the time; raises InvalidInput if no column is a time."""
        self._time = time_of(self._rows, signal_map)
        self.absolute = self._time.clock.absolute
        self.times = tuple(self._rows.layout.header[at] for at in self._time.columns)

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted columns; see RawLog."""
        assert self._time is not None
        columns = {at: name for at, name in enumerate(self._rows.layout.header) if name in wanted}
        for block in self._rows.blocks(self._time, remarks):
            for column, name in columns.items():
                yield Piece(name, block.time_s, block.cells[column], block.numbers)


def time_of(rows: CsvRows, signal_map: SignalMap) -> TimeColumn:
    """Return the TimeColumn of a table; raises InvalidInput if it has none."""
    layout = rows.layout
    found = find_time_column(layout.header, layout.units, layout.rows, layout.decimal, signal_map)
    if found is None:
        raise InvalidInput(f'{rows.path}, line {layout.header_line}: no column holds the time; the columns are '
                           f'{quoted(", ".join(layout.header))}; name it (time_s) or give a signal map with time')
    return found


def open_wide_csv(path: str | Path, head: bytes) -> WideCsv | None:
    """Return the open log if a file's first bytes are those of a table with a header, else None."""
    rows = open_rows(path, head)
    return None if rows is None else WideCsv(rows)
