# SPDX-License-Identifier: Apache-2.0
"""Quantity and unit of a column, from the many spellings that programs use."""

from __future__ import annotations

from dataclasses import dataclass
import re
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# Factors to SI units, degC and W, by quantity and unit. The empty unit is that of a name without one.
TIME = {'s': 1.0, 'sec': 1.0, 'secs': 1.0, 'second': 1.0, 'seconds': 1.0, 'ms': 1e-3, 'min': 60.0, 'mins': 60.0,
        'minute': 60.0, 'minutes': 60.0, 'h': 3600.0, 'hr': 3600.0, 'hours': 3600.0}
LENGTH = {'m': 1.0, 'meter': 1.0, 'meters': 1.0, 'metre': 1.0, 'metres': 1.0, 'km': 1000.0, 'mi': 1609.344,
          'mile': 1609.344, 'miles': 1609.344, 'ft': 0.3048, 'feet': 0.3048}
SPEED = {'mps': 1.0, 'm/s': 1.0, 'ms': 1.0, 'ms-1': 1.0, 'm/sec': 1.0, 'meters per second': 1.0, 'km/h': 1 / 3.6,
         'kmh': 1 / 3.6, 'kph': 1 / 3.6, 'km/hr': 1 / 3.6, 'kmph': 1 / 3.6, 'kmh-1': 1 / 3.6, 'mph': 0.44704,
         'mi/h': 0.44704}
SLOPE = {'': 1.0, '-': 1.0, 'm/m': 1.0, 'fraction': 1.0, 'ratio': 1.0, '1': 1.0, 'rise over run': 1.0,
         '%': 0.01, 'percent': 0.01, 'pct': 0.01, 'deg': np.nan, 'degree': np.nan, 'degrees': np.nan, '°': np.nan,
         'rad': np.nan}
ENERGY = {'wh': 1.0, 'kwh': 1000.0, 'j': 1 / 3600.0, 'kj': 1 / 3.6, 'mj': 1e6 / 3600.0}
POWER = {'w': 1.0, 'kw': 1000.0}
TEMPERATURE = {'c': 1.0, '°c': 1.0, 'degc': 1.0, 'celsius': 1.0, 'deg c': 1.0}
UNITS = {
    'time': {'': 1.0, **TIME}, 'duration': TIME, 'distance': LENGTH, 'length': LENGTH, 'speed': SPEED,
    'slope': SLOPE, 'elevation': {'': 1.0, **LENGTH}, 'consumption': ENERGY, 'ambient_temperature': TEMPERATURE,
    'cabin_heating_power': POWER, 'auxiliary_power': POWER, 'latitude': {'': 1.0, 'deg': 1.0, '°': 1.0},
    'longitude': {'': 1.0, 'deg': 1.0, '°': 1.0}, 'charging_time': TIME, 'propulsion_power': POWER}
NAMES = {
    'time': ('time', 't', 'timestamp', 'elapsed', 'elapsed_time', 'cycle_time', 'cyc', 'zeit', 'date_time',
             'datetime', 'zeitstempel', 'test_time', 'seconds', 'cumulative_time', 'total_time', 'time_of_day'),
    'duration': ('duration', 'segment_duration', 'travel_time', 'dauer', 'delta_time', 'dt', 'step_duration',
                 'driving_time'),
    'distance': ('cumulative_distance', 'total_distance', 'odometer', 'distance_from_start', 'cumulated_distance',
                 'kilometer'),
    'length': ('length', 'segment_length', 'distance', 'dist', 'segment_distance', 'leg_distance', 'strecke',
               'laenge', 'länge', 'ds', 's'),
    'speed': ('speed', 'v', 'velocity', 'vehicle_speed', 'mean_speed', 'average_speed', 'avg_speed', 'cycle_speed',
              'speed_average', 'speed_avg', 'geschwindigkeit', 'target_speed', 'driving_speed', 'gps_speed', 'cyc',
              'wltc_speed', 'wltp_speed', 'speed_kmh_average'),
    'slope': ('slope', 'grade', 'gradient', 'road_grade', 'road_slope', 'cyc_grade', 'road_gradient', 'steigung',
              'incline', 'inclination', 'grad'),
    'elevation': ('elevation', 'altitude', 'alt', 'ele', 'elev', 'height', 'hoehe', 'höhe', 'end_elevation',
                  'elevation_end', 'gps_altitude', 'z'),
    'consumption': ('consumption', 'energy', 'energy_consumption', 'verbrauch', 'energy_used', 'battery_energy',
                    'segment_energy', 'electric_energy'),
    'ambient_temperature': ('ambient_temperature', 'ambient', 'outside_temperature', 'temperature', 'temp',
                            'outdoor_temperature', 'air_temperature', 'ambient_temp', 'aussentemperatur',
                            'außentemperatur'),
    'cabin_heating_power': ('cabin_heating_power', 'cabin_heater', 'cabin_heater_power'),
    'auxiliary_power': ('auxiliary_power', 'auxiliaries', 'aux_power'),
    'latitude': ('latitude', 'lat'), 'longitude': ('longitude', 'lon', 'lng', 'long'),
    'charging_time': ('charging_time', 'charging_duration', 'charge_time', 'charge_duration', 'ladezeit'),
    'propulsion_power': ('propulsion_power', 'p_drive', 'p_prop', 'p_traction', 'drive_power', 'traction_power',
                         'p_propulsion', 'p_mot', 'p_motor', 'motor_power'),
}
# A temperature of the air: a word for it, and for the place, in either order.
_WORD = '(?:t|temp|temperature|temperatur)'
_PLACE = '(?:amb|ambient|env|environment|out|outside|outdoor|air|ext|external|exterior|aussen|außen|umgebungs?)'
AMBIENT = re.compile(f'{_WORD}(?:_?{_PLACE})+|(?:{_PLACE}_?)+{_WORD}|oat')
# Lengths that may also be distances from the start, which rise from row to row.
AMBIGUOUS_LENGTHS = ('distance', 'dist', 'strecke', 's')
# Words in longer names.
KEYWORDS = {'time': re.compile(r'time$|^elapsed'),
            'speed': re.compile(r'(speed|velocity)$|^(wltc|wltp|nedc|udds|hwfet|us06|artemis)')}
_QUANTITY_OF: dict[str, list[str]] = {}
for _quantity, _names in NAMES.items():
    for _name in _names:
        _QUANTITY_OF.setdefault(_name, []).append(_quantity)


@dataclass(frozen=True)
class Header:
    """A column: quantity, `name` in the file, its `stem` and `unit` in lower case, and the factor to SI units."""

    quantity: str
    name: str
    stem: str
    unit: str
    factor: float

    @property
    def may_be_cumulated(self) -> bool:
        """Whether the name is also used for values from the start of the trip."""
        return self.quantity in ('time', 'distance') or self.stem in AMBIGUOUS_LENGTHS

    def si(self, values: FloatArray) -> FloatArray:
        """Return values of the column in SI units; degrees of slope become rise over run."""
        if np.isnan(self.factor):
            return np.tan(values if self.unit == 'rad' else np.radians(values))
        with np.errstate(over='ignore'):
            # An infinite value is out of every range.
            return values * self.factor


def read_header(name: str) -> Header | str | None:
    """
    Return the Header of a column's name, None if its quantity is unknown.

    A quantity with a missing or unknown unit gives a sentence of advice.
    """
    for stem, unit in _splits(name):
        for quantity in _quantities(stem):
            if unit in UNITS[quantity]:
                return Header(quantity, name, stem, unit, UNITS[quantity][unit])
    for stem, unit in _splits(name):
        # Longer names, such as the name of the cycle before the quantity, need their unit.
        for quantity, words in KEYWORDS.items():
            if unit and unit in UNITS[quantity] and words.search(stem):
                return Header(quantity, name, stem, unit, UNITS[quantity][unit])
    # The longest stem: t_env is no time in the unit env.
    for stem, unit in reversed(_splits(name)):
        for quantity in _quantities(stem):
            if unit:
                return (f'column {name!r}: the unit {unit!r} is not known; known for {quantity}: '
                        f'{", ".join(filter(None, UNITS[quantity]))}')
            units = ' or '.join(f'{stem}_{known}' for known in list(UNITS[quantity])[:1] + _second(quantity))
            return f'column {name!r} has no unit: rename it to {units}'
    return None


def is_column(name: str) -> bool:
    """Return whether quantity and unit of a column's name are known."""
    return isinstance(read_header(name), Header)


def _quantities(stem: str) -> list[str]:
    return _QUANTITY_OF.get(stem) or ['ambient_temperature'] * bool(AMBIENT.fullmatch(stem))


def _second(quantity: str) -> list[str]:
    common = {'speed': 'kmh', 'duration': 'min', 'length': 'km', 'distance': 'km', 'consumption': 'kwh',
              'charging_time': 'min'}
    return [common[quantity]] if quantity in common else []


def _splits(name: str) -> list[tuple[str, str]]:
    """Return the ways to read a name as (stem, unit), the most certain first."""
    text = name.strip().strip('"').strip()
    # cycSecs, cycMps: words of a name in camel case.
    text = re.sub(r'(?<=[a-z0-9])(?=[A-Z][a-z])', '_', text)
    match = re.fullmatch(r'(.*?)[\s_]*[\[({<]\s*(.*?)\s*[\])}>]', text)
    if match:
        return [(_stem(match[1]), match[2].lower())]
    lower = text.lower()
    ways = []
    for mark in (' in ', ' / ', ', '):
        first, found, last = lower.partition(mark)
        if found:
            ways.append((_stem(first), last.strip()))
    pieces = re.split(r'[\s_\-]+', lower)
    for at in range(1, len(pieces)):
        ways.append((_stem('_'.join(pieces[:at])), ' '.join(pieces[at:])))
    ways.append((_stem(lower), ''))
    return ways


def _stem(text: str) -> str:
    return re.sub(r'[\s\-.:_]+', '_', text.strip().lower()).strip('_')
