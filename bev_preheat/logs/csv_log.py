# SPDX-License-Identifier: Apache-2.0
"""Logs of rows of texts: a column a channel, or a reading a row (time, name, value and unit); CSV files."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
import re
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table import open_table, TableFile
from bev_preheat.files.units import split_unit, unit_named
from bev_preheat.logs.choice import find_time_column, TimeColumn
from bev_preheat.logs.raw_log import Channel, Piece, RawLog, Remarks

if TYPE_CHECKING:
    from bev_preheat.logs.json_lines import JsonRows
    from bev_preheat.logs.signal_map import SignalMap
    from bev_preheat.numerics import FloatArray, IntArray

# Headings of the columns with names, values and units of readings.
NAME = re.compile(r'^(pid|name|series|parameter( ?name)?|sensor( ?name)?|signal( ?name)?|channel|kanal|metric|key|'
                  r'topic|path|item|variable|entity_id|messgröße|параметр|датчик|参数|名称)$', re.IGNORECASE)
# InfluxDB's own columns; Home Assistant writes the unit as the measurement.
INFLUX_NAME, MEASUREMENT = re.compile('_field'), re.compile('_measurement')
VALUE = re.compile(r'^(_?value|val|wert|messwert|reading|state|data|payload|значение|valor|valeur|数值|值)$',
                   re.IGNORECASE)
UNIT = re.compile(r'^(.*\.)?(units?|einheit(en)?|uom|unidad(es)?|unités?|единицы|единица|单位|'
                  r'unit_of_measurement)$', re.IGNORECASE)
OWN = re.compile(r'^(lat(itude)?|lon(g|gt?itude)?|vin|(car|veh(icle)?)[ _]?(id|no|nr|num(ber)?|name)?)$',
                 re.IGNORECASE)
TIME_NAME = re.compile(r'time|zeit|dat(e|um)', re.IGNORECASE)
# More channels are texts, not names.
MOST_CHANNELS = 5000


class Roles(NamedTuple):
    """Numbers of the columns with name, value and unit of a reading; `unit` is None without one."""

    name: int
    value: int
    unit: int | None


def roles_of(names: Sequence[str]) -> Roles | None:
    """Return the Roles of columns with these names, None if a row has a reading of each column."""
    def column(pattern: re.Pattern[str]) -> int | None:
        return next((at for at, heading in enumerate(names) if pattern.match(heading)), None)

    name, value, unit = column(NAME), column(VALUE), column(UNIT)
    if name is None:
        name = column(INFLUX_NAME)
    elif unit is None:
        unit = column(MEASUREMENT)
    return None if name is None or value is None else Roles(name, value, unit)


class TextLog(RawLog):
    """An open log of rows; see RawLog. With `Roles` a row has a single reading, else a reading of each channel."""

    def __init__(self, table: TableFile | JsonRows, roles: Roles | None, kind: str = 'CSV', column: str = 'column',
                 place: str = 'line') -> None:
        """Take the rows, the file's kind, its words for column and row; with Roles, read the channels' names."""
        self._table, self._roles, self._column, self.place = table, roles, column, place
        layout = table.layout
        self.format = kind if roles is None else f'{kind}, one reading a {place}'
        self.decimal, self.absolute = layout.decimal, False
        # Columns that are channels: of a log of readings those of the coordinates and of the car.
        self._columns = {at: name for at, name in enumerate(layout.header) if roles is None or OWN.match(name)}
        named = {} if roles is None else self._named(roles)
        self.channels = (*(Channel(name, unit) for name, unit in named.items()),
                         *(Channel(name, layout.units[at]) for at, name in self._columns.items()))
        self._time: TimeColumn | None = None

    def _named(self, roles: Roles) -> dict[str, str]:
        """Return the units of the channels in a log of readings, by name."""
        found: dict[str, str] = {}
        for _, cells in self._table.blocks(lambda *_: None):
            units = cells[roles.unit] if roles.unit is not None else ('',) * len(cells[roles.name])
            for channel, text in dict.fromkeys(zip(cells[roles.name], units)):
                if channel and not found.get(channel):
                    found[channel] = unit_named(text) or split_unit(channel).unit
            if len(found) > MOST_CHANNELS:
                name = self._table.layout.header[roles.name]
                raise InvalidInput(f'{self._table.path}: the column {name} has more than {MOST_CHANNELS} names; '
                                   'it holds no names of channels')
        return found

    def use(self, signal_map: SignalMap) -> None:
        """Choose the column of the time; raises InvalidInput if no column is a time."""
        layout = self._table.layout
        self._time = find_time_column(layout.header, layout.units, layout.rows, layout.decimal, signal_map)
        if self._time is None:
            where = f', line {layout.header_line}' if layout.header_line else ''
            shown = next((f'; {name}: {quoted(layout.rows[0][at])} is not read as one; write 2026-01-31T08:00:00'
                          for at, name in enumerate(layout.header[:len(layout.rows[0])])
                          if TIME_NAME.search(name)), '')
            raise InvalidInput(f'{self._table.path}{where}: no {self._column} holds the time; the {self._column}s '
                               f'are {quoted(", ".join(layout.header))}{shown}; name it (time_s) or give a signal '
                               'map with time')
        self.absolute = self._time.clock.absolute
        self.times = tuple(layout.header[at] for at in self._time.columns)

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels; see RawLog."""
        assert self._time is not None
        path, time = self._table.path, self._time
        if time.clock.remark:
            remarks.add('clock', f'{path}: {time.clock.remark}')

        def drop(number: int, fault: str) -> None:
            remarks.add('length', f'{path}, {self.place} {number}: {fault}; the {self.place} is dropped',
                        noun=self.place)

        for numbers, cells in self._table.blocks(drop):
            time_s = time.clock.seconds([' '.join(parts) for parts in zip(*(cells[at] for at in time.columns))])
            bad = ~np.isfinite(time_s)
            if bad.any():
                at = int(np.argmax(bad))
                remarks.add('time', f'{path}, {self.place} {numbers[at]}: {quoted(cells[time.columns[0]][at])} '
                            f'is not a time; the {self.place} is dropped', int(bad.sum()), self.place)
            yield from self._of_columns(wanted, time_s, cells, numbers)
            if self._roles is not None:
                yield from self._of_readings(self._roles, wanted, time_s, cells, numbers)

    def _of_columns(self, wanted: Collection[str], time_s: FloatArray, cells: list[tuple[str, ...]],
                    numbers: IntArray) -> Iterator[Piece]:
        # Many lines of readings repeat a position.
        first = None if self._roles is None else np.unique(time_s, return_index=True)[1]
        for column, name in self._columns.items():
            if name not in wanted:
                continue
            values = cells[column]
            rows = first if first is not None else [at for at, value in enumerate(values) if value] \
                if '' in values else None
            if rows is None:
                yield Piece(name, time_s, values, numbers)
            elif len(rows):
                yield Piece(name, time_s[rows], [values[at] for at in rows], numbers[rows])

    def _of_readings(self, roles: Roles, wanted: Collection[str], time_s: FloatArray, cells: list[tuple[str, ...]],
                     numbers: IntArray) -> Iterator[Piece]:
        members: dict[str, list[int]] = {name: [] for name in wanted}
        for at, name in enumerate(cells[roles.name]):
            if name in members:
                members[name].append(at)
        units = {channel.name: channel.unit for channel in self.channels}
        for name, rows in members.items():
            if rows:
                texts = [cells[roles.value][at] for at in rows]
                if roles.unit is not None:
                    # A reading may have a unit of its own.
                    texts = [text if unit_named(unit) in ('', units[name]) else f'{text} {unit}'
                             for text, unit in zip(texts, (cells[roles.unit][at] for at in rows))]
                yield Piece(name, time_s[rows], texts, numbers[rows])


def open_csv_log(path: str | Path, head: bytes, _: Collection[str | Path] = ()) -> TextLog | None:
    """Return the open log if a file's first bytes are those of a table with a header, else None."""
    table = open_table(path, head)
    return None if table is None else TextLog(table, roles_of(table.layout.header))
