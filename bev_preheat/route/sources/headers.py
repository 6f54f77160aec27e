# SPDX-License-Identifier: Apache-2.0
"""Quantity and unit of a route's column, from the many spellings that programs use."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
import re
from typing import NamedTuple

import numpy as np

from bev_preheat.errors import figure, figure_beyond, InvalidInput, quoted
from bev_preheat.files.table import Table
from bev_preheat.files.units import Conversion, conversion, split_unit, TO_OWN
from bev_preheat.numerics import first_true, FloatArray
from bev_preheat.route.segments import LIMITS
from bev_preheat.route.sources.journey import SLOPE_RANGE, STOP_RANGE_S


class Quantity(NamedTuple):
    """A quantity: own unit and range, endings of names with a unit, other names, unit of values without one."""

    own: str
    plausible: tuple[float, float]
    endings: tuple[str, ...]
    names: tuple[str, ...]
    unit: str = ''


def _power(name: str, *names: str) -> Quantity:
    return Quantity('watt', LIMITS[f'{name}_w'], ('w', 'kw'), (name, *names))


CONSUMPTIONS = ('consumption', 'energy', 'energy_consumption', 'verbrauch', 'energy_used', 'battery_energy',
                'segment_energy', 'electric_energy')
QUANTITIES = {
    'time': Quantity('second', (-1e12, 1e12), ('s',), (
        'time', 't', 'timestamp', 'elapsed', 'elapsed_time', 'cycle_time', 'cyc', 'zeit', 'date_time', 'datetime',
        'zeitstempel', 'test_time', 'seconds', 'cumulative_time', 'total_time', 'time_of_day'), 'second'),
    'duration': Quantity('second', LIMITS['duration_s'], ('s', 'min'), (
        'duration', 'segment_duration', 'travel_time', 'dauer', 'delta_time', 'dt', 'step_duration',
        'driving_time')),
    'distance': Quantity('meter', (-1e9, 1e9), ('m', 'km'), (
        'cumulative_distance', 'total_distance', 'odometer', 'distance_from_start', 'cumulated_distance',
        'kilometer')),
    'length': Quantity('meter', (0.0, 3e6), ('m', 'km'), (
        'length', 'segment_length', 'distance', 'dist', 'segment_distance', 'leg_distance', 'strecke', 'laenge',
        'länge', 'ds', 's')),
    'speed': Quantity('meter/second', LIMITS['speed_mps'], ('mps', 'kmh'), (
        'speed', 'v', 'velocity', 'vehicle_speed', 'mean_speed', 'average_speed', 'avg_speed', 'cycle_speed',
        'speed_average', 'speed_avg', 'geschwindigkeit', 'target_speed', 'driving_speed', 'gps_speed', 'cyc',
        'wltc_speed', 'wltp_speed')),
    'slope': Quantity('1', SLOPE_RANGE, ('percent',), (
        'slope', 'grade', 'gradient', 'road_grade', 'road_slope', 'cyc_grade', 'road_gradient', 'steigung',
        'incline', 'inclination', 'grad'), '1'),
    'elevation': Quantity('meter', (-500.0, 9000.0), ('m',), (
        'elevation', 'altitude', 'alt', 'ele', 'elev', 'height', 'hoehe', 'höhe', 'end_elevation', 'elevation_end',
        'gps_altitude', 'z'), 'meter'),
    'consumption': Quantity('watt_hour', (-1e6, 1e6), ('wh', 'kwh'), CONSUMPTIONS),
    'consumption_by_length': Quantity(
        'watt_hour/kilometer', (-5e3, 5e3), ('wh_per_km', 'kwh_per_100km'), CONSUMPTIONS),
    'latitude': Quantity('degree', (-90.0, 90.0), ('deg',), (
        'latitude', 'lat', 'gps_latitude', 'gps_lat', 'position_lat', 'breitengrad'), 'degree'),
    'longitude': Quantity('degree', (-180.0, 180.0), ('deg',), (
        'longitude', 'lon', 'lng', 'long', 'gps_longitude', 'gps_lon', 'position_long', 'laengengrad',
        'längengrad'), 'degree'),
    'ambient_temperature': Quantity('degC', LIMITS['ambient_temperature_c'], ('c',), (
        'ambient_temperature', 'ambient', 'outside_temperature', 'temperature', 'temperatur', 'temp',
        'outdoor_temperature', 'air_temperature', 'ambient_temp', 'aussentemperatur', 'außentemperatur')),
    'cabin_heating_power': _power('cabin_heating_power', 'cabin_heater', 'cabin_heater_power'),
    'auxiliary_power': _power('auxiliary_power', 'auxiliaries', 'aux_power'),
    'charging_time': Quantity('second', (0.0, STOP_RANGE_S[1]), ('s', 'min'), (
        'charging_time', 'charging_duration', 'charge_time', 'charge_duration', 'ladezeit')),
    'propulsion_power': _power('propulsion_power', 'p_drive', 'p_prop', 'p_traction', 'drive_power',
                               'traction_power', 'p_propulsion', 'p_mot', 'p_motor', 'motor_power'),
    'propulsion_power_rms': _power('propulsion_power_rms'),
    'propulsion_power_magnitude': _power('propulsion_power_magnitude')}
# A temperature of the air: a word for it, and for the place, in either order.
_WORD = '(?:t|temp|temperature|temperatur)'
_PLACE = '(?:amb|ambient|env|environment|out|outside|outdoor|air|ext|external|exterior|aussen|außen|umgebungs?)'
AMBIENT = re.compile(f'{_WORD}(?:_?{_PLACE})+|(?:{_PLACE}_?)+{_WORD}|oat')
# Lengths that may also be distances from the start, which rise from row to row.
AMBIGUOUS_LENGTHS = ('distance', 'dist', 'strecke', 's')
# Words in longer names, which need their unit.
KEYWORDS = {'time': re.compile(r'time$|^elapsed'),
            'speed': re.compile(r'(speed|velocity)$|^(wltc|wltp|nedc|udds|hwfet|us06|artemis)')}


@dataclass(frozen=True)
class Header:
    """A column: quantity, `name` in the file, its `stem` in lower case, unit, and conversion to SI units."""

    quantity: str
    name: str
    stem: str
    unit: str
    conversion: Conversion

    @property
    def may_be_cumulated(self) -> bool:
        """Whether the name is also used for values from the start of the trip."""
        return self.quantity in ('time', 'distance') or self.stem in AMBIGUOUS_LENGTHS

    def si(self, values: FloatArray) -> FloatArray:
        """Return values of the column in SI units; degrees of slope become rise over run."""
        with np.errstate(over='ignore'):
            # An infinite value is out of every range.
            own = values * self.conversion.factor + self.conversion.offset
        return np.tan(np.radians(own)) if self.is_angle else own

    @property
    def is_angle(self) -> bool:
        """Whether a slope is given as its angle."""
        return self.quantity == 'slope' and TO_OWN[self.unit][0] == 'degree'


def read_header(name: str, unit: str = '') -> Header | str | None:
    """Return the Header of a column, None if its quantity is unknown, advice if its unit ('': none) is wrong."""
    # cycSecs, cycMps: words of a name in camel case; kWh is one word.
    text = re.sub(r'(?<=[a-z0-9])(?=[A-Z][a-z])(?!Wh\b)', '_', name.strip('" '))
    text = re.sub('[ _]per[ _]', '/', text)
    bare = split_unit(text)
    # The whole name first: t_env is no time in the unit env.
    stems = [(_stem(text), '' if bare.unit else unit), (_stem(bare.name).removesuffix('_in'), bare.unit or unit)]
    advice = None
    for stem, given in stems:
        for quantity in _quantities(stem, given):
            known = QUANTITIES[quantity]
            found = given or known.unit
            own = TO_OWN.get(found, ('',))[0]
            if own == known.own or (quantity == 'slope' and own == 'degree'):
                return Header(quantity, name, stem, found, conversion(found, own))
            as_well = ' or '.join(f'{stem}_{ending}' for ending in known.endings)
            advice = advice or (
                f'column {quoted(name)} has the unit {given}, which is not one of {quantity}' if given else
                f'column {quoted(name)} has no unit: rename it to {as_well}')
    return advice


def _quantities(stem: str, unit: str) -> list[str]:
    found = [quantity for quantity, each in QUANTITIES.items() if stem in each.names]
    found += ['ambient_temperature'] * bool(AMBIENT.fullmatch(stem))
    return found or [quantity for quantity, words in KEYWORDS.items() if unit and words.search(stem)]


def _stem(text: str) -> str:
    return re.sub(r'[\s\-.:_]+', '_', text.strip().lower()).strip('_')


def headers_of(table: Table) -> tuple[dict[str, Header], list[str], list[str]]:
    """Return the columns of a table by quantity, sentences on doubled ones, and on those that are not known."""
    where = f'{table.path}, line {table.header_line}' if table.header_line else table.path
    found: dict[str, Header] = {}
    doubled, unknown = [], []
    for name, unit in zip(table.header, table.units):
        header = read_header(re.sub(r' #\d+$', '', name), unit)
        if isinstance(header, Header):
            if header.quantity in found:
                doubled.append(f'{where}: columns {quoted(found[header.quantity].name)} and {quoted(header.name)} '
                               'hold the same quantity; keep only one')
            found.setdefault(header.quantity, header)
        elif header is not None:
            unknown.append(f'{where}: {header}')
        elif name:
            known = [f'{quantity}_{ending}' for quantity, each in QUANTITIES.items() for ending in each.endings]
            near = get_close_matches(_stem(name), known, n=1)
            unknown.append(f'{where}: column {quoted(name)} is unknown'
                           + (f'; did you mean {near[0]!r}?' if near else ''))
    return found, doubled, unknown


def column(table: Table, header: Header) -> FloatArray:
    """Return a column in SI units; raise InvalidInput naming the line of a value out of range."""
    values = table.numbers(header.name)
    low, high = QUANTITIES[header.quantity].plausible
    si = header.si(values)
    if (at := first_true(~((si >= low) & (si <= high)))) is not None:
        ends = [float(np.degrees(np.arctan(end)) if header.is_angle else end) for end in (low, high)]
        low, high = ((end - header.conversion.offset) / header.conversion.factor for end in ends)
        hint = '; is it in percent? then name it slope_percent' if header.unit == '1' else ''
        raise InvalidInput(f'{table.where(at)}: {header.name}: {figure_beyond(float(values[at]), low, high)} is '
                           f'not allowed; it must be {figure(low)} ... {figure(high)}{hint}')
    return si
