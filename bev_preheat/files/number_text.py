# SPDX-License-Identifier: Apache-2.0
"""Numbers as tables have them: decimal commas, units behind the number, words for no reading."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import re
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import quoted
from bev_preheat.files.units import unit_named

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray

# Texts for "no reading", lower case.
NOTHING = frozenset(('', 'none', 'null', 'nan', 'na', 'n/a', '-', '--', '---', '?', 'unknown', 'nodata', 'no data',
                     'inf', '-inf', 'unavailable'))
SWITCHES = {'true': 1.0, 'false': 0.0, 'on': 1.0, 'off': 0.0}
# Plain numbers, which need no further check.
PLAIN_CHARACTERS = frozenset('0123456789.+-eE')
NUMBER = re.compile(r'([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)\s*([^0-9\s].*)?')
# 51 30.1234, as LeafSpy writes a latitude: degrees and minutes.
DEGREES_MINUTES = re.compile(r'([NSEW]?)\s*([+-]?)([0-9]{1,3})[ °]+([0-9]{1,2}(?:\.[0-9]*)?)\'?\s*([NSEW]?)')
WITH_COMMA = re.compile(r'[+-]?[0-9]+,[0-9]+([eE].*)?')
WITH_POINT = re.compile(r'[+-]?[0-9]+\.[0-9]+([eE].*)?')
# 1.500 and 1,500 are ambiguous: one and a half or fifteen hundred.
AMBIGUOUS = re.compile(r'[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}')
GROUPED = re.compile(r"([+-]?[0-9]{1,3})((?:[ \u00a0\u202f\u2009'’.,][0-9]{3})+)([.,][0-9]+)?")


def decimal_mark(texts: Iterable[str]) -> str:
    """Return the decimal mark of cells, ',' if some have a comma and none has a point alone, else '.'."""
    comma = False
    for text in texts:
        if WITH_POINT.fullmatch(text):
            return '.'
        comma = comma or WITH_COMMA.fullmatch(text) is not None
    return ',' if comma else '.'


def unit_in_cells(texts: Iterable[str]) -> str:
    """Return the unit written behind the numbers of cells, '' without a unit."""
    for text in texts:
        match = NUMBER.fullmatch(text.strip().replace(',', '.'))
        # OVMS has m for metres and M for miles.
        if match and match[2] and match[2] != 'M':
            return unit_named(match[2])
    return ''


def read_numbers(texts: Sequence[str], decimal: str = '.', angle: bool = False) -> tuple[FloatArray, BoolArray]:
    """
    Return the numbers of cells, shape (N,), NaN for no reading, and which cells are no numbers, shape (N,).

    With `angle`, cells may hold degrees and minutes.
    """
    plain = [text.replace(',', '.') for text in texts] if decimal == ',' else texts
    if all(map(PLAIN_CHARACTERS.issuperset, plain)):
        try:
            values = np.array(list(map(float, plain)))
            if np.isfinite(values).all():
                return values, np.zeros(len(values), dtype=bool)
        except ValueError:
            # Some cell is empty or no number; it is found below.
            pass
    values = np.array([_number(text, angle) for text in plain])
    wrong = np.isinf(values)
    values[wrong] = np.nan
    return values, wrong


def _number(text: str, angle: bool) -> float:
    """Return a cell's number, NaN for no reading, infinity if it is no number."""
    text = text.strip()
    match = NUMBER.fullmatch(text)
    if match and (match[2] is None or unit_named(match[2])):
        return float(match[1])
    word = text.lower()
    if word in NOTHING:
        return np.nan
    if word in SWITCHES:
        return SWITCHES[word]
    if angle:
        match = DEGREES_MINUTES.fullmatch(text)
        if match and float(match[4]) < 60.0:
            negative = match[2] == '-' or (match[1] or match[5]) in ('S', 'W')
            return (-1.0 if negative else 1.0) * (float(match[3]) + float(match[4]) / 60.0)
    return np.inf


def ambiguous(texts: Sequence[str]) -> str:
    """Return the first of the cells that have a mark, if each mark may be a thousands separator; else ''."""
    marked = [text for text in texts if '.' in text or ',' in text]
    return marked[0] if marked and all(map(AMBIGUOUS.fullmatch, marked)) else ''


def is_clear(text: str) -> bool:
    """Return whether a cell shows the decimal mark of its table."""
    marked = WITH_COMMA.fullmatch(text) or WITH_POINT.fullmatch(text)
    return marked is not None and AMBIGUOUS.fullmatch(text) is None


def why_no_number(text: str) -> str:
    """Return why a cell is not a plain number, as a sentence without its subject."""
    grouped = GROUPED.fullmatch(text)
    if grouped and not AMBIGUOUS.fullmatch(text):
        whole = ''.join(re.findall('[0-9+-]', grouped[1] + grouped[2]))
        return f'{quoted(text)} has a thousands separator; write {whole}{grouped[3] or ""}'
    if ',' in text:
        return (f'{quoted(text)} has a comma; with decimal commas in all numbers, separate the columns by '
                'semicolons')
    return f'{quoted(text)} is not a number'
