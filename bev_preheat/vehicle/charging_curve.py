# SPDX-License-Identifier: Apache-2.0
"""
The power of a warm car at a fast charger over its state of charge, and its map with the cold.

A charging curve is published for a warm battery. The map of a vehicle file is

    P(s, T) = share_hot(T) min(P_max, P_curve(s, T_c) share(T) / share(T_c))

with the chemistry's shares of the power over the battery temperature (chemistry.yaml). P_curve is linear between
the temperatures of several curves, and T_c is the temperature T within their range: that of the one curve.
Without a published curve, its shape is that of the car's class, which is read off published curves. A known limit
over the battery temperature replaces the shares: P(s, T) = min(P_max, P_curve(s, T_c), P_limit(T)).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import csv
from dataclasses import dataclass, replace
import math
from pathlib import Path
import re

import numpy as np

from bev_preheat.errors import InvalidInput, located, quoted
from bev_preheat.files.input_files import read_text
from bev_preheat.numerics import FloatArray, W_PER_KW
from bev_preheat.vehicle.chemistry import Chemistry
from bev_preheat.vehicle.curves import Table

PERCENT = 100.0
HEADER = ('state_of_charge_percent', 'power_kw')
LIMIT_HEADER = ('battery_temperature_c', 'max_power_kw')
# Temperatures of a limit [deg C] are cut off here, which no battery of a vehicle file exceeds.
LIMIT_TEMPERATURES_C = (-60.0, 100.0)
# Cars write -1000 for the end of a limit.
READ_TEMPERATURES_C = (-9999.0, 9999.0)
MOST_CURVE_POINTS = 1000
# A curve must cover the span for which charging times are published.
NEEDED_PERCENT = (10.0, 80.0)
MOST_POWER_KW = 2000.0
# Battery temperatures [deg C] of published curves. The warmest is at least WARM_CURVE_C, because its conversion to
# a warm battery would be a guess.
CURVE_TEMPERATURES_C = (-40.0, 45.0)
WARM_CURVE_C = 10.0
# Packs with a higher nominal voltage belong to the 800 V class.
HIGH_VOLTAGE_V = 550.0
# Range of `fit`: from far steeper than published curves to a maximum held up to a high state of charge.
FIT_RANGE = (1.0 / 3.0, 20.0)
# Points of a class curve besides its corners: a power of a line is not a line.
SOC_GRID = np.linspace(0.0, 1.0, 21)
# A point this close to the line between its neighbours, as a share of the maximum, is left out.
ON_LINE = 1e-6
DECIMALS = 4


@dataclass(frozen=True)
class ChargingCurve:
    """Charging power [kW], linear over the charge, constant beyond, at a temperature [deg C], and its source."""

    soc: tuple[float, ...]
    power_kw: tuple[float, ...]
    temperature_c: float
    note: str = 'given'


@dataclass(frozen=True)
class ChargingLimit:
    """Most power [kW], linear over the battery temperature [deg C], constant beyond, and its source."""

    temperature_c: tuple[float, ...]
    power_kw: tuple[float, ...]
    note: str = 'given'

    def warm_c(self, most_kw: float) -> float:
        """Return the lowest temperature [deg C] with the most power, at most `most_kw` [kW]."""
        highest_kw = min(most_kw, max(self.power_kw))
        at = next(index for index, power_kw in enumerate(self.power_kw) if power_kw >= highest_kw)
        if at == 0:
            return self.temperature_c[0]
        return float(np.interp(highest_kw, self.power_kw[at - 1:at + 1], self.temperature_c[at - 1:at + 1]))


def read_charging_curve(path: str | Path, note: str = 'given') -> ChargingCurve | ChargingLimit:
    """
    Return the ChargingCurve or the ChargingLimit of a CSV file, by its first line (HEADER, LIMIT_HEADER).

    A curve's temperature is NaN until `curves_at` states it. Lines that begin with # are comments. Raises
    InvalidInput naming file, line, value and the allowed values.
    """
    header, points = _points(path)
    with located(f'--charging-curve: {path}'):
        return checked_limit(points, note) if header == LIMIT_HEADER else checked_curve(points, math.nan, note)


def curves_at(curves: Sequence[ChargingCurve], temperatures_c: Sequence[float]) -> tuple[ChargingCurve, ...]:
    """
    Return curves with the battery temperatures [deg C] at which they were recorded, the coldest first.

    Raises InvalidInput if not each curve has a temperature of its own within CURVE_TEMPERATURES_C, or the warmest
    was recorded below WARM_CURVE_C.
    """
    option, (low_c, high_c) = '--charging-curve-temperature-c', CURVE_TEMPERATURES_C
    if len(temperatures_c) != len(curves):
        raise InvalidInput(f'{option}: {len(temperatures_c)} temperatures for {len(curves)} --charging-curve '
                           f'files with {HEADER[0]}; give the battery temperature of each')
    problems = [f'{option}: {at_c:g} degC is not allowed; it must be {low_c:g} ... {high_c:g} degC, the battery '
                'temperature at which the curve was recorded'
                for at_c in temperatures_c if not low_c <= at_c <= high_c]
    if len(set(temperatures_c)) < len(temperatures_c):
        problems.append(f'{option}: each curve needs a temperature of its own')
    if not problems and curves and max(temperatures_c) < WARM_CURVE_C:
        problems.append(f'{option}: {max(temperatures_c):g} degC is not allowed for the warmest curve; it must be '
                        f'{WARM_CURVE_C:g} ... {high_c:g} degC')
    if problems:
        raise InvalidInput(problems)
    return tuple(replace(curve, temperature_c=at_c)
                 for at_c, curve in sorted(zip(temperatures_c, curves), key=lambda pair: pair[0]))


def _points(path: str | Path) -> tuple[tuple[str, ...], list[tuple[float, float]]]:
    """Return the first line of a CSV file and the pairs of numbers below it."""
    with located('--charging-curve'):
        # Spreadsheets in a language with decimal commas write semicolons or tabs between the columns.
        lines = [re.sub('[;\t]', ',', line.replace(',', '.')) if re.search('[;\t]', line) else line
                 for line in read_text(path, 'utf-8-sig').splitlines()]
    rows = [(number, [cell.strip() for cell in row]) for number, line in enumerate(lines, 1)
            if line.strip() and not line.lstrip().startswith('#') for row in csv.reader([line])]
    if not rows or tuple(rows[0][1]) not in (HEADER, LIMIT_HEADER):
        raise InvalidInput(f'--charging-curve: {path}: the first line must be {",".join(HEADER)} or, for a limit, '
                           f'{",".join(LIMIT_HEADER)}')
    problems, points = [], []
    for number, cells in rows[1:]:
        try:
            percent, power_kw = map(float, cells)
        except ValueError:
            problems.append(f'line {number}: {quoted(",".join(cells))} is not two numbers')
        else:
            points.append((percent, power_kw))
    if problems:
        raise InvalidInput([f'--charging-curve: {path}: {problem}' for problem in problems])
    return tuple(rows[0][1]), points


def _point_problems(points: Sequence[tuple[float, float]], unit: str, low: float, high: float) -> Iterator[str]:
    """Yield a sentence for each point whose place, in a unit, or whose power [kW] is not allowed."""
    before = -math.inf
    for place, power_kw in points:
        if not low <= place <= high:
            yield f'{place:g} {unit} is not allowed; it must be {low:g} ... {high:g} {unit}'
        elif not 0.0 <= power_kw <= MOST_POWER_KW:
            yield f'{power_kw:g} kW at {place:g} {unit} is not allowed; it must be 0 ... {MOST_POWER_KW:g} kW'
        elif place <= before:
            yield f'{place:g} {unit} must be above the {before:g} {unit} before it'
        before = place


def checked_limit(points: Sequence[tuple[float, float]], note: str) -> ChargingLimit:
    """Return the ChargingLimit of points (temperature [deg C], power [kW]); raise InvalidInput if implausible."""
    problems = list(_point_problems(points, 'degC', *READ_TEMPERATURES_C))
    if not problems and not 2 <= len(points) <= MOST_CURVE_POINTS:
        problems.append(f'{len(points)} points; 2 ... {MOST_CURVE_POINTS} are allowed')
    low_c, high_c = LIMIT_TEMPERATURES_C
    if not problems and (points[0][0] >= high_c or points[-1][0] <= low_c):
        problems.append(f'it covers {points[0][0]:g} ... {points[-1][0]:g} degC; batteries have {low_c:g} ... '
                        f'{high_c:g} degC')
    if not problems and max(power_kw for _, power_kw in points) <= 0.0:
        problems.append('the power must be above 0 kW at some temperature')
    if problems:
        raise InvalidInput(problems)
    return ChargingLimit(tuple(temperature_c for temperature_c, _ in points),
                         tuple(power_kw for _, power_kw in points), note)


def checked_curve(points: Sequence[tuple[float, float]], temperature_c: float, note: str) -> ChargingCurve:
    """Return the ChargingCurve of points (state of charge [%], power [kW]); raise InvalidInput if implausible."""
    problems = list(_point_problems(points, '%', 0.0, PERCENT))
    problems = problems or _problems_with_span(points)
    if problems:
        raise InvalidInput(problems)
    return ChargingCurve(tuple(percent / PERCENT for percent, _ in points),
                         tuple(float(power_kw) for _, power_kw in points), temperature_c, note)


def _problems_with_span(points: Sequence[tuple[float, float]]) -> list[str]:
    low, high = NEEDED_PERCENT
    if len(points) > MOST_CURVE_POINTS:
        return [f'{len(points)} points; at most {MOST_CURVE_POINTS} are allowed']
    if points and points[-1][0] <= 1.0:
        return [f'the last state of charge is {points[-1][0]:g} %; states of charge are in percent']
    if len(points) < 2 or points[0][0] > low or points[-1][0] < high:
        span = f'{points[0][0]:g} ... {points[-1][0]:g} %' if points else 'nothing'
        return [f'it covers {span}; it must cover at least {low:g} ... {high:g} %']
    if min(power_kw for percent, power_kw in points if percent <= high) <= 0.0:
        return [f'the power must be above 0 kW up to {high:g} %']
    return []


def class_curve(chemistry: Chemistry, nominal_voltage_v: float, gross_energy_kwh: float,
                charging_power_kw: float, fit: float = 1.0) -> ChargingCurve:
    """
    Return the curve of a car's class, cut off at the car's maximum power [kW].

    With m the maximum rate of the class over that of the car, P = P_max min(1, m shape) for m >= 1: a pack that
    charges at a lower rate than the class holds its maximum longer. For m < 1, P = P_max shape^(1/m): a higher
    maximum is held more briefly. `fit` multiplies m. The charging time decreases strictly in `fit` until the
    maximum is held throughout.
    """
    shape = (chemistry.charging_shape_800_v if nominal_voltage_v >= HIGH_VOLTAGE_V else
             chemistry.charging_shape_400_v)
    fullness = fit * shape.peak_rate_per_h * gross_energy_kwh / charging_power_kw
    # The corner where the maximum is no longer held; shapes do not rise beyond their maximum.
    falling = slice(shape.share.index(1.0), None)
    held_soc = float(np.interp(-1.0 / max(1.0, fullness), -np.array(shape.share[falling]), shape.soc[falling]))
    soc = np.array(sorted({*SOC_GRID.tolist(), *shape.soc, round(held_soc, DECIMALS)}))
    share: FloatArray = np.interp(soc, shape.soc, shape.share)
    share = np.minimum(1.0, fullness * share) if fullness >= 1.0 else share ** (1.0 / fullness)
    kept = _corners(soc, share)
    soc, share = soc[kept], share[kept]
    return ChargingCurve(tuple(soc.tolist()), tuple((charging_power_kw * share).tolist()), shape.temperature_c,
                         f'assumed: the shape of {shape.source}')


def _corners(x: FloatArray, y: FloatArray) -> list[int]:
    """Return the indices of the points of a polygon that are not on the line between their neighbours."""
    kept = [0]
    for index in range(1, len(x) - 1):
        last = kept[-1]
        on_line = y[last] + (y[index + 1] - y[last]) * (x[index] - x[last]) / (x[index + 1] - x[last])
        if abs(y[index] - on_line) > ON_LINE:
            kept.append(index)
    return [*kept, len(x) - 1]


def charging_map(curves: Sequence[ChargingCurve], chemistry: Chemistry, most_kw: float,
                 limit: ChargingLimit | None = None) -> Table:
    """
    Return the charging power [W, negative] of curves over charge and temperature, at most `most_kw` [kW].

    The curves are in rising order of their temperatures. With a `limit` over the temperature it is the least of
    the three; else the chemistry decides for cold and heat.
    """
    cold, hot = chemistry.charge_share, chemistry.hot_share
    curves_c = [curve.temperature_c for curve in curves]
    soc = sorted({at for curve in curves for at in curve.soc})
    others_c = (*cold.temperature_c, *hot.temperature_c) if limit is None else np.clip(
        limit.temperature_c, *LIMIT_TEMPERATURES_C).tolist()
    grid_c = sorted({*map(float, others_c), *(curves_c if limit is None or len(curves) > 1 else ())})
    of_curves_kw = np.array([np.interp(soc, curve.soc, curve.power_kw) for curve in curves])
    rows_kw = np.array([np.interp(grid_c, curves_c, powers_kw) for powers_kw in of_curves_kw.T])
    if limit is not None:
        power_kw = np.minimum(np.minimum(rows_kw, np.interp(grid_c, limit.temperature_c, limit.power_kw)), most_kw)
    else:
        share, at_curve = (np.interp(at_c, cold.temperature_c, cold.temperature_share)
                           for at_c in (grid_c, np.clip(grid_c, curves_c[0], curves_c[-1])))
        # A hot battery takes a share of the power that the car would give it.
        hot_share = np.interp(grid_c, hot.temperature_c, hot.share)
        power_kw = hot_share * np.minimum(rows_kw * share / at_curve, most_kw)
    # + 0.0 avoids -0 in files.
    return Table(tuple(round(at, DECIMALS) for at in soc), tuple(grid_c),
                 tuple(map(tuple, (-np.round(W_PER_KW * power_kw) + 0.0).tolist())))
