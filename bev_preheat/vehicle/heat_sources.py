# SPDX-License-Identifier: Apache-2.0
"""Reads the tables of a vehicle file, and the heat sources beside the HVCH."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from bev_preheat.errors import figure, quoted
from bev_preheat.files.checked_yaml import FileData
from bev_preheat.tunables import LEAST_SOURCE_W
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import HeatPath, HeatSource, HVCH, step_problems

SOURCE_RANGE_W = (0.0, 50e3)
# Below the low end a source heats by waste; above the high end no heat pump works. Negative: a source that cools.
HEAT_PER_WATT_RANGE = (0.05, 10.0)


def arguments_of(node: dict[str, FileData]) -> dict[str, Any]:
    """Return a checked node as arguments of a dataclass: numbers as floats, lists as tuples."""
    def plain(value: FileData) -> Any:
        if isinstance(value, list):
            return tuple(map(plain, value))
        return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else value

    return {key: plain(value) for key, value in node.items()}


def read_table(key: str, node: dict[str, FileData], problems: list[str], rows_over: str = 'soc') -> Table:
    """Return the Table of a checked node; add problems with its axes and shape to `problems`."""
    axes = {}
    for axis in (rows_over, 'temperature_c'):
        points = tuple(map(float, node.get(axis, (0.0,))))
        if any(not low < high for low, high in zip(points, points[1:])):
            problems.append(f'{key}.{axis}: {list(points)} must rise from point to point')
        axes[axis] = points
    rows = node['values']
    if rows_over not in node:
        rows = [rows]
    elif 'temperature_c' not in node:
        rows = [[value] for value in rows]
    shape = (len(axes[rows_over]), len(axes['temperature_c']))
    if any(not isinstance(row, list) or len(row) != shape[1]
           or any(isinstance(value, list) for value in row) for row in rows) \
            or len(rows) != shape[0]:
        problems.append(f'{key}.values: must have {" x ".join(str(n) for n in shape if n > 1)} values, '
                        'one for each point of its axes')
        rows = np.zeros(shape).tolist()
    return Table(soc=axes[rows_over], temperature_c=axes['temperature_c'],
                 values=tuple(tuple(map(float, row)) for row in rows))


def read_heat_source(name: str, node: dict[str, FileData], efficiency: float, problems: list[str]) -> HeatSource:
    """Return the HeatSource of a checked node, beside an HVCH of an efficiency; add problems to `problems`."""
    curves = []
    for key, (low, high), unit in (('maximum_power_w', SOURCE_RANGE_W, ' W'),
                                   ('heat_per_watt', HEAT_PER_WATT_RANGE, '')):
        value, place, known = node[key], f'heat_sources.{name}.{key}', len(problems)
        table = (read_table(place, value, problems, 'ambient_c') if isinstance(value, dict) else
                 Table.constant(float(value)))
        numbers = [] if len(problems) > known else [number for row in table.values for number in row]
        cools = key == 'heat_per_watt' and next(filter(None, numbers), 0.0) < 0.0
        if cools:
            low, high = -high, -low
        bad = [number for number in numbers if not low <= number <= high]
        problems += [f'{place}: {figure(number)} is not allowed; it must be {low:g} ... {high:g}{unit}'
                     for number in bad[:1]]
        if unit and 0.0 < max(numbers, default=0.0) < LEAST_SOURCE_W:
            problems.append(f'{place}: {figure(max(numbers))} W at most is not allowed; it must be at least '
                            f'{LEAST_SOURCE_W:g} W; check the unit')
        curves.append(table)
    power, heat = curves
    hvch_watts = heat.changed(lambda value: value / efficiency)
    others = {key: value for key, value in node.items() if key not in ('maximum_power_w', 'heat_per_watt')}
    return HeatSource(name, power, hvch_watts, cools=cools, most_w=max(map(max, power.values)),
                      **arguments_of(others))


def heat_source_problems(sources: Sequence[HeatSource], path: HeatPath) -> Iterator[str]:
    """Yield a sentence for each implausible HeatSource of a file, beside a HeatPath."""
    for source in sources:
        if source.name == HVCH or not source.name.isidentifier() or not source.name.islower():
            yield (f'heat_sources: {quoted(source.name)} is no name for a source beside hvch; lower-case letters, '
                   'digits and _ are allowed')
        place = f'heat_sources.{source.name}'
        yield from step_problems(place, source.power_steps_w, source.most_w, place)
    if sources and path.heater_lag_s > 0.0:
        yield (f'heat_path.heater_lag_s: {path.heater_lag_s:g} s is not allowed beside heat_sources, whose lag is '
               'not described; it must be 0')
