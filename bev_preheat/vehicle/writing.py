# SPDX-License-Identifier: Apache-2.0
"""Text of a vehicle file, with a comment at each value."""

from __future__ import annotations

from collections.abc import Iterable
import json
from pathlib import Path
import string
import textwrap
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.vehicle.data_sheet_import import Entry

WIDTH = 100
TEMPLATE = Path(__file__).with_name('vehicle_template.yaml')
ROAD_LOAD_TEMPLATE = Path(__file__).with_name('road_load_template.yaml')
NO_ROAD_LOAD = ('# Add road_load: {mass_kg, frontal_area_m2, drag_coefficient, rolling_resistance} to\n'
                '# plan routes given as legs of road.\n')
NOTE = 'note:'
TABLE_INDENTS = {'battery.open_circuit_voltage': 6, 'battery.resistance': 6,
                 'battery.power_limits.discharge': 6, 'battery.power_limits.charge': 6,
                 'charging.power_limit': 4}


class _Template(string.Template):
    """A template whose placeholders are keys of the file, such as ${hvch.efficiency}."""

    braceidpattern = f'(?:{NOTE})?[a-z_][a-z0-9_.]*'


def vehicle_text(name: str, entries: dict[str, Entry], command: str) -> str:
    """
    Return a vehicle file as text.

    `entries` are those of `data_sheet_import.describe_car`, `command` is the command line that made them.
    """
    values = {'name': _one_line(name), 'command': _comment(command, 0, '#     '),
              'quoted_name': json.dumps(name, ensure_ascii=False),
              'assumed': ''.join(f'  - {key}\n' for key in assumed_keys(entries)).rstrip('\n')}
    for key, entry in entries.items():
        values[key] = _value_text(key, entry.value)
        values[f'{NOTE}{key}'] = _comment(entry.note, 2 * key.count('.'))
    has_road_load = any(key.startswith('road_load.') for key in entries)
    values['road_load'] = (_filled(ROAD_LOAD_TEMPLATE, values) if has_road_load
                           else NO_ROAD_LOAD).rstrip('\n')
    return _filled(TEMPLATE, values)


def assumed_keys(entries: dict[str, Entry]) -> list[str]:
    """Return the keys of the assumed values; two of one table are merged into their parent."""
    limits = ('battery.power_limits.discharge', 'battery.power_limits.charge')
    keys = [key for key, entry in entries.items() if entry.assumed]
    if all(limit in keys for limit in limits):
        keys[keys.index(limits[0])] = 'battery.power_limits'
        keys.remove(limits[1])
    return keys


def _filled(template: Path, values: dict[str, str]) -> str:
    return _Template(template.read_text(encoding='utf-8')).substitute(values)


def _value_text(key: str, value: FileData) -> str:
    if key in TABLE_INDENTS:
        return _table_text(value, ' ' * TABLE_INDENTS[key])
    if isinstance(value, dict):
        return '{' + ', '.join(f'{name}: {_number(item)}' for name, item in value.items()) + '}'
    if isinstance(value, list):
        return _row(value)
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return _number(value)


def _table_text(table: dict[str, Any], indent: str) -> str:
    lines = []
    for key, value in table.items():
        if isinstance(value[0], list):
            lines += [f'{indent}{key}:', *(f'{indent}  - {_row(row)}' for row in value)]
        else:
            lines += textwrap.wrap(f'{key}: {_row(value)}', WIDTH, initial_indent=indent,
                                   subsequent_indent=indent + '  ')
    return '\n'.join(lines)


def _row(values: Iterable[float]) -> str:
    return f'[{", ".join(map(_number, values))}]'


def _number(value: float) -> str:
    return f'{value:.10g}'


def _comment(text: str, indent: int, mark: str = '# ') -> str:
    lead = f'{" " * indent}{mark}'
    return '\n'.join(textwrap.wrap(_one_line(text), WIDTH, initial_indent=lead,
                                   subsequent_indent=lead, break_on_hyphens=False, break_long_words=False))


def _one_line(text: str) -> str:
    """Return the text on one line, safe for a comment."""
    return ''.join(letter if letter.isprintable() else ' ' for letter in text)
