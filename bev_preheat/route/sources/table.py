# SPDX-License-Identifier: Apache-2.0
"""
Reads tables without powers: drive cycles and lists of segments (CSV).

A column of times (or of cumulated distances) makes it a table of samples, such as a drive cycle: one row
is an instant. Durations or lengths make it a list of segments: one row is a segment.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bev_preheat.errors import figure, InvalidInput, located, quoted, shortened
from bev_preheat.files.table import Table
from bev_preheat.files.times import find_clock
from bev_preheat.numerics import first_true, FloatArray
from bev_preheat.route.road_load import elevation_of_slope, Motion
from bev_preheat.route.segments import LIMITS, LONGEST_ROUTE_S
from bev_preheat.route.sources.elevation import smooth_elevation
from bev_preheat.route.sources.headers import column, Header, headers_of, read_header
from bev_preheat.route.sources.journey import ChargingStop, Journey, RouteOptions, STOP_RANGE_S
from bev_preheat.route.sources.track import journey_of_points

# Fields of a Journey by their columns, and the columns of segments.
OF_JOURNEY = {'ambient_temperature_c': 'ambient_temperature', 'cabin_heating_power_w': 'cabin_heating_power',
              'auxiliary_power_w': 'auxiliary_power'}
OF_SEGMENTS = ('duration', 'length', 'speed', 'slope', 'elevation', 'consumption', 'consumption_by_length',
               *OF_JOURNEY.values(), 'charging_time')
OF_SAMPLES = ('time', 'speed', 'distance', 'slope', 'elevation', *OF_JOURNEY.values())
# Columns that are not used beside a better one.
BETTER = {'slope': 'elevation', 'distance': 'speed', 'consumption_by_length': 'consumption'}
# Longest time between two samples of a cycle [s], and the strongest acceleration [m/s^2] of a car.
CYCLE_INTERVAL_S = 60.0
MOST_ACCELERATION_MPS2 = 12.0
# Characters of a list of columns.
LONGEST_UNUSED = 400
# So many lengths seldom rise by chance.
RISING_LENGTHS = 3


def _has_motion(headers: dict[str, Header]) -> bool:
    return bool('speed' in headers and headers.keys() & {'time', 'duration', 'length'}) or (
        headers.keys() >= {'length', 'duration'}) or headers.keys() >= {'time', 'distance'}


def is_track(table: Table) -> bool:
    """Return whether a Table is a track: positions whose motion no column tells."""
    headers = headers_of(table)[0]
    return headers.keys() >= {'latitude', 'longitude'} and not _has_motion(headers)


def journey_of_track(table: Table, options: RouteOptions) -> Journey:
    """Return the Journey of a Table that is a track; raise InvalidInput naming line or point, and the remedy."""
    headers, problems, _ = headers_of(table)
    if problems:
        raise InvalidInput(problems)
    latitude_deg, longitude_deg = (column(table, headers[name]) for name in ('latitude', 'longitude'))
    elevation_m = column(table, headers['elevation']) if 'elevation' in headers else (
        np.full(len(latitude_deg), np.nan))
    time_s, remark = _times(table, headers['time']) if 'time' in headers else (None, '')
    used = {headers[name].name for name in ('latitude', 'longitude', 'elevation', 'time') if name in headers}
    unused = [name for name in table.header if name and name not in used]
    with located(table.path):
        return journey_of_points(
            'table of positions', latitude_deg, longitude_deg, elevation_m, time_s, options,
            [remark] * bool(remark) + [f'not used: {shortened(", ".join(unused), LONGEST_UNUSED)}'] * bool(unused),
            'row')


def journey_of_table(table: Table) -> Journey:
    """Return the Journey of a Table; raise InvalidInput naming line, column and value."""
    headers, problems, unknown = headers_of(table)
    if not _has_motion(headers):
        where = f'{table.path}, line {table.header_line}' if table.header_line else table.path
        problems += [*unknown, f'{where}: a route needs time_s and speed_kmh (a drive cycle), or two of '
                     'duration_s, speed_kmh and length_m for each segment, or latitude and longitude; found: '
                     + ', '.join(f'{header.name} ({header.quantity})' for header in headers.values())]
    if problems:
        raise InvalidInput(problems)
    if not table.lines:
        raise InvalidInput(f'{table.path}: has no rows below its header')
    read, wanted = ((_samples, OF_SAMPLES) if 'time' in headers and 'duration' not in headers else
                    (_segments, OF_SEGMENTS))
    used = {header.name for quantity, header in headers.items()
            if quantity in wanted and BETTER.get(quantity) not in headers}
    unused = {name: read_header(name, unit) for name, unit in zip(table.header, table.units)
              if name and name not in used}
    journey = read(table, headers)
    advice = [each for each in unused.values() if isinstance(each, str)]
    return replace(journey, remarks=(*journey.remarks, '; '.join(
        (f'not used: {shortened(", ".join(unused), LONGEST_UNUSED)}', *advice)))) if unused else journey


def _samples(table: Table, headers: dict[str, Header]) -> Journey:
    """Return the Journey of a table of samples: instants with speeds, or with cumulated distances."""
    time_s, assumption = _times(table, headers['time'])
    if len(time_s) < 2:
        raise InvalidInput(f'{table.path}: has {len(time_s)} sample; at least 2 are needed')
    steps_s = np.diff(time_s)
    if (at := first_true(~(steps_s > 0.0))) is not None:
        raise InvalidInput(f'{table.where(at + 1)}: {headers["time"].name}: {figure(float(time_s[at + 1]))} s is '
                           f'not after {figure(float(time_s[at]))} s of the previous row')
    if (at := first_true(steps_s > CYCLE_INTERVAL_S)) is not None:
        raise InvalidInput(f'{table.where(at + 1)}: {headers["time"].name}: {figure(float(steps_s[at]))} s '
                           f'without a sample; at most {CYCLE_INTERVAL_S:g} s are allowed; is the time in '
                           'seconds? Rows that are segments need duration_s instead of a time')
    total_s = float(time_s[-1] - time_s[0])
    if total_s > LONGEST_ROUTE_S:
        raise InvalidInput(f'{table.path}: lasts {figure(total_s)} s; at most {LONGEST_ROUTE_S:g} s are planned')
    if 'speed' not in headers:
        mean_mps, boundary_mps = _speed_of_distance(table, headers['distance'], steps_s), None
    else:
        boundary_mps = column(table, headers['speed'])
        mean_mps = _middle(boundary_mps)
        _check_accelerations(table, headers['speed'], boundary_mps, steps_s)
    remarks = [assumption] if assumption else []
    if 'elevation' in headers:
        distance_m = np.concatenate(([0.0], np.cumsum(steps_s * mean_mps)))
        elevation_m, remark = smooth_elevation(distance_m, column(table, headers['elevation']))
        remarks += [remark] if remark else []
    else:
        slope = _middle(column(table, headers['slope'])) if 'slope' in headers else np.zeros(len(steps_s))
        remarks += ['no slope and no elevation: a level road'] * ('slope' not in headers)
        elevation_m = elevation_of_slope(steps_s, mean_mps, slope)
    own: dict[str, Any] = {field: _middle(column(table, headers[name]))
                           for field, name in OF_JOURNEY.items() if name in headers}
    return Journey('drive cycle', Motion(steps_s, mean_mps, elevation_m, boundary_mps), remarks=tuple(remarks),
                   sampled=True, **own)


def _middle(values: FloatArray) -> FloatArray:
    return 0.5 * (values[:-1] + values[1:])


def _check_accelerations(table: Table, header: Header, speed_mps: FloatArray, steps_s: FloatArray) -> None:
    rates = np.diff(speed_mps) / steps_s
    at = int(np.argmax(np.abs(rates))) + 1
    if abs(rates[at - 1]) > MOST_ACCELERATION_MPS2:
        raise InvalidInput(f'{table.where(at)}: {header.name}: changes by {figure(float(abs(rates[at - 1])), 3)} '
                           f'm/s^2; at most {MOST_ACCELERATION_MPS2:g} m/s^2 are plausible; check the units of '
                           'speed and time')


def _speed_of_distance(table: Table, header: Header, steps_s: FloatArray) -> FloatArray:
    driven_m = np.diff(column(table, header))
    speed_mps = driven_m / steps_s
    if (at := first_true(~((driven_m >= 0.0) & (speed_mps <= LIMITS['speed_mps'][1])))) is not None:
        raise InvalidInput(f'{table.where(at + 1)}: {header.name}: {figure(float(driven_m[at]))} m in '
                           f'{figure(float(steps_s[at]))} s; a cumulated distance must not fall, and the speed '
                           f'must be at most {LIMITS["speed_mps"][1]:g} m/s')
    return speed_mps


def _times(table: Table, header: Header) -> tuple[FloatArray, str]:
    """Return a column of times [s]: numbers, dates or times of day; a sentence on an assumed unit, or ''."""
    texts, unit = table.texts(header.name), table.units[table.header.index(header.name)]
    is_stated = unit != '' or any(':' in text for text in texts)
    if not any(':' in text for text in texts):
        table.numbers(header.name)
    clock = find_clock(texts, unit, table.decimal)
    seconds = np.full(len(texts), np.nan) if clock is None else clock.seconds(texts)
    if (at := first_true(~np.isfinite(seconds))) is not None:
        raise InvalidInput(f'{table.where(at)}: {header.name}: {quoted(texts[at])} is not a time; use seconds, or '
                           'a date and time as in ISO 8601: 2026-01-31T08:00:00')
    is_assumed = clock is not None and not is_stated and not clock.absolute
    words = clock.remark if clock is not None and clock.remark else 'has no unit; its times are taken as seconds'
    return seconds, f'{header.name}: {words}' if is_assumed else ''


def motion_of_segments(table: Table, headers: dict[str, Header],
                       columns: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return durations [s] and speeds [m/s] of segments, shapes (N,), of two of duration, length and speed."""
    length_m = columns.get('length')
    if length_m is not None and len(length_m) >= RISING_LENGTHS and headers['length'].may_be_cumulated and not (
            {'duration', 'speed'} <= columns.keys()) and (np.diff(length_m) > 0.0).all():
        raise InvalidInput(f'{table.where(0)}: {headers["length"].name}: rises from row to row, as a distance '
                           'from the start of the trip does, which is not accepted; if it is the length of each '
                           'segment, name it length_m or length_km')
    if 'duration' in columns:
        duration_s = columns['duration']
        speed_mps = columns['speed'] if length_m is None else length_m / duration_s
        _check_three(table, headers, columns)
    else:
        speed_mps = columns['speed']
        assert length_m is not None
        if (at := first_true(speed_mps == 0.0)) is not None:
            raise InvalidInput(f'{table.where(at)}: {headers["speed"].name}: a segment in which the car stands '
                               f'has no length; give duration_s instead of {headers["length"].name}')
        duration_s = length_m / speed_mps
    if speed_mps.max() > LIMITS['speed_mps'][1]:
        at = int(speed_mps.argmax())
        raise InvalidInput(f'{table.where(at)}: length and duration give {figure(float(speed_mps[at]))} m/s; at '
                           f'most {LIMITS["speed_mps"][1]:g} m/s are allowed; check their units')
    return duration_s, speed_mps


def _segments(table: Table, headers: dict[str, Header]) -> Journey:
    columns = {name: column(table, headers[name]) for name in OF_SEGMENTS if name in headers}
    duration_s, speed_mps = motion_of_segments(table, headers, columns)
    if (wh_per_km := columns.get('consumption_by_length')) is not None:
        columns.setdefault('consumption', wh_per_km * duration_s * speed_mps / 1e3)
    remarks: list[str] = []
    if 'elevation' in columns:
        # Of the end of each segment; the first one is taken as level.
        elevation_m = np.concatenate((columns['elevation'][:1], columns['elevation']))
    else:
        slope = columns.get('slope')
        if slope is None and 'consumption' not in columns:
            remarks.append('no slope and no elevation: a level road')
        elevation_m = elevation_of_slope(
            duration_s, speed_mps, np.zeros(len(speed_mps)) if slope is None else slope)
    own: dict[str, Any] = {field: columns.get(name) for field, name in OF_JOURNEY.items()}
    return Journey('list of segments', Motion(duration_s, speed_mps, elevation_m),
                   stops=stops_of_segments(table, headers, columns),
                   consumption_wh=columns.get('consumption'), remarks=tuple(remarks), **own)


def stops_of_segments(table: Table, headers: dict[str, Header],
                      columns: dict[str, FloatArray]) -> tuple[ChargingStop, ...]:
    """Return the stops of the charging times [s] of segments; that of the last one follows the route."""
    charging_s = columns.get('charging_time', np.zeros(0))[:-1]
    low_s, high_s = STOP_RANGE_S
    if (at := first_true((charging_s > 0.0) & (charging_s < low_s))) is not None:
        raise InvalidInput(f'{table.where(at)}: {headers["charging_time"].name}: {figure(float(charging_s[at]))} '
                           f's is not allowed; it must be 0 s, no stop, or {low_s:g} ... {high_s:g} s')
    return tuple(ChargingStop(int(at), float(charging_s[at])) for at in np.flatnonzero(charging_s))


def _check_three(table: Table, headers: dict[str, Header], columns: dict[str, FloatArray]) -> None:
    if not {'length', 'speed', 'duration'} <= columns.keys():
        return
    driven_m = columns['speed'] * columns['duration']
    # Planners round minutes, kilometres and km/h.
    off_m = np.abs(driven_m - columns['length']) - 0.25 * np.maximum(driven_m, columns['length'])
    if (at := first_true(off_m > 100.0)) is not None:
        raise InvalidInput(f'{table.where(at)}: {headers["speed"].name} times {headers["duration"].name} is '
                           f'{figure(float(driven_m[at]))} m, but {headers["length"].name} is '
                           f'{figure(float(columns["length"][at]))} m; check the units')
