# SPDX-License-Identifier: Apache-2.0
"""CSV with one line a reading: time, name of the channel, value and unit, as apps for OBD adapters export it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.logs.channels import Channel, Piece
from bev_preheat.logs.csv_rows import CsvRows, open_rows
from bev_preheat.logs.time_column import TimeColumn
from bev_preheat.logs.units import pint_unit, split_unit
from bev_preheat.logs.wide_csv import time_of

if TYPE_CHECKING:
    from bev_preheat.logs.remarks import Remarks
    from bev_preheat.logs.signal_map import SignalMap

# Headings of the columns with names, values and units.
NAME = re.compile(r'^(pid|name|parameter( ?name)?|sensor( ?name)?|signal( ?name)?|channel|kanal|metric|key|topic|'
                  r'path|item|variable|entity_id|messgröße|параметр|датчик|参数|名称)$', re.IGNORECASE)
# InfluxDB's own columns; Home Assistant writes the unit as the measurement.
INFLUX_NAME, MEASUREMENT = re.compile('_field'), re.compile('_measurement')
VALUE = re.compile(r'^(_?value|val|wert|messwert|reading|state|data|payload|значение|valor|valeur|数值|值)$',
                   re.IGNORECASE)
UNIT = re.compile(r'^(units?|einheit(en)?|uom|unidad(es)?|unités?|единицы|единица|单位|unit_of_measurement)$',
                  re.IGNORECASE)
OWN = re.compile(r'^(lat(itude)?|lon(g|gt?itude)?|vin|(car|veh(icle)?)[ _]?(id|no|nr|num(ber)?|name)?)$',
                 re.IGNORECASE)
# More channels are texts, not names.
MOST_LONG_CHANNELS = 5000


class LongCsv:
    """An open CSV log with a reading a line; see RawLog."""

    format = 'CSV, one reading a line'
    place = 'line'
    times: tuple[str, ...] = ()

    def __init__(self, rows: CsvRows, name: int, value: int, unit: int | None) -> None:
        """Take the numbers of the columns with name, value and unit; reads the file once for the channels."""
        self._rows, self._name, self._value = rows, name, value
        self.decimal, self.absolute = rows.layout.decimal, False
        self._time: TimeColumn | None = None
        # Coordinates and the car have columns of their own.
        self._own = {at: heading for at, heading in enumerate(rows.layout.header) if OWN.match(heading)}
        found: dict[str, str] = {}
        for _, cells in rows.cells():
            units: Sequence[str] = cells[unit] if unit is not None else ('',) * len(cells[name])
            for channel, text in dict.fromkeys(zip(cells[name], units)):
                if channel and not found.get(channel):
                    found[channel] = pint_unit(text) or split_unit(channel).unit
            if len(found) > MOST_LONG_CHANNELS:
                raise InvalidInput(f'{rows.path}: the column {rows.layout.header[name]} has more than '
                                   f'{MOST_LONG_CHANNELS} '
                                   'names; it holds no names of channels')
        self.channels = (*(Channel(*item) for item in found.items()),
                         *(Channel(heading) for heading in self._own.values()))

    def use(self, signal_map: SignalMap) -> None:
        """Choose the column of the time; raises InvalidInput if no column is a time."""
        self._time = time_of(self._rows, signal_map)
        self.absolute = self._time.clock.absolute

    def pieces(self, wanted: Collection[str], remarks: Remarks) -> Iterator[Piece]:
        """Yield the Pieces of the wanted channels; see RawLog."""
        assert self._time is not None
        for block in self._rows.blocks(self._time, remarks):
            members: dict[str, list[int]] = {name: [] for name in wanted}
            for at, name in enumerate(block.cells[self._name]):
                if name in members:
                    members[name].append(at)
            values = block.cells[self._value]
            for name, at_rows in members.items():
                if at_rows:
                    index = np.array(at_rows)
                    yield Piece(name, block.time_s[index], [values[at] for at in at_rows], block.numbers[index])
            for column, heading in self._own.items():
                if heading in wanted:
                    # Many lines repeat a position.
                    first = np.unique(block.time_s, return_index=True)[1]
                    yield Piece(heading, block.time_s[first], [block.cells[column][at] for at in first],
                                block.numbers[first])


def open_long_csv(path: str | Path, head: bytes) -> LongCsv | None:
    """Return the open log if a file's first bytes are those of a table of names and values, else None."""
    rows = open_rows(path, head)
    if rows is None:
        return None
    header = rows.layout.header

    def column(pattern: re.Pattern[str]) -> int | None:
        return next((at for at, heading in enumerate(header) if pattern.match(heading)), None)

    name, value, unit = column(NAME), column(VALUE), column(UNIT)
    if name is None:
        name = column(INFLUX_NAME)
    elif unit is None:
        unit = column(MEASUREMENT)
    return None if name is None or value is None else LongCsv(rows, name, value, unit)
