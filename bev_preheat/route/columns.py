# SPDX-License-Identifier: Apache-2.0
"""Column names, which end with the unit, and advice on unknown names."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
import math
import re
from typing import TYPE_CHECKING

from bev_preheat.errors import quoted
from bev_preheat.route.sources.headers import Header, read_header

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Common spellings of units, and the matching suffixes of column names.
ENDINGS = {'km/h': 'kmh', 'kph': 'kmh', 'm/s': 'mps', '°c': 'c', 'degc': 'c', 'celsius': 'c',
           'sec': 's', 'seconds': 's', 'minutes': 'min'}
# Quantities cumulated from the start of the trip, and the corresponding quantity of a segment.
RUNNING = {'distance': 'length', 'time': 'duration'}
SYNONYMS = {'velocity': 'speed', 'power': 'propulsion_power', 'ambient': 'ambient_temperature',
            'temperature': 'ambient_temperature'}


@dataclass(frozen=True)
class Column:
    """A column of a file: its quantity, in SI units or degC after multiplication by `times` / `over`."""

    quantity: str
    times: float = 1.0
    over: float = 1.0

    def si(self, values: FloatArray) -> FloatArray:
        """Return values of the file in the quantity's unit; shape follows the input."""
        return values if self.times == self.over == 1.0 else values * self.times / self.over

    def own(self, value: float) -> float:
        """Return a value of the quantity in the file's unit."""
        return value / self.times * self.over


def power_columns(quantity: str) -> dict[str, Column]:
    """Return the two columns of a power, by name: in W and in kW."""
    return {quantity: Column(quantity),
            f'{quantity.removesuffix("_w")}_kw': Column(quantity, times=1000.0)}


def speed_columns() -> dict[str, Column]:
    """Return the two columns of a speed, by name: in m/s and in km/h."""
    return {'speed_mps': Column('speed_mps'), 'speed_kmh': Column('speed_mps', over=3.6)}


def alternatives(quantity: str, known: dict[str, Column]) -> str:
    """Return the columns for a quantity, as words."""
    return ' or '.join(name for name, column in known.items() if column.quantity == quantity)


def doubled(header: list[str], known: dict[str, Column]) -> list[str]:
    """Return a sentence for each quantity with more than one column in a header."""
    problems = []
    for quantity in dict.fromkeys(column.quantity for column in known.values()):
        names = [name for name in header
                 if name in known and known[name].quantity == quantity]
        if len(set(names)) > 1:
            problems.append(f'columns {" and ".join(dict.fromkeys(names))} hold the same '
                            'quantity; keep only one')
        elif len(names) > 1:
            problems.append(f'column {names[0]} is named more than once')
    return problems


def advice(name: str, known: dict[str, Column]) -> str:
    """Return a sentence of advice on a column that is not among the `known` ones."""
    if not name:
        return 'a column has no name'
    stem, ending = _parted(name)
    plain = f'{stem}_{ending}' if ending else stem
    column = f'column {quoted(name)}'
    if plain in known:
        return f'{column}: rename it to {plain}'
    stems: dict[str, list[str]] = {}
    for known_name in known:
        stems.setdefault(known_name.rpartition('_')[0], []).append(known_name)
    header = read_header(name)
    if isinstance(header, Header) and not header.may_be_cumulated and header.quantity in stems:
        same = [known_name for known_name in stems[header.quantity]
                if math.isclose(known[known_name].times / known[known_name].over, header.factor)]
        stem, ending = header.quantity, header.unit
        if same:
            return f'{column}: rename it to {same[0]}'
    elif isinstance(header, Header):
        stem = 'time' if header.quantity == 'time' else 'distance'
    elif not ending and stem not in stems and stem.rpartition('_')[0]:
        first, _, last = stem.rpartition('_')
        if any(first in words for words in (stems, RUNNING, SYNONYMS)):
            stem, ending = first, last
    if stem in RUNNING and RUNNING[stem] in stems:
        names = ' or '.join(stems[RUNNING[stem]])
        return (f'{column}: if it holds values per segment, rename it to {names}; values cumulated '
                'from the start of the trip are not accepted')
    if stem in SYNONYMS and SYNONYMS[stem] in stems and stem not in stems:
        return f'{column}: rename it to {" or ".join(stems[SYNONYMS[stem]])}'
    if stem in stems:
        names = ' or '.join(stems[stem])
        if ending:
            return f'{column}: the unit {ending!r} is not accepted; convert it to {names}'
        return f'{column} has no unit: rename it to {names}'
    near = get_close_matches(plain, known, n=1)
    hint = f'did you mean {near[0]!r}? ' if near else ''
    return f'{column} is unknown; {hint}known: {", ".join(known)}'


def _parted(name: str) -> tuple[str, str]:
    """Return quantity and unit of `Speed [km/h]`, `speed (km/h)` or `Speed`, spelt as in column names."""
    match = re.fullmatch(r'(.*?)\s*[\[(](.*)[\])]', name)
    words, unit = match.groups() if match else (name, '')
    stem = re.sub(r'[\s\-]+', '_', words.strip().lower())
    unit = unit.strip().lower()
    return stem, ENDINGS.get(unit, unit)
