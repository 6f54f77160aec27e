# SPDX-License-Identifier: Apache-2.0
"""Text of a vehicle file, with a comment at each value."""

from __future__ import annotations

from collections.abc import Mapping
import re
import textwrap
from typing import Any

import yaml

from bev_preheat.files.checked_yaml import FileData, load_schema
from bev_preheat.vehicle.data_sheet_import import Entry
from bev_preheat.vehicle.loading import SCHEMA

WIDTH = 100


class _Dumper(yaml.SafeDumper):
    """Writes rows of numbers on one line, everything else below its key."""


_Dumper.add_representer(list, lambda dumper, values: dumper.represent_sequence(
    'tag:yaml.org,2002:seq', values, flow_style=all(isinstance(value, int | float) for value in values)))
HEAD = ('"given" marks figures of that command line, "source" the source of other figures, "assumed" figures '
        'that were not measured or stated for this car. State of charge is the displayed one: 0 and 1 are the '
        'ends of the usable energy.')
# Comments at keys that data sheets show nothing about.
HINTS = {
    'assumed': 'Listed in a warning with each plan. When you replace a value by your own, delete its entry here.',
    'charging': 'Data sheets do not state the lag of the heat. Without heat_path heat arrives at once in plans, '
                'and the planner learns the lag while driving; a measured step response of the heater gives the '
                'values:\n'
                '  heat_path: {heater_lag_s: 30, coolant_heat_capacity_j_per_k: 15000,\n'
                '              coolant_conductance_w_per_k: 500, sensor_lag_s: 20}\n'
                'For charging sessions. Data sheets do not state how the battery is cooled at a charger; without '
                'cooling it is not; coefficient_of_performance may stand for cooling_power_w:\n'
                '  cooling: {set_point_c: 35, electrical_power_w: 2000, cooling_power_w: 4000}\n'
                'The price of ageing at the charger, of LFP cells; without it ageing costs nothing:\n'
                '  ageing: {model: schimpe_2018, battery_price: 9000, age_years: 3, full_cycles: 200}'}
NO_ROAD_LOAD = """\
# Add road_load: {mass_kg, frontal_area_m2, drag_coefficient, rolling_resistance} to
# plan routes given as legs of road.
"""


def vehicle_text(name: str, entries: dict[str, Entry], command: str) -> str:
    """Return a vehicle file as text, from the entries of `describe_car` and the command line that made them."""
    contents: dict[str, FileData] = {'name': name, 'assumed': assumed_keys(entries)}
    # In the order of the schema.
    for section in load_schema(SCHEMA)['properties']:
        for key, entry in entries.items():
            above = key.split('.')
            node = contents
            for part in above[:-1] if above[0] == section else ():
                node = node.setdefault(part, {})
            if above[0] == section:
                node[above[-1]] = _numbers(entry.value)
    has_road_load = 'road_load' in contents
    text = file_text(contents, HINTS | {key: entry.note for key, entry in entries.items()},
                     f'Vehicle {_one_line(name)}, made by\n    {_one_line(command)}\n{HEAD}')
    return text if has_road_load else text + NO_ROAD_LOAD


def file_text(contents: dict[str, FileData], notes: Mapping[str, str], head: str) -> str:
    """Return a vehicle file's contents as text, below the comment `head`; `notes` are comments by dotted key."""
    text = yaml.dump(contents, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=WIDTH,
                     allow_unicode=True)
    lines, path = _comment(head, ''), list[str]()
    for line in text.splitlines():
        match = re.match(r'( *)([a-z_0-9]+):', line)
        if match:
            path = [*path[:len(match[1]) // 2], match[2]]
            lines += _comment(notes.get('.'.join(path), ''), match[1])
        lines.append(line)
    return '\n'.join(lines) + '\n'


def assumed_keys(entries: dict[str, Entry]) -> list[str]:
    """Return the keys of the assumed values; two of one table are merged into their parent."""
    limits = ('battery.power_limits.discharge', 'battery.power_limits.charge')
    keys = [key for key, entry in entries.items() if entry.assumed]
    if all(limit in keys for limit in limits):
        keys[keys.index(limits[0])] = 'battery.power_limits'
        keys.remove(limits[1])
    return keys


def _comment(text: str, indent: str) -> list[str]:
    return [each for line in text.splitlines() for each in textwrap.wrap(
        line, WIDTH, initial_indent=f'{indent}# ', break_on_hyphens=False, break_long_words=False,
        subsequent_indent=f'{indent}# {" " * (len(line) - len(line.lstrip()))}')]


def _numbers(value: FileData) -> Any:
    """Return a value with numbers as people write them: 0.1, not 0.1000000000000001; 25, not 25.0."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    if isinstance(value, bool):
        return value
    short = float(f'{value:.10g}')
    return int(short) if short.is_integer() else short


def _one_line(text: str) -> str:
    """Return the text on one line, safe for a comment."""
    return ''.join(letter if letter.isprintable() else ' ' for letter in text)
