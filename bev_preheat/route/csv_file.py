# SPDX-License-Identifier: Apache-2.0
"""Route CSV files: one row per segment, a header, `#` for comments."""

from __future__ import annotations

from collections.abc import Iterable
import csv
from dataclasses import fields, replace
import io
from pathlib import Path
import re

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import find_configuration
from bev_preheat.files.output_files import AnyPath, write_whole
from bev_preheat.files.table import read_table, Table
from bev_preheat.numerics import FloatArray
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.route.sources.headers import column, headers_of
from bev_preheat.route.sources.journey import ChargingStop, STOP_RANGE_S
from bev_preheat.route.sources.table import motion_of_segments, stops_of_segments
from bev_preheat.vehicle.description import Defaults

# The line above the header that names the vehicle of the route.
VEHICLE_COMMENT = re.compile(r'vehicle:\s*(.*)')
# Decimal places in a route file: micrometres per second, milliwatts. More would only
# show differences between machines.
DIGITS = 6
POWER_DIGITS = 3


# The lines above the header that name the charging stops.
STOP_COMMENT = re.compile(r'charging stop:\s*after segment ([0-9]{1,6}), ([0-9]{1,6}(?:\.[0-9]+)?) s')


def load_route(name_or_file: str | Path, defaults: Defaults | None) -> Route:
    """Return the Route of a name in config/routes or of a CSV file; `defaults` fill missing columns."""
    route, _, _ = route_of_table(read_table(route_file(name_or_file)), defaults)
    return route


def route_of_table(table: Table, defaults: Defaults | None) -> tuple[Route, str | None, tuple[ChargingStop, ...]]:
    """Return the Route of a Table with powers, the vehicle that they belong to (None: unknown), and its stops."""
    made_for = _vehicle_of(table)
    columns, names, charged = _columns(table)
    if (stops := _stops_of(table)) and charged:
        raise InvalidInput(f'{table.path}: has charging stops above its header and in a column; keep only one')
    stops = stops or charged
    try:
        return make_route(columns, defaults, names), made_for, stops
    except InvalidInput as error:
        raise InvalidInput([_with_line(problem, table, set(names.values()))
                            for problem in error.problems]) from error


def route_file(name_or_file: str | Path) -> Path:
    """Return the path of a route file; raise InvalidInput if it does not exist."""
    return find_configuration('routes', name_or_file, '.csv')


def save_route(path: AnyPath, route: Route, comments: Iterable[str] = (),
               made_for: str | None = None, stops: Iterable[ChargingStop] = ()) -> None:
    """Write a Route made for a vehicle as CSV, `comments` above the header; raise InvalidInput on failure."""
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


def _vehicle_of(table: Table) -> str | None:
    """Return the name of the vehicle that the file's route was made for, None if it has none."""
    found: dict[str, int] = {}
    for number, comment in table.comments:
        # A spreadsheet appends separators to the line, and may quote it.
        match = VEHICLE_COMMENT.fullmatch(comment)
        if match and match[1]:
            found.setdefault(in_one_line(match[1]), number)
    if len(found) > 1:
        (first, first_line), (second, second_line) = list(found.items())[:2]
        raise InvalidInput(f'{table.path}, line {second_line}: vehicle: {second!r}, but {first!r} '
                           f'in line {first_line}; a route has the powers of one vehicle')
    return next(iter(found), None)


def _stops_of(table: Table) -> tuple[ChargingStop, ...]:
    """Return the charging stops in the comments above the header; raise InvalidInput if one is impossible."""
    stops: list[ChargingStop] = []
    low_s, high_s = STOP_RANGE_S
    for number, comment in table.comments:
        match = STOP_COMMENT.fullmatch(comment)
        if match is None:
            if comment.lower().startswith('charging stop:'):
                raise InvalidInput(f'{table.path}, line {number}: {comment!r} is not allowed; it must be such as '
                                   "'charging stop: after segment 3, 1200 s'")
            continue
        after, duration_s = int(match[1]), float(match[2])
        first = stops[-1].after_segment + 2 if stops else 1
        if not first <= after < len(table.lines):
            raise InvalidInput(f'{table.path}, line {number}: charging stop: after segment {after} is not '
                               f'allowed; it must be {first} ... {len(table.lines) - 1}, before the last segment')
        if not low_s <= duration_s <= high_s:
            raise InvalidInput(f'{table.path}, line {number}: charging stop: {duration_s:g} s is not allowed; it '
                               f'must be {low_s:g} ... {high_s:g} s')
        stops.append(ChargingStop(after - 1, duration_s))
    return tuple(stops)


def _columns(table: Table) -> tuple[dict[str, FloatArray], dict[str, str], tuple[ChargingStop, ...]]:
    """Return the columns of Route in SI units, their names in the file, and the stops of its charging times."""
    where = f'{table.path}, line {table.header_line}'
    headers, problems, unknown = headers_of(table)
    # A column that is not used, such as one with a misspelt name, would be replaced by a default.
    problems += unknown
    problems += [f'{where}: columns {headers["propulsion_power"].name!r} and {headers[name].name!r} both give the '
                 'drive; keep only one' for name in ('consumption', 'consumption_by_length')
                 if headers.keys() >= {'propulsion_power', name}]
    problems += [f'{where}: column {header.name!r}: if it holds values per segment, rename it to {instead}; '
                 'values cumulated from the start of the trip are not accepted' for quantity, instead in (
                     ('time', 'duration_s'), ('distance', 'length_m')) if (header := headers.get(quantity))]
    if 'speed' in headers or 'length' in headers:
        missing = [] if len(headers.keys() & {'duration', 'speed', 'length'}) > 1 else ['duration_s']
    else:
        missing = ['duration_s and speed_kmh'] if 'duration' not in headers else ['speed_kmh or length_km']
    missing += [f'{quantity}_{ending}' for quantity, ending in (('propulsion_power', 'kw'), (
        'ambient_temperature', 'c')) if quantity not in headers]
    if missing and not problems:
        problems.append(f'{where}: missing columns: {", ".join(missing)}')
    if problems:
        raise InvalidInput(problems)
    values = {quantity: column(table, header) for quantity, header in headers.items()}
    duration_s, speed_mps = motion_of_segments(table, headers, values)
    columns = {'duration_s': duration_s, 'speed_mps': speed_mps} | {
        name: values[quantity] for name in LIMITS if (quantity := name.rpartition('_')[0]) in values
        and quantity not in ('duration', 'speed')}
    names = {name: headers[quantity].name if (quantity := name.rpartition('_')[0]) in headers
             else f'{name} by {headers["length"].name}' for name in columns}
    return columns, names, stops_of_segments(table, headers, values)


def _with_line(problem: str, table: Table, names: set[str]) -> str:
    """Replace the segment in `column[segment]: …` by file and line."""
    name, bracket, rest = problem.partition('[')
    index, closed, tail = rest.partition(']')
    if bracket and closed and index.isdigit() and name in names:
        return f'{table.where(int(index))}: {name}{tail}'
    return f'{table.path}: {problem}'
