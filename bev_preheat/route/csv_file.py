# SPDX-License-Identifier: Apache-2.0
"""Route CSV files: one row per segment, a header, `#` for comments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import csv
from dataclasses import dataclass, fields, replace
import io
from pathlib import Path
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.files.configuration import find_configuration
from bev_preheat.files.output_files import AnyPath, write_whole
from bev_preheat.route.columns import advice, alternatives, Column, doubled, power_columns, speed_columns
from bev_preheat.route.segments import LIMITS, make_route, problem_with_values, Route
from bev_preheat.route.sources.headers import is_column
from bev_preheat.route.sources.journey import ChargingStop
from bev_preheat.route.text_table import read_text_table, TextTable

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Defaults

# Length of a segment [m]; with the speed it gives the duration, and vice versa.
LENGTH = 'length_m'
LENGTH_RANGE_M = (0.0, 1e6)
COLUMNS = {
    'duration_s': Column('duration_s'),
    'duration_min': Column('duration_s', times=60.0),
    LENGTH: Column(LENGTH),
    'length_km': Column(LENGTH, times=1000.0),
    **speed_columns(),
    **power_columns('propulsion_power_w'),
    **power_columns('propulsion_power_rms_w'),
    'ambient_temperature_c': Column('ambient_temperature_c'),
    **power_columns('cabin_heating_power_w'),
    **power_columns('auxiliary_power_w'),
    **power_columns('propulsion_power_magnitude_w'),
}
# Units of the quantities that also accept other units.
UNITS = {'duration_s': 's', 'speed_mps': 'm/s', LENGTH: 'm'} | {
    name: 'W' for name in LIMITS if name.endswith('_w')}
MOTION = ('duration_s', 'speed_mps', LENGTH)
# The line above the header that names the vehicle of the route.
VEHICLE_COMMENT = re.compile(r'vehicle:\s*(.*)')
# Decimal places in a route file: micrometres per second, milliwatts. More would only
# show differences between machines.
DIGITS = 6
POWER_DIGITS = 3


# The lines above the header that name the charging stops.
STOP_COMMENT = re.compile(r'charging stop:\s*after segment ([0-9]{1,6}), ([0-9]{1,6}(?:\.[0-9]+)?) s')
STOP_RANGE_S = (1.0, 86400.0)


@dataclass(frozen=True)
class FileRoute:
    """
    The Route of a CSV file, and the name of the vehicle that its powers belong to (None: unknown).

    `stops` are its charging stops.
    """

    route: Route
    made_for: str | None
    stops: tuple[ChargingStop, ...] = ()


def load_route(name_or_file: str | Path, defaults: Defaults | None) -> Route:
    """
    Return the Route with a name (a file in config/routes) or of a CSV file.

    `defaults` are those of the vehicle, for missing columns. Raises InvalidInput naming
    file, line, column, value and allowed range.
    """
    return load_file_route(name_or_file, defaults).route


def load_file_route(name_or_file: str | Path, defaults: Defaults | None) -> FileRoute:
    """Return the FileRoute of a name or a CSV file; see `load_route`."""
    path = route_file(name_or_file)
    table = read_text_table(path, LIMITS, is_column)
    made_for = _vehicle_of(table)
    stops = _stops_of(table)
    columns, names = _columns(table)
    try:
        return FileRoute(make_route(columns, defaults, names), made_for, stops)
    except InvalidInput as error:
        raise InvalidInput([_with_line(problem, table, set(names.values()))
                            for problem in error.problems]) from error


def route_file(name_or_file: str | Path) -> Path:
    """Return the path of a route file; raise InvalidInput if it does not exist."""
    return find_configuration('routes', name_or_file, '.csv')


def save_route(path: AnyPath, route: Route, comments: Iterable[str] = (),
               made_for: str | None = None, stops: Iterable[ChargingStop] = ()) -> None:
    """
    Write a Route as CSV; `comments` are lines of text above the header.

    `made_for` is the name of the vehicle that the powers belong to, `stops` are the charging stops. Raises
    InvalidInput if
    the file cannot be written.
    """
    text = io.StringIO()
    for comment in comments:
        text.write(f'# {" ".join(comment.splitlines())}\n')
    if made_for is not None:
        text.write(f'# vehicle: {in_one_line(made_for)}\n')
    for stop in stops:
        # Counted from 1, as a reader counts the rows.
        text.write(f'# charging stop: after segment {stop.after_segment + 1}, {stop.duration_s:g} s\n')
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(LIMITS)
    for row in zip(*(getattr(route, name) for name in LIMITS)):
        # repr is exact; a trailing .0 is redundant.
        writer.writerow(repr(float(value)).removesuffix('.0') for value in row)
    write_whole(path, text.getvalue())


def rounded(route: Route) -> Route:
    """Return a Route rounded as `preheat route` writes it."""
    return replace(route, **{
        field.name: np.round(getattr(route, field.name),
                             POWER_DIGITS if field.name.endswith('_w') else DIGITS)
        for field in fields(route)})


def in_one_line(name: str) -> str:
    """Return the name of a vehicle in the form used in a comment."""
    return ' '.join(name.split())


def _vehicle_of(table: TextTable) -> str | None:
    """Return the name of the vehicle that the file's route was made for, None if it has none."""
    found: dict[str, int] = {}
    for number, comment in table.comments:
        # A spreadsheet appends separators to the line, and may quote it.
        match = VEHICLE_COMMENT.fullmatch(comment.rstrip('"\t ,;'))
        if match and match[1]:
            found.setdefault(in_one_line(match[1]), number)
    if len(found) > 1:
        (first, first_line), (second, second_line) = list(found.items())[:2]
        raise InvalidInput(f'{table.path}, line {second_line}: vehicle: {second!r}, but {first!r} '
                           f'in line {first_line}; a route has the powers of one vehicle')
    return next(iter(found), None)


def _stops_of(table: TextTable) -> tuple[ChargingStop, ...]:
    """Return the charging stops in the comments above the header; raise InvalidInput if one is impossible."""
    stops: list[ChargingStop] = []
    low_s, high_s = STOP_RANGE_S
    for number, comment in table.comments:
        match = STOP_COMMENT.fullmatch(comment.rstrip('"\t ,;'))
        if match is None:
            continue
        after, duration_s = int(match[1]), float(match[2])
        first = stops[-1].after_segment + 2 if stops else 1
        if not first <= after < len(table.rows):
            raise InvalidInput(f'{table.path}, line {number}: charging stop: after segment {after} is not '
                               f'allowed; it must be {first} ... {len(table.rows) - 1}, before the last segment')
        if not low_s <= duration_s <= high_s:
            raise InvalidInput(f'{table.path}, line {number}: charging stop: {duration_s:g} s is not allowed; it '
                               f'must be {low_s:g} ... {high_s:g} s')
        stops.append(ChargingStop(after - 1, duration_s))
    return tuple(stops)


def _columns(table: TextTable) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """Return the columns of Route in SI units, and their names in the file."""
    where = f'{table.path}, line {table.header_line}'
    unknown = [name for name in table.header if name not in COLUMNS]
    problems = [f'{where}: {advice(name, COLUMNS)}' for name in unknown]
    problems += [f'{where}: {problem}' for problem in doubled(table.header, COLUMNS)]
    by_quantity = {COLUMNS[name].quantity: name for name in table.header if name in COLUMNS}
    if not problems:
        problems += [f'{where}: {problem}' for problem in _missing(by_quantity)]
    if problems:
        raise InvalidInput(problems)
    if not table.rows:
        raise InvalidInput(f'{table.path}: has no segments')
    values = dict(zip(by_quantity, table.numbers(by_quantity.values())))
    for quantity, name in by_quantity.items():
        low, high = LIMITS.get(quantity, LENGTH_RANGE_M)
        column = COLUMNS[name]
        problem = problem_with_values(values[quantity], (column.own(low), column.own(high)))
        if problem:
            problems.append(_with_line(f'{name}{problem}', table, {name}))
    if problems:
        raise InvalidInput(problems)
    columns = {quantity: COLUMNS[name].si(values[quantity])
               for quantity, name in by_quantity.items()}
    names = {quantity: name if name == quantity else f'{name}, in {UNITS[quantity]}'
             for quantity, name in by_quantity.items()}
    if LENGTH in columns:
        _replace_length(columns, names, table, by_quantity)
    return columns, names


def _missing(by_quantity: dict[str, str]) -> Iterator[str]:
    """Yield sentences on missing columns, and on one column too many."""
    missing = [alternatives(name, COLUMNS)
               for name in ('propulsion_power_w', 'ambient_temperature_c')
               if name not in by_quantity]
    motion = [name for name in MOTION if name in by_quantity]
    if len(motion) == 3:
        yield ('duration, speed and length of a segment are given; one follows from the other '
               'two: leave one out')
    elif len(motion) < 2:
        missing = [*(alternatives(name, COLUMNS) for name in MOTION[:2] if name not in motion),
                   *missing]
    if missing:
        yield f'missing columns: {", ".join(missing)}'


def _replace_length(columns: dict[str, FloatArray], names: dict[str, str], table: TextTable,
                    by_quantity: dict[str, str]) -> None:
    """Replace the length by duration or speed, whichever is missing."""
    length_m = columns.pop(LENGTH)
    del names[LENGTH]
    length_name = by_quantity[LENGTH]
    if 'duration_s' in columns:
        columns['speed_mps'] = length_m / columns['duration_s']
        names['speed_mps'] = f'speed, in m/s, by {length_name}'
        return
    standing = columns['speed_mps'] == 0.0
    if standing.any():
        raise InvalidInput(
            f'{table.where(int(np.argmax(standing)))}: {by_quantity["speed_mps"]}: a segment in '
            f'which the car stands has no length; give duration_s instead of {by_quantity[LENGTH]}')
    columns['duration_s'] = length_m / columns['speed_mps']
    names['duration_s'] = f'duration, in s, by {length_name}'


def _with_line(problem: str, table: TextTable, names: set[str]) -> str:
    """Replace the segment in `column[segment]: …` by file and line."""
    name, bracket, rest = problem.partition('[')
    index, closed, tail = rest.partition(']')
    if bracket and closed and index.isdigit() and name in names:
        return f'{table.where(int(index))}: {name}{tail}'
    return f'{table.path}: {problem}'
