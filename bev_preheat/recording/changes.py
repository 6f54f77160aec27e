# SPDX-License-Identifier: Apache-2.0
"""The changes of `preheat replay`: another vehicle file, single values in it, method, parameters, signals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
import math
import re
from typing import Any, NamedTuple

import yaml

from bev_preheat.errors import InvalidInput, quoted

# Fields of battery_state and of route_plan, by the names of the command line.
BATTERY_FIELDS = {'temperature': 'temperature', 'soc': 'percentage', 'voltage': 'voltage', 'current': 'current'}
ROUTE_FIELDS = {'ambient_temperature': 'ambient_temperature', 'propulsion_power': 'propulsion_power',
                'target': 'target_battery_temperature',
                'maximum_arrival_temperature': 'maximum_arrival_temperature'}
# Without these values the planner still plans.
MAY_BE_MISSING = frozenset(('voltage', 'current'))
SIGNALS = (*BATTERY_FIELDS, *ROUTE_FIELDS)
# Units, of differences too, and limits of a value that replaces the recorded one.
UNITS = {'temperature': ('degC', 'K', (-60.0, 80.0)), 'soc': ('', '', (0.0, 1.0)),
         'voltage': ('V', 'V', (1.0, 1500.0)), 'current': ('A', 'A', (-3000.0, 3000.0)),
         'ambient_temperature': ('degC', 'K', (-60.0, 60.0)), 'propulsion_power': ('W', 'W', (-1e6, 1e6)),
         'target': ('degC', 'K', (-40.0, 60.0)), 'maximum_arrival_temperature': ('degC', 'K', (-60.0, 60.0))}
# Other names of signals.
ALIASES = {'battery_temperature': 'temperature', 'temp': 'temperature', 'percentage': 'soc',
           'state_of_charge': 'soc', 'charge': 'soc', 'ambient': 'ambient_temperature',
           'outside_temperature': 'ambient_temperature', 'power': 'propulsion_power',
           'target_temperature': 'target'}
VALUE = re.compile(r'(?P<sign>[+*=-]?)(?P<number>[0-9.eE+-]+)')
MISSING = 'none'


class SignalChange(NamedTuple):
    """A recorded value times `factor` (0: replaced) plus `offset`; NaN: the signal is missing."""

    signal: str
    factor: float
    offset: float

    def of(self, value: float) -> float:
        """Return the changed value."""
        return value * self.factor + self.offset

    @property
    def replaces(self) -> bool:
        """Whether the recorded value does not count."""
        return self.factor == 0.0 or math.isnan(self.factor)

    def in_words(self) -> str:
        """Return it as text."""
        if math.isnan(self.factor):
            return f'{self.signal} missing'
        unit, difference, _ = UNITS[self.signal]
        if self.factor == 0.0:
            return f'{self.signal} {self.offset:g} {unit}'.rstrip()
        if self.factor != 1.0 or self.offset == 0.0:
            return f'{self.signal} * {self.factor:g}'
        return f'{self.signal} {"+" if self.offset > 0.0 else "-"} {abs(self.offset):g} {difference}'.rstrip()

    def alter_battery(self, message: Any) -> None:
        """Change a BatteryState message, if it has the signal."""
        field = BATTERY_FIELDS.get(self.signal)
        if field is not None:
            setattr(message, field, self.of(getattr(message, field)))
            if self.signal == 'temperature' and len(message.cell_temperature):
                message.cell_temperature = [self.of(cell_c) for cell_c in message.cell_temperature]

    def alter_route(self, message: Any) -> None:
        """Change a RoutePlan message, if it has the signal."""
        field = ROUTE_FIELDS.get(self.signal)
        if self.signal == 'target':
            # A target that the route does not name is the planner's own, which only another value replaces.
            message.has_target_battery_temperature |= self.factor == 0.0
            if message.has_target_battery_temperature:
                message.target_battery_temperature = self.of(message.target_battery_temperature)
        elif self.signal == 'maximum_arrival_temperature':
            # 0 and NaN: the route names none, which only another value replaces.
            if self.factor == 0.0 or message.maximum_arrival_temperature:
                message.maximum_arrival_temperature = self.of(message.maximum_arrival_temperature)
        elif field is not None:
            setattr(message, field, [self.of(value) for value in getattr(message, field)])


def signal_change(signal: str, text: str) -> SignalChange:
    """Return the SignalChange of `20`, `=20`, `+2`, `-0.05`, `*1.1` or `none`; raises InvalidInput otherwise."""
    unit, difference, (low, high) = UNITS[signal]
    if text == MISSING and signal in MAY_BE_MISSING:
        return SignalChange(signal, math.nan, math.nan)
    found = VALUE.fullmatch(text)
    try:
        number = math.nan if found is None else float(found['number'])
    except ValueError:
        number = math.nan
    is_value = found is not None and found['sign'] in ('', '=')
    if found is None or not math.isfinite(number) or (is_value and not low <= number <= high):
        told = [f'{low:g} ... {high:g}{f" {unit}" if unit else " (a share)"}, with = before a negative one',
                f'+NUMBER or -NUMBER{f" [{difference}]" if difference else ""}', '*NUMBER',
                *([MISSING] if signal in MAY_BE_MISSING else [])]
        raise InvalidInput(
            f'{signal}: {quoted(text)} is not allowed; it must be {", ".join(told[:-1])}, or {told[-1]}')
    if is_value:
        return SignalChange(signal, 0.0, number)
    if found['sign'] == '*':
        return SignalChange(signal, number, 0.0)
    return SignalChange(signal, 1.0, number if found['sign'] == '+' else -number)


def with_keys(text: str, values: Mapping[str, Any]) -> str:
    """Return the text of a vehicle file with other values, such as {'hvch.maximum_power_w': 5000.0}."""
    if not values:
        return text
    contents = yaml.safe_load(text)
    for key, value in values.items():
        *above, last = key.split('.')
        node = contents
        for name in above:
            if not isinstance(node.get(name), dict):
                node[name] = {}
            node = node[name]
        node[last] = value
    return str(yaml.safe_dump(contents, sort_keys=False))


def keys_of_text(text: str) -> list[str]:
    """Return the dotted keys of the single values of a vehicle file."""
    return list(_keys(yaml.safe_load(text)))


def _keys(node: dict[str, Any], above: str = '') -> Iterator[str]:
    for name, item in node.items():
        if isinstance(item, dict):
            yield from _keys(item, f'{above}{name}.')
        elif not isinstance(item, list):
            yield f'{above}{name}'


@dataclass(frozen=True)
class Changes:
    """
    The changes of a replay: none by default.

    `vehicle` is a name in config/vehicles or a file, None: the recorded one. `vehicle_keys` replace values of that
    file by dotted keys, `parameters` recorded ones, `signals` change recorded signals.
    """

    vehicle: str | None = None
    vehicle_keys: Mapping[str, Any] = field(default_factory=dict)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    signals: tuple[SignalChange, ...] = ()

    @property
    def is_nothing(self) -> bool:
        """Whether the replay is to reproduce the recording."""
        return self.has_recorded_vehicle and not self.parameters and not self.signals

    @property
    def has_recorded_vehicle(self) -> bool:
        """Whether the vehicle file is the recorded one."""
        return self.vehicle is None and not self.vehicle_keys


def changes_in_words(changes: Changes) -> str:
    """Return the changes as text: my_car.yaml, method=paper, temperature + 2."""
    words = [] if changes.vehicle is None else [changes.vehicle]
    words += [f'{key}={value}' for key, value in changes.vehicle_keys.items()]
    words += [f'{name}={str(value).lower() if isinstance(value, bool) else value}'
              for name, value in changes.parameters.items()]
    words += [change.in_words() for change in changes.signals]
    return ' and '.join(words)
