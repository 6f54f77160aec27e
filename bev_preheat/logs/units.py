# SPDX-License-Identifier: Apache-2.0
"""Units as logs write them, and the linear conversion to a signal's own unit (by pint)."""

from __future__ import annotations

from functools import cache, lru_cache
import re
from typing import NamedTuple

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.optional_packages import require

# Spellings in logs (lower case, without blanks) and pint's names.
SPELLINGS = {
    '°c': 'degC', 'degc': 'degC', 'c': 'degC', 'celsius': 'degC', 'ºc': 'degC', '℃': 'degC', 'deg_c': 'degC',
    '°f': 'degF', 'degf': 'degF', 'f': 'degF', 'fahrenheit': 'degF', 'ºf': 'degF', '℉': 'degF', 'deg_f': 'degF',
    'k': 'kelvin', 'kelvin': 'kelvin',
    '%': 'percent', 'percent': 'percent', 'pct': 'percent', 'prozent': 'percent', 'share': '1', '1': '1', '-': '1',
    'v': 'volt', 'volt': 'volt', 'volts': 'volt', 'mv': 'millivolt', 'kv': 'kilovolt',
    'a': 'ampere', 'amp': 'ampere', 'amps': 'ampere', 'ampere': 'ampere', 'ma': 'milliampere',
    'w': 'watt', 'watt': 'watt', 'watts': 'watt', 'kw': 'kilowatt', 'mw': 'milliwatt', 'hp': 'horsepower',
    'meters/second': 'meter/second', 'metres/second': 'meter/second', 'm/sec': 'meter/second',
    'miles/hour': 'mile/hour', 'km/hour': 'kilometer/hour', 'kmph': 'kilometer/hour',
    'm/s': 'meter/second', 'mps': 'meter/second', 'ms-1': 'meter/second',
    'km/h': 'kilometer/hour', 'kmh': 'kilometer/hour', 'kph': 'kilometer/hour', 'km/hr': 'kilometer/hour',
    'км/ч': 'kilometer/hour', 'mph': 'mile/hour', 'mi/h': 'mile/hour', 'miles/h': 'mile/hour',
    'kn': 'knot', 'knots': 'knot',
    'm': 'meter', 'meter': 'meter', 'meters': 'meter', 'km': 'kilometer', 'mi': 'mile', 'miles': 'mile',
    'ft': 'foot', 'feet': 'foot',
    'deg': 'degree', '°': 'degree', 'degrees': 'degree', 'rad': 'radian',
    's': 'second', 'sec': 'second', 'secs': 'second', 'seconds': 'second', 'second': 'second',
    'ms': 'millisecond', 'msec': 'millisecond', 'milliseconds': 'millisecond',
    'us': 'microsecond', 'µs': 'microsecond', 'ns': 'nanosecond', 'min': 'minute', 'minutes': 'minute',
    'h': 'hour',
    'watthour': 'watt_hour', 'wh': 'watt_hour', 'kwh': 'kilowatt_hour', 'ah': 'ampere_hour', 'ohm': 'ohm',
    'mohm': 'milliohm', 'rpm': 'rpm', '1/min': 'rpm', 'nm': 'newton_meter', 'bar': 'bar', 'kpa': 'kilopascal',
    'hz': 'hertz', 'g/s': 'gram/second', 'l/h': 'liter/hour', 'l/hr': 'liter/hour', 'l/min': 'liter/minute',
    # Written out, as DBC files of some makers have them behind Unit_.
    'degrecelsi': 'degC', 'amper': 'ampere', 'kilowatt': 'kilowatt', 'kilometer': 'kilometer', 'minut': 'minute',
    'kilometerperhour': 'kilometer/hour', 'kilomperhour': 'kilometer/hour', 'secon': 'second'}
# Units of the signals by the ending of their names.
OWN_UNITS = {'c': 'degC', 'v': 'volt', 'a': 'ampere', 'w': 'watt', 'mps': 'meter/second', 'm': 'meter',
             'deg': 'degree', 's': 'second', 'soc': '1'}
# Units that convert to each own unit; for others pint is asked.
ALIKE = {'degC': ('degC', 'degF', 'kelvin'), '1': ('1', 'percent'), 'volt': ('volt', 'millivolt', 'kilovolt'),
         'ampere': ('ampere', 'milliampere'), 'watt': ('watt', 'kilowatt'),
         'meter': ('meter', 'kilometer', 'mile', 'foot'),
         'meter/second': ('meter/second', 'kilometer/hour', 'mile/hour'), 'degree': ('degree',)}
# Longer texts are no names of channels; regular expressions would take minutes for some texts.
LONGEST_NAME = 200
# Names whose parts are remembered.
MOST_NAMES = 20_000
IN_BRACKETS = re.compile(r'^(.*?)\s*[\[(]\s*([^\])]*?)\s*[\])]\s*$')
AT_END = re.compile(r'^(.+?)[ _/]+([^ _]+)$')


class Conversion(NamedTuple):
    """A linear conversion: value in the wanted unit = `factor` * value + `offset`."""

    factor: float
    offset: float


class NamedUnit(NamedTuple):
    """A header split into the name of a quantity and its unit (pint's name, '' if none is given)."""

    name: str
    unit: str


def pint_unit(text: str) -> str:
    """Return pint's name of a unit as logs write it, '' if it is unknown."""
    return SPELLINGS.get(''.join(text.split()).lower().removeprefix('unit_'), '')


def own_unit(signal: str) -> str:
    """Return the unit (pint's name) that a signal of SIGNALS is stored in."""
    return OWN_UNITS[signal.rpartition('_')[2]]


@lru_cache(MOST_NAMES)
def split_unit(header: str) -> NamedUnit:
    """Return the NamedUnit of a header such as `Speed [km/h]`, `speed_kmh`, `Pack T1 C`; unit '' if unknown."""
    for pattern in (IN_BRACKETS, AT_END) if len(header) <= LONGEST_NAME else ():
        match = pattern.match(header.strip())
        if match and pint_unit(match[2]):
            return NamedUnit(match[1].strip(' ,:'), pint_unit(match[2]))
    return NamedUnit(header.strip(), '')


@lru_cache(MOST_NAMES)
def is_stated(name: str, unit: str) -> bool:
    """Return whether the unit of a channel was given as one, not read from a letter at the end of its name."""
    end = AT_END.match(name.strip()) if len(name) <= LONGEST_NAME else None
    # battery_temp_min and Temperature (min) are no durations in minutes, sensor_A and sensor_1 have no unit.
    is_word = end is not None and IN_BRACKETS.match(name) is None and len(end[2]) == 1 and end[2] != '%'
    return unit not in ('', 'minute') and not (is_word and split_unit(name).unit == unit)


def measures(unit: str, signal: str) -> bool:
    """Return whether a unit (pint's name) measures a signal's quantity."""
    own = own_unit(signal)
    if unit in ALIKE[own] or (own, unit) == ('degC', 'degree'):
        # Many write deg for degrees Celsius.
        return True
    if any(unit in units for units in ALIKE.values()):
        return False
    try:
        conversion(unit, own)
    except InvalidInput:
        return False
    return True


def check_unit(unit: str, signal: str) -> None:
    """Raise InvalidInput if a unit, as pint or logs write it, does not measure a signal's quantity."""
    own = own_unit(signal)
    if (pint_unit(unit) or unit) not in ALIKE[own]:
        conversion(unit, own)


@cache
def conversion(unit: str, wanted: str) -> Conversion:
    """
    Return the Conversion from a unit to another, both as pint or logs write them.

    Raises InvalidInput if pint knows no such unit, or if it measures another quantity.
    """
    unit, wanted = pint_unit(unit) or unit, pint_unit(wanted) or wanted
    if unit == wanted:
        return Conversion(1.0, 0.0)
    require('pint')
    # Loaded on demand, because pint takes longer to import than a log of SI units takes to read.
    import pint
    registry = _registry()
    try:
        zero, one = (registry.Quantity(value, unit).to(wanted).magnitude for value in (0.0, 1.0))
    except pint.DimensionalityError as error:
        raise InvalidInput(f'unit {quoted(unit)} cannot be converted to {wanted}') from error
    except Exception as error:
        # pint raises errors of Python's own parser for some texts.
        raise InvalidInput(f'unit {quoted(unit)} is unknown; write it as in km/h, mph, degC, degF, K, percent, '
                           'V, A, W or kW') from error
    return Conversion(float(one - zero), float(zero))


@cache
def _registry():  # type: ignore[no-untyped-def]
    import pint
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
