# SPDX-License-Identifier: Apache-2.0
"""
Reads tables of numbers from programs and spreadsheets: a header, then one line per row.

Commas, semicolons or tabs separate the columns; commas that do not may be decimal commas.
`#` starts a comment, and lines above the header are comments, too. Ambiguous numbers are refused, because an
error by a factor of a thousand gives a wrong trip.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
import csv
from dataclasses import dataclass
from pathlib import Path
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.logs.cell_numbers import PLAIN_CHARACTERS

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

SEPARATORS = {',': 'commas', ';': 'semicolons', '\t': 'tabs'}
NUMBER = re.compile(r'[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?')
# The first line of numbers, and how many lines may lie above it.
BEGINS_WITH_NUMBER = re.compile('["\\s]*[+-]?[.,]?[0-9]')
MOST_TITLE_LINES = 20
NOT_FINITE = re.compile(r'[+-]?(nan|inf|infinity)', re.IGNORECASE)
# A spreadsheet's line that names the separator; the header shows it too.
SEPARATOR_LINE = re.compile('"?sep=.?"?', re.IGNORECASE)
# 1.500 and 1,500 are ambiguous: one and a half or fifteen hundred.
AMBIGUOUS = re.compile(r'[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}')
GROUPED = re.compile(r"([+-]?[0-9]{1,3})((?:[ \u00a0\u202f\u2009'’.,][0-9]{3})+)([.,][0-9]+)?")


@dataclass(frozen=True)
class TextTable:
    """Cells of a table as texts: `rows` below `header`, and the line number of each."""

    path: str | Path
    separator: str
    header: list[str]
    header_line: int
    rows: list[list[str]]
    lines: list[int]
    comments: list[tuple[int, str]]

    def where(self, row: int) -> str:
        """Return a row's place for messages: file and line."""
        return f'{self.path}, line {self.lines[row]}'

    def numbers(self, names: Collection[str], empty_is_nan: bool = False) -> list[FloatArray]:
        """
        Return the numbers of the named columns: a list of arrays, each of shape (N,).

        Raises InvalidInput naming line, column and text of each cell that is not a number.
        """
        places = [self.header.index(name) for name in names]
        columns = [[row[place] for row in self.rows] for place in places]
        decimal_comma = self._decimal_mark(names, columns) == ','
        problems: list[str] = []
        arrays = []
        for name, texts in zip(names, columns):
            arrays.append(self._numbers(name, texts, decimal_comma, empty_is_nan, problems))
        if problems:
            raise InvalidInput(problems)
        return arrays

    def _numbers(self, name: str, texts: list[str], decimal_comma: bool, empty_is_nan: bool,
                 problems: list[str]) -> FloatArray:
        if decimal_comma:
            read = [text.replace(',', '.') for text in texts]
        else:
            read = texts
        if all(map(PLAIN_CHARACTERS.issuperset, read)):
            try:
                return np.array(list(map(float, read)))
            except ValueError:
                # Some cell is not a number; it is found below.
                pass
        values = np.full(len(texts), np.nan)
        for at, (text, number) in enumerate(zip(texts, read)):
            # float() accepts more than numbers as people write them: 1_500, digits of other scripts.
            if NUMBER.fullmatch(number) or NOT_FINITE.fullmatch(number):
                values[at] = float(number)
            elif number or not empty_is_nan:
                problems.append(f'{self.where(at)}: {name}: {self._why_no_number(text)}')
        return values

    def _why_no_number(self, text: str) -> str:
        grouped = GROUPED.fullmatch(text)
        if grouped and not (self.separator == ',' and AMBIGUOUS.fullmatch(text)):
            whole = ''.join(re.findall('[0-9+-]', grouped[1] + grouped[2]))
            return f'{quoted(text)} has a thousands separator; write {whole}{grouped[3] or ""}'
        if self.separator == ',' and ',' in text:
            return (f'{quoted(text)} has a comma; with decimal commas, separate the columns by '
                    'semicolons')
        return f'{quoted(text)} is not a number'

    def _decimal_mark(self, names: Collection[str], columns: list[list[str]]) -> str:
        """Return the decimal mark of the numbers, comma or point; raise InvalidInput if it is ambiguous."""
        if self.separator == ',':
            return '.'
        marked = {}
        for mark in ',.':
            cells = [(name, at, text) for name, texts in zip(names, columns)
                     for at, text in enumerate(texts) if mark in text]
            if cells:
                marked[mark] = cells
        if len(marked) == 2:
            both = [cell for cell in marked[','] if '.' in cell[2]]
            if both:
                name, at, text = both[0]
                raise InvalidInput(f'{self.where(at)}: {name}: {self._why_no_number(text)}')
            (comma_name, comma_at, comma_text), (name, at, text) = marked[','][0], marked['.'][0]
            raise InvalidInput(
                f'{self.where(at)}: {name}: {quoted(text)} has a decimal point, and '
                f'{quoted(comma_text)} in line {self.lines[comma_at]}, {comma_name}, a decimal '
                'comma; use only one')
        for mark, cells in marked.items():
            # One unambiguous number settles the others.
            if all(AMBIGUOUS.fullmatch(text) for _, _, text in cells):
                name, at, text = cells[0]
                raise InvalidInput(
                    f'{self.where(at)}: {name}: {quoted(text)} can be read as '
                    f'{text.replace(mark, "")} or as {text.replace(mark, ".").rstrip("0")}; write '
                    f'no thousands separator, or a number of digits other than three behind the '
                    f'decimal {"comma" if mark == "," else "point"}')
            return mark
        return '.'


def read_text_table(path: str | Path, columns: Iterable[str],
                    is_column: Callable[[str], bool] | None = None) -> TextTable:
    """
    Return the TextTable of a file.

    `columns` (texts) are the valid names in the header, for the message about an empty file. The header is the
    line above the first numbers in which `is_column` knows the most names; without such a line, the first one.
    Raises InvalidInput naming file, line and problem.
    """
    contents: list[tuple[int, str]] = []
    comments: list[tuple[int, str]] = []
    for number, line in enumerate(_lines(path), start=1):
        text, mark, comment = line.partition('#')
        text = text.strip(' \r\n')
        if mark and not contents:
            comments.append((number, comment.strip()))
        if text.strip('"\t ,;') and (contents or not SEPARATOR_LINE.fullmatch(text)):
            contents.append((number, text))
    if not contents:
        raise InvalidInput(f'{path}: is empty; its first line must name the columns: '
                           f'{", ".join(columns)}')
    at = _header_at([text for _, text in contents], is_column)
    comments += contents[:at]
    header_line, text = contents[at]
    separator = _separator(path, header_line, text, columns, contents[at + 1][1] if contents[at + 1:] else '')
    header = _cells(path, header_line, text, separator)
    while not header[-1]:
        header.pop()
    rows, lines, problems = [], [], []
    for number, text in contents[at + 1:]:
        cells = _cells(path, number, text, separator)
        while len(cells) > len(header) and not cells[-1]:
            cells.pop()
        if len(cells) != len(header):
            problems.append(f'{path}, line {number}: '
                            f'{_why_another_length(text, separator, cells, header)}')
        rows.append(cells)
        lines.append(number)
    if problems:
        raise InvalidInput(problems)
    return TextTable(path, separator, header, header_line, rows, lines, comments)


def _header_at(texts: list[str], is_column: Callable[[str], bool] | None) -> int:
    """Return the index of the header in the lines of a table."""
    before = next((at for at, text in enumerate(texts[:MOST_TITLE_LINES]) if BEGINS_WITH_NUMBER.match(text)), 1)
    if is_column is None or before < 2:
        return 0
    known = [max(sum(map(is_column, _split(text, separator))) for separator in SEPARATORS)
             for text in texts[:before]]
    return known.index(max(known))


def _lines(path: str | Path) -> list[str]:
    try:
        with open(path, encoding='utf-8-sig', newline='') as file:
            return list(file)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or \
            'is not UTF-8 text; in a spreadsheet, save it as "CSV UTF-8"'
        raise InvalidInput(f'{path}: cannot be read: {reason}') from error


def _separator(path: str | Path, number: int, text: str, columns: Iterable[str], row: str) -> str:
    """Return the separator in the header; of several, that which gives the row below as many cells."""
    if BEGINS_WITH_NUMBER.match(text):
        raise InvalidInput(f'{path}, line {number}: holds numbers; the line above them must name '
                           f'the columns: {", ".join(columns)}')
    found = [separator for separator in SEPARATORS if len(_split(text.strip(), separator)) > 1]
    alike = [separator for separator in found if len(_split(text, separator)) == len(_split(row, separator))]
    if len(found) > 1 and len(alike) != 1:
        raise InvalidInput(
            f'{path}, line {number}: the columns are separated by '
            f'{" and ".join(SEPARATORS[separator] for separator in found)}; use only one')
    if not found and re.search(r'[\s|]', text):
        raise InvalidInput(f'{path}, line {number}: {quoted(text)} has no separator; the columns '
                           'must be separated by commas, semicolons or tabs')
    return (alike if len(found) > 1 else found)[0] if found else ','


def _split(text: str, separator: str) -> list[str]:
    """Return the cells of a line; unlike `_cells`, never refuse it."""
    try:
        return next(csv.reader([text], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return text.split(separator)


def _cells(path: str | Path, number: int, text: str, separator: str) -> list[str]:
    if '"' not in text:
        return [cell.strip() for cell in text.split(separator)]
    try:
        return [cell.strip() for cell in next(csv.reader(
            [text], delimiter=separator, skipinitialspace=True, strict=True))]
    except csv.Error as error:
        raise InvalidInput(f'{path}, line {number}: is not CSV; do its quotation marks match? '
                           f'({error})') from error


def _why_another_length(text: str, separator: str, cells: list[str], header: list[str]) -> str:
    for other, name in SEPARATORS.items():
        if other not in (separator, ',') and other in text.strip():
            return f'is separated by {name}, the header by {SEPARATORS[separator]}'
    sentence = f'has {len(cells)} values; the header names {len(header)} columns'
    if separator == ',' and len(cells) > len(header):
        sentence += '; with decimal commas, separate the columns by semicolons'
    return sentence
