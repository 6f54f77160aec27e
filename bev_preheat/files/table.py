# SPDX-License-Identifier: Apache-2.0
"""Tables in text files of any layout: read in blocks of bounded size, or as a whole with every cell checked."""

from __future__ import annotations

import codecs
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
import csv
from dataclasses import dataclass
from pathlib import Path
import re

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.input_files import beginning_of, check_input
from bev_preheat.files.units import (
    AMBIGUOUS,
    ambiguous,
    decimal_mark,
    is_clear,
    NUMBER,
    read_numbers,
    split_unit,
    unit_named,
    why_no_number,
)
from bev_preheat.numerics import FloatArray, IntArray

HEAD_BYTES = 1 << 18
BLOCK_CHARACTERS = 1 << 20
# No logger writes a longer line.
LONGEST_LINE = 1 << 22
# The minus sign of Swedish, Norwegian and Finnish numbers.
MINUS = '\u2212'
# Characters that no text has.
NOT_TEXT = frozenset('\0\x01\x02\x03\x04\x05\x06\x07\x08\x0e\x0f')


def read_head(path: str | Path) -> bytes:
    """Return the first bytes of a file; raise InvalidInput if it cannot be read or is empty."""
    check_input(path)
    head = beginning_of(path, HEAD_BYTES)
    if not head.strip():
        raise InvalidInput(f'{path}: is empty')
    return head


def encoding_of(head: bytes) -> str | None:
    """Return the encoding of a text by its first bytes, None if they are no text."""
    if head[:2] in (b'\xff\xfe', b'\xfe\xff'):
        return 'utf-16'
    for encoding, at in (('utf-16-le', 1), ('utf-16-be', 0)):
        # Without a byte order mark every other byte of most texts is 0.
        if head[at:200:2].count(0) > 50 and not head[1 - at:200:2].count(0):
            return encoding
    try:
        # The end may cut a character.
        text = codecs.getincrementaldecoder('utf-8-sig')().decode(head, final=len(head) < HEAD_BYTES)
        encoding = 'utf-8-sig'
    except UnicodeDecodeError:
        text, encoding = head.decode('cp1252', 'replace'), 'cp1252'
    odd = sum(character in NOT_TEXT for character in text)
    return None if odd > 0.001 * len(text) else encoding


def first_lines(head: bytes, encoding: str) -> list[str]:
    """Return the lines in the first bytes of a text; the last one may be cut."""
    return re.split('\r\n|[\r\n]', head.decode(encoding, 'replace').replace(MINUS, '-'))


def line_blocks(path: str | Path, encoding: str) -> Iterator[tuple[int, list[str]]]:
    """Yield blocks of lines, ends cut, and the first one's number; refuse lines beyond LONGEST_LINE characters."""
    number, rest = 1, ''
    try:
        with open(path, encoding=encoding, errors='replace', newline=None) as file:
            while True:
                text = file.read(BLOCK_CHARACTERS).replace(MINUS, '-')
                lines = (rest + text).split('\n')
                rest = lines.pop() if text else ''
                if len(rest) > LONGEST_LINE:
                    raise InvalidInput(f'{path}, line {number + len(lines)}: has more than {LONGEST_LINE} '
                                       'characters; this is no log of lines')
                if lines:
                    yield number, lines
                number += len(lines)
                if not text:
                    return
    except (OSError, UnicodeError) as error:
        reason = getattr(error, 'strerror', None) or f'is not text ({encoding})'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error


SEPARATORS = ('\t', ';', ',', '|')
# Of columns whose names have a blank: Time (s)  Speed (mph).
SEVERAL_BLANKS = '  '
SEPARATOR_LINE = re.compile('"?sep=(.)?"?[;,\\t]*', re.IGNORECASE)
# Lines that determine the layout.
SAMPLE_LINES = 400
# Labels behind a name, as Prometheus and Grafana write them: battery_temp{car="id3"}.
LABELS = re.compile(r'\s*\{\w+ ?=.*\}$')
# LeafSpy's later versions write a few values more than its header names.
MOST_UNNAMED, LEAST_NAMED = 8, 20
LEAST_ALIKE = 10


@dataclass(frozen=True)
class Layout:
    """
    Layout of a table: separator, names of the columns and their units, number of the header's line.

    The separator is None for blanks, and two blanks for at least two. `units` are those of a line of units below
    the header, else those in the names, '' if unknown. `first` is the number of the first line of values, `rows`
    are cells of the first ones, `cells` is the usual number of cells in a line.
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
        # Time (s) is a single name.
        return re.sub(r'(?<=\S)\s+(?=[(\[])', '', line).split()
    if separator == SEVERAL_BLANKS:
        return re.split(r'\s{2,}', line.strip())
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    except (csv.Error, StopIteration):
        return [cell.strip(' "') for cell in line.split(separator)]


def is_blank(line: str) -> bool:
    """Return whether a line has no cell, or is a comment."""
    return line.lstrip(' "').startswith('#') or not line.strip(' \t"\r,;|')


def find_layout(lines: Sequence[str]) -> Layout | None:
    """Return the Layout of a file that begins with these lines, None if it is no table with a header."""
    numbered = [(number, line.lstrip('\ufeff')) for number, line in enumerate(lines[:SAMPLE_LINES], start=1)]
    wanted = [(number, line) for number, line in numbered if not is_blank(line)]
    separators: tuple[str | None, ...] = (*SEPARATORS, SEVERAL_BLANKS, None)
    if wanted and (match := SEPARATOR_LINE.fullmatch(wanted[0][1].strip())):
        separators, wanted = (match[1] or ',',), wanted[1:]
    # NumPy writes the names as a comment.
    named = [(number, line.lstrip('# ')) for number, line in numbered[:wanted[0][0] - 1 if wanted else 0][-1:]]
    for each in (wanted, named + wanted):
        found = [layout for separator in separators if (layout := _layout(each, separator)) is not None]
        if found and found[0].separator == SEPARATORS[0]:
            # Blanks are then between words, or between date and time.
            found = [layout for layout in found if layout.separator in SEPARATORS]
        if found:
            # The separator that leaves most cells with values: 1,5;2,5 are two numbers, 2026-01-01 10:00 one time.
            return max(found, key=lambda layout: sum(_is_value(cell) for row in layout.rows[:50] for cell in row))
    return None


def _layout(lines: Sequence[tuple[int, str]], separator: str | None) -> Layout | None:
    rows = [(number, split_line(_without_comment(line), separator)) for number, line in lines]
    above_values, first = None, None
    for at in range(len(rows) - 1):
        layout = _with_header(rows, at, separator)
        # A title may have as many cells as the header, which is just above the values.
        if layout is not None and any(map(_is_value, layout.rows[0])):
            if len(layout.header) == layout.cells:
                return layout
            above_values = above_values or layout
        first = first or layout
    return above_values or first


def _with_header(rows: Sequence[tuple[int, list[str]]], at: int, separator: str | None) -> Layout | None:
    """Return the Layout with the header in a row; None if the row has no names or no values below."""
    number, cells = rows[at][0], [LABELS.sub('', cell) for cell in _trimmed(list(rows[at][1]), 0)]
    if 2 * sum(map(_is_value, cells)) > len(cells) or not _are_names(cells):
        return None
    # Columns of a row may be empty; empty cells beyond the header's do not count.
    following = [(line, _trimmed(list(row), len(cells))) for line, row in rows[at + 1:]]
    units = [split_unit(name).unit for name in cells]
    if len(following) > 1 and _are_units(following[0][1]):
        for column, text in enumerate(following[0][1][:len(cells)]):
            units[column] = unit_named(text.strip('[]() ')) or units[column]
        following = following[1:]
    # A header is followed by lines of as many cells, some with values.
    usual = Counter(len(row) for _, row in following).most_common(1)[0][0]
    near = usual >= 2 and abs(usual - len(cells)) <= max(MOST_UNNAMED, len(cells) // 2)
    # Between blanks no cell is empty, so that the header has names of several words.
    near = near and (separator is not None or usual == len(cells))
    if not near or not any(_is_value(cell) for _, row in following[:50] for cell in row):
        return None
    body = tuple(tuple(row) for _, row in following)
    # Between commas a quoted 2,200 is not clear, and 7,5 has a decimal comma.
    decimal = decimal_mark(cell for row in body for cell in row
                           if separator != ',' or not AMBIGUOUS.fullmatch(cell))
    # A number distinguishes columns of the same name.
    seen: Counter[str] = Counter()
    header = []
    for name in cells:
        seen[name] += 1
        header.append(name if seen[name] == 1 else f'{name} #{seen[name]}')
    return Layout(separator, tuple(header), number, tuple(units), following[0][0], body, usual, decimal)


def _without_comment(line: str) -> str:
    return line.partition('#')[0] if '#' in line and '"' not in line else line


def _trimmed(cells: list[str], least: int) -> list[str]:
    while len(cells) > least and not cells[-1]:
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
    known = sum(bool(unit_named(cell)) for cell in given)
    return bool(given) and not any(map(_is_value, given)) and 2 * known >= len(given)


class TableFile:
    """The rows of a text file below the header of its Layout."""

    def __init__(self, path: str | Path, encoding: str, layout: Layout) -> None:
        """Take the file's encoding and Layout; raises InvalidInput if its lines do not fit its header."""
        self.path, self.layout, self.encoding = path, layout, encoding
        usual, named = layout.cells, len(layout.header)
        # Rows may end early, but not all alike.
        too_few = usual < named and len(layout.rows) >= LEAST_ALIKE and len(set(map(len, layout.rows))) == 1
        if too_few or (usual > named and not (named >= LEAST_NAMED and usual - named <= MOST_UNNAMED)):
            hint = '; with decimal commas, separate the columns by semicolons' if (
                layout.separator == ',' and not too_few) else ''
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
        header, names = list(layout.header), frozenset(layout.header)
        numbers, rows = [], []
        for number, line in enumerate(lines, start=first):
            if number < layout.first or is_blank(line):
                continue
            cells = split_line(_without_comment(line), layout.separator)
            while len(cells) > self._most and not cells[-1]:
                cells.pop()
            if not self._least <= len(cells) <= self._most:
                # A line cut short at the end of the file, or two lines written into one.
                drop(number, f'has {len(cells)} values; the header names {named} columns')
                continue
            cells = cells[:named] if len(cells) >= named else cells + [''] * (named - len(cells))
            # Logs that were joined repeat their header.
            if cells != header:
                if cells[0] in names and len(names & {*cells}) > 1 and not any(map(_is_value, cells)):
                    raise InvalidInput(f'{self.path}, line {number}: names other columns than line '
                                       f'{layout.header_line}; split the file there')
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
        # Beside decimal commas a point is between thousands.
        plain = [text.replace('.', '_').replace(',', '.') for text in texts] if self.decimal == ',' else texts
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
