# SPDX-License-Identifier: Apache-2.0
"""Route CSV files: one row a segment, a header, `#` for comments."""

import csv
import io

from bev_preheat.configuration import find_configuration
from bev_preheat.errors import InvalidInput
from bev_preheat.output_files import write_whole
from bev_preheat.route.segments import LIMITS, make_route

OPTIONAL_COLUMNS = ('propulsion_power_rms_w', 'cabin_heating_power_w', 'auxiliary_power_w')


def load_route(name_or_file, defaults):
    """
    Return the Route of a name (a file in config/routes) or of a CSV file.

    `defaults` are those of the vehicle, for columns that are missing. Raises InvalidInput naming
    file, line, column, value and what is allowed.
    """
    path = route_file(name_or_file)
    header, rows, line_numbers = _read(path)
    columns = {name: [] for name in header}
    problems = []
    for row, line in zip(rows, line_numbers):
        if len(row) != len(header):
            problems.append(f'{path}, line {line}: has {len(row)} values; the header names '
                            f'{len(header)} columns')
            continue
        for name, text in zip(header, row):
            try:
                columns[name].append(float(text))
            except ValueError:
                problems.append(f'{path}, line {line}: {name}: {text.strip()!r} is not a number')
    if problems:
        raise InvalidInput(problems)
    if not rows:
        raise InvalidInput(f'{path}: has no segments')
    try:
        return make_route(columns, defaults)
    except InvalidInput as error:
        raise InvalidInput([f'{path}{_with_line(problem, line_numbers)}'
                            for problem in error.problems]) from error


def route_file(name_or_file):
    """Return the path of a route file; raise InvalidInput where there is none."""
    return find_configuration('routes', name_or_file, '.csv')


def save_route(path, route, comments=()):
    """
    Write a Route as CSV; `comments` are lines of text above the header.

    Raises InvalidInput where it cannot be written.
    """
    text = io.StringIO()
    for comment in comments:
        text.write(f'# {comment}\n')
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(LIMITS)
    for row in zip(*(getattr(route, name) for name in LIMITS)):
        # repr keeps every bit; a trailing .0 says nothing.
        writer.writerow(repr(float(value)).removesuffix('.0') for value in row)
    write_whole(path, text.getvalue())


def _read(path):
    """Header, rows as texts, and the line each row stands in."""
    rows, line_numbers = [], []
    try:
        with open(path, encoding='utf-8-sig', newline='') as file:
            for number, line in enumerate(file, start=1):
                text = line.split('#', 1)[0].strip()
                if text:
                    rows.append(next(csv.reader([text])))
                    line_numbers.append(number)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'is not UTF-8 text'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error
    if not rows:
        raise InvalidInput(f'{path}: is empty; its first line must name the columns: '
                           f'{", ".join(LIMITS)}')
    header = [name.strip() for name in rows[0]]
    unknown = [name for name in header if name not in LIMITS]
    missing = [name for name in LIMITS if name not in header and name not in OPTIONAL_COLUMNS]
    problems = []
    if unknown:
        problems.append(f'{path}, line {line_numbers[0]}: unknown columns: {", ".join(unknown)}; '
                        f'known: {", ".join(LIMITS)}')
    if missing:
        problems.append(f'{path}, line {line_numbers[0]}: missing columns: {", ".join(missing)}')
    doubled = sorted({name for name in header if header.count(name) > 1})
    if doubled:
        problems.append(f'{path}, line {line_numbers[0]}: columns named twice: '
                        f'{", ".join(doubled)}')
    if problems:
        raise InvalidInput(problems)
    return header, rows[1:], line_numbers[1:]


def _with_line(problem, line_numbers):
    """Say the line of the file in place of the segment in `column[segment]: …`."""
    name, bracket, rest = problem.partition('[')
    index, closed, tail = rest.partition(']')
    if bracket and closed and index.isdigit() and name in LIMITS:
        return f', line {line_numbers[int(index)]}: {name}{tail}'
    return f': {problem}'
