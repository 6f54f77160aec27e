# SPDX-License-Identifier: Apache-2.0
"""Numbers and units as tables and logs write them, and the linear conversion to a quantity's own unit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.numerics import BoolArray, FloatArray

# By quantity, named by its own unit: (unit, factor, offset, spellings in lower case without blanks). A value in
# the own unit is factor * value + offset.
QUANTITIES: dict[str, tuple[tuple[str, float, float, str], ...]] = {
    'degC': (('degC', 1.0, 0.0,
              '°c degc c celsius ºc ℃ deg_c degrecelsi gradc gradcelsius degcelsius degreescelsius'),
             ('degF', 1.0 / 1.8, -32.0 / 1.8, '°f degf f fahrenheit ºf ℉ deg_f'), ('kelvin', 1.0, -273.15, 'k')),
    '1': (('1', 1.0, 0.0, 'share - m/m fraction ratio riseoverrun'), ('percent', 0.01, 0.0, '% pct prozent'),
          ('permille', 0.001, 0.0, '‰ promille')),
    'volt': (('volt', 1.0, 0.0, 'v volts'), ('millivolt', 1e-3, 0.0, 'mv'), ('kilovolt', 1e3, 0.0, 'kv')),
    'ampere': (('ampere', 1.0, 0.0, 'a amp amps amper'), ('milliampere', 1e-3, 0.0, 'ma')),
    'watt': (('watt', 1.0, 0.0, 'w watts'), ('kilowatt', 1e3, 0.0, 'kw'), ('milliwatt', 1e-3, 0.0, 'mw'),
             ('horsepower', 745.69987158227022, 0.0, 'hp bhp'), ('metric_horsepower', 735.49875, 0.0, 'ps cv')),
    'meter/second': (
        ('meter/second', 1.0, 0.0, 'm/s mps ms-1 m/sec meters/second metres/second meterspersecond'),
        ('kilometer/hour', 1.0 / 3.6, 0.0,
         'km/h kmh kph km/hr kmh-1 kmph km/hour км/ч kilometerperhour kilomperhour'),
        ('mile/hour', 0.44704, 0.0, 'mph mi/h miles/h miles/hour'), ('knot', 1852.0 / 3600.0, 0.0, 'kn knots')),
    'meter': (('meter', 1.0, 0.0, 'm meters metre metres'), ('kilometer', 1e3, 0.0, 'km kilometers'),
              ('mile', 1609.344, 0.0, 'mi miles'), ('foot', 0.3048, 0.0, 'ft feet')),
    'degree': (('degree', 1.0, 0.0, 'deg ° degrees'), ('radian', 57.29577951308232, 0.0, 'rad')),
    'second': (('second', 1.0, 0.0, 's sec secs seconds secon'),
               ('millisecond', 1e-3, 0.0, 'ms msec milliseconds'),
               ('microsecond', 1e-6, 0.0, 'us µs'), ('nanosecond', 1e-9, 0.0, 'ns'),
               ('minute', 60.0, 0.0, 'min mins minutes minut'), ('hour', 3600.0, 0.0, 'h hr hours')),
    'watt_hour': (('watt_hour', 1.0, 0.0, 'wh watthour'), ('kilowatt_hour', 1e3, 0.0, 'kwh'),
                  ('joule', 1.0 / 3600.0, 0.0, 'j'), ('kilojoule', 1.0 / 3.6, 0.0, 'kj'),
                  ('megajoule', 1e6 / 3600.0, 0.0, 'mj')),
    'watt_hour/kilometer': (
        ('watt_hour/kilometer', 1.0, 0.0, 'wh/km'), ('kilowatt_hour/kilometer', 1e3, 0.0, 'kwh/km'),
        ('kilowatt_hour/100_kilometer', 10.0, 0.0, 'kwh/100km'),
        ('watt_hour/mile', 1.0 / 1.609344, 0.0, 'wh/mi wh/mile'),
        ('kilowatt_hour/100_mile', 10.0 / 1.609344, 0.0, 'kwh/100mi kwh/100miles')),
    # No signal and no column of a route is measured in these, so channels with them are left out.
    'ampere_hour': (('ampere_hour', 1.0, 0.0, 'ah'),),
    'ohm': (('ohm', 1.0, 0.0, ''), ('milliohm', 1e-3, 0.0, 'mohm')),
    'rpm': (('rpm', 1.0, 0.0, '1/min'),), 'newton_meter': (('newton_meter', 1.0, 0.0, 'nm'),),
    'bar': (('bar', 1.0, 0.0, ''), ('kilopascal', 0.01, 0.0, 'kpa')), 'hertz': (('hertz', 1.0, 0.0, 'hz'),),
    'gram/second': (('gram/second', 1.0, 0.0, 'g/s'),),
    'liter/hour': (('liter/hour', 1.0, 0.0, 'l/h l/hr'), ('liter/minute', 60.0, 0.0, 'l/min'))}
# Many loggers count tenths and the like: [0.1 degC].
STEPS = {'': 1.0, **{f'{step:g}': step for step in (0.5, 0.1, 0.01, 0.001)}}
SPELLINGS = {step + spelling: f'{step} {unit}'.strip() for step in STEPS for units in QUANTITIES.values()
             for unit, _, _, spellings in units for spelling in (unit.lower(), *spellings.split())}
TO_OWN = {f'{step} {unit}'.strip(): (own, scale * factor, offset) for step, scale in STEPS.items()
          for own, units in QUANTITIES.items() for unit, factor, offset, _ in units}
# Units of signals and columns by the ending of their names.
OWN_UNITS = {'c': 'degC', 'v': 'volt', 'a': 'ampere', 'w': 'watt', 'mps': 'meter/second', 'm': 'meter',
             'deg': 'degree', 's': 'second', 'soc': '1'}
# Longer texts are no names of channels; regular expressions would take minutes for some texts.
LONGEST_NAME = 200
# Names whose parts are remembered.
MOST_NAMES = 20_000
IN_BRACKETS = re.compile(r'^(.*?)\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*$')
AT_END = re.compile(r'^(.+?)[ _/]+([^ _]+)$')


class Conversion(NamedTuple):
    """A linear conversion: value in the wanted unit = `factor` * value + `offset`."""

    factor: float
    offset: float


class NamedUnit(NamedTuple):
    """A header split into the name of a quantity and its unit ('' if none is given)."""

    name: str
    unit: str


def unit_named(text: str) -> str:
    """Return the name of a unit as logs write it, '' if it is unknown."""
    return SPELLINGS.get(''.join(text.split()).lower().removeprefix('unit_').replace(',', '.'), '')


def own_unit(signal: str) -> str:
    """Return the unit that a signal of SIGNALS is stored in."""
    return OWN_UNITS[signal.rpartition('_')[2]]


@lru_cache(MOST_NAMES)
def split_unit(header: str) -> NamedUnit:
    """Return the NamedUnit of a header such as `Speed [km/h]`, `speed_kmh`, `Pack T1 C`; unit '' if unknown."""
    for pattern in (IN_BRACKETS, AT_END) if len(header) <= LONGEST_NAME else ():
        match = pattern.match(header.strip())
        if match and unit_named(match[2]):
            return NamedUnit(match[1].strip(' ,:'), unit_named(match[2]))
    return NamedUnit(header.strip(), '')


@lru_cache(MOST_NAMES)
def is_stated(name: str, unit: str) -> bool:
    """Return whether the unit of a channel was given as one, not read from a letter at the end of its name."""
    end = AT_END.match(name.strip()) if len(name) <= LONGEST_NAME else None
    # battery_temp_min and Temperature (min) are no durations in minutes, sensor_A and sensor_1 have no unit.
    is_word = end is not None and IN_BRACKETS.match(name) is None and len(end[2]) == 1 and end[2] != '%'
    return unit not in ('', 'minute') and not (is_word and split_unit(name).unit == unit)


def measures(unit: str, signal: str) -> bool:
    """Return whether a unit measures a signal's quantity."""
    # Many write deg for degrees Celsius.
    return TO_OWN.get(unit, ('',))[0] == own_unit(signal) or (own_unit(signal), unit) == ('degC', 'degree')


def check_unit(unit: str, signal: str) -> None:
    """Raise InvalidInput if a unit, as logs write it, does not measure a signal's quantity."""
    conversion(unit, own_unit(signal))


def conversion(unit: str, wanted: str) -> Conversion:
    """Return the Conversion between units as logs write them; refuse unknown ones, and other quantities."""
    unit, wanted = unit_named(unit) or unit, unit_named(wanted) or wanted
    if unit not in TO_OWN:
        raise InvalidInput(f'unit {quoted(unit)} is unknown; write it as in km/h, mph, degC, degF, K, percent, '
                           'V, A, W or kW')
    (quantity, factor, offset), (other, over, zero) = TO_OWN[unit], TO_OWN[wanted]
    if quantity != other:
        raise InvalidInput(f'unit {quoted(unit)} cannot be converted to {wanted}')
    return Conversion(factor / over, (offset - zero) / over)


# Texts for "no reading", lower case.
NOTHING = frozenset(('', 'none', 'null', 'nan', 'na', 'n/a', '-', '--', '---', '?', 'unknown', 'nodata', 'no data',
                     'inf', '-inf', 'unavailable'))
SWITCHES = {'true': 1.0, 'false': 0.0, 'on': 1.0, 'off': 0.0}
# Plain numbers, which need no further check.
PLAIN_CHARACTERS = frozenset('0123456789.+-eE')
# A minus behind a number is its sign, as some ledgers write it, or a range; it is refused.
NUMBER = re.compile(r'([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?)\s*([^0-9\s-].*)?')
# 51 30.1234, as LeafSpy writes a latitude: degrees and minutes.
DEGREES_MINUTES = re.compile(r'([NSEW]?)\s*([+-]?)([0-9]{1,3})[ °]+([0-9]{1,2}(?:\.[0-9]*)?)\'?\s*([NSEW]?)')
WITH_COMMA = re.compile(r'[+-]?[0-9]+,[0-9]+(\s*[^0-9\s,.:-].*)?')
WITH_POINT = re.compile(r'[+-]?[0-9]+\.[0-9]+(\s*[^0-9\s,.:-].*)?')
# 1.500 and 1,500 are ambiguous: one and a half or fifteen hundred.
AMBIGUOUS = re.compile(r'[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}')
# A point before three digits, beside decimal commas.
THOUSANDS = re.compile(r'(?<=[0-9])\.(?=[0-9]{3}(?![0-9]))')
GROUPED = re.compile(r"([+-]?[0-9]{1,3}([ \u00a0\u202f\u2009'’.,])[0-9]{3}(?:\2[0-9]{3})*)((?!\2)[.,][0-9]+)?")


def decimal_mark(texts: Iterable[str]) -> str:
    """Return the decimal mark of cells: ',' if only commas show that they are one, or no point stands alone."""
    texts = [text for text in texts if ',' in text or '.' in text]
    for cells in ([text for text in texts if not AMBIGUOUS.fullmatch(text)], texts):
        if any(map(WITH_POINT.fullmatch, cells)):
            return '.'
        if any(map(WITH_COMMA.fullmatch, cells)):
            return ','
    return '.'


def cell_units(texts: Sequence[str]) -> list[str]:
    """Return the unit written behind the number of each cell, '' without one."""
    matches = (None if PLAIN_CHARACTERS.issuperset(text) else NUMBER.fullmatch(text.strip().replace(',', '.'))
               for text in texts)
    # OVMS has m for metres and M for miles.
    return [unit_named(match[2]) if match and match[2] and match[2] != 'M' else '' for match in matches]


def with_point(text: str) -> str:
    """Return a number with a decimal comma, maybe with points between thousands, with a decimal point alone."""
    return (THOUSANDS.sub('', text) if '.' in text else text).replace(',', '.')


def read_numbers(texts: Sequence[str], decimal: str = '.', angle: bool = False) -> tuple[FloatArray, BoolArray]:
    """Return numbers (N,), NaN for no reading, and which cells are wrong; `angle`: also degrees and minutes."""
    plain = [with_point(text) for text in texts] if decimal == ',' else texts
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
    grouped = [found for at in np.flatnonzero(wrong).tolist() if (found := GROUPED.fullmatch(plain[at].strip()))]
    # 2,200 alone may be 2.2; beside 950 or 12,345.6 it has a thousands separator.
    if len(grouped) == wrong.sum() and (
            np.isfinite(values).any() or not all(AMBIGUOUS.fullmatch(each[0]) for each in grouped)):
        values[wrong] = [float(_ungrouped(each).replace(',', '.')) for each in grouped]
        wrong[:] = False
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


def _ungrouped(grouped: re.Match[str]) -> str:
    return grouped[1].replace(grouped[2], '') + (grouped[3] or '')


def why_no_number(text: str) -> str:
    """Return why a cell is not a plain number, as a sentence without its subject."""
    grouped = GROUPED.fullmatch(text)
    if grouped and not (AMBIGUOUS.fullmatch(text) and ',' in text):
        return f'{quoted(text)} has a thousands separator; write {_ungrouped(grouped)}'
    if ',' in text:
        return (f'{quoted(text)} has a comma; with decimal commas in all numbers, separate the columns by '
                'semicolons')
    return f'{quoted(text)} is not a number'
