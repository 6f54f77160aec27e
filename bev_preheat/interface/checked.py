# SPDX-License-Identifier: Apache-2.0
"""Types of the arguments of the public functions, by name: a wrong type is refused with the allowed ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial, wraps
from importlib import import_module
from inspect import signature
from numbers import Integral, Real
import os
from typing import Any, NamedTuple, ParamSpec, TypeVar

from bev_preheat.errors import InvalidInput, quoted, shortened
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.route import Route
from bev_preheat.vehicle import Vehicle

Arguments = ParamSpec('Arguments')
Returned = TypeVar('Returned')
LONGEST_QUOTED = 60


class _Kind(NamedTuple):
    """The allowed values of an argument, as a function and as text."""

    is_allowed: Callable[[Any], bool]
    words: str


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _is_method(value: Any) -> bool:
    return isinstance(value, str) or callable(value)


def _is_list(value: Any, is_item: Callable[[Any], bool]) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, str) and all(map(is_item, value))


def _is_public(value: Any, name: str) -> bool:
    # Not all of them are needed at once.
    return isinstance(value, getattr(import_module('bev_preheat'), name))


def _has_numbers(value: Any, kind: type) -> bool:
    return isinstance(value, kind) and all(isinstance(field, bool) or _is_number(field)
                                           for field in vars(value).values())


NUMBER = _Kind(_is_number, 'a number')
FILE = _Kind(lambda value: isinstance(value, str | os.PathLike), 'a name or a path (text)')
KINDS = {
    'vehicle': _Kind(lambda value: isinstance(value, Vehicle), 'a Vehicle, as load_vehicle returns'),
    'route': _Kind(lambda value: isinstance(value, Route), 'a Route, as load_route returns'),
    'state': _Kind(lambda value: _has_numbers(value, BatteryState),
                   'a BatteryState with numbers, such as BatteryState(-7.0, 0.9)'),
    'goal': _Kind(lambda value: _is_number(value) or _has_numbers(value, Goal), 'a Goal or a number [deg C]'),
    'method': _Kind(_is_method, 'the name of a method, or a function of a MethodSituation'),
    'methods': _Kind(lambda value: _is_list(value, _is_method), 'a list of names or functions'),
    'recordings': _Kind(lambda value: _is_list(value, partial(_is_public, name='Recording')),
                        'a list of Recordings, as load_recording returns'),
    'mismatch': _Kind(lambda value: _is_public(value, 'Mismatch'), 'a Mismatch'),
    'sensors': _Kind(lambda value: _is_public(value, 'Sensors'), 'Sensors'),
    'heater_faults': _Kind(lambda value: _is_list(value, partial(_is_public, name='HeaterFault')),
                           'a list of HeaterFaults'),
    'columns': _Kind(lambda value: isinstance(value, Mapping), 'a dictionary of columns by name'),
    'name_or_file': FILE, 'file': FILE, 'signals': FILE,
    'seed': _Kind(lambda value: isinstance(value, Integral), 'a whole number'),
    **dict.fromkeys(('charger_power_w', 'departure_soc', 'ambient_c', 'cabin_heating_power_w', 'auxiliary_power_w',
                     'energy_price_per_kwh', 'value_of_time_per_h', 'free_speed_kmh', 'stop_duration_s'), NUMBER),
    **dict.fromkeys(('trips', 'feasible', 'jobs', 'leg'), _Kind(
        lambda value: isinstance(value, Integral), 'a whole number')),
    **dict.fromkeys(('repair', 'estimation', 'limits'), _Kind(
        lambda value: isinstance(value, bool), 'True or False')),
}


def checked(function: Callable[Arguments, Returned]) -> Callable[Arguments, Returned]:
    """Return a function that raises InvalidInput, one problem an argument, if one in KINDS has a wrong type."""
    parameters = signature(function)
    optional = {name for name, parameter in parameters.parameters.items() if 'None' in str(parameter.annotation)}

    @wraps(function)
    def call(*given: Arguments.args, **named: Arguments.kwargs) -> Returned:
        bound = parameters.bind(*given, **named)
        problems = [f'{name}: must be {KINDS[name].words}, not {_in_words(value)}'
                    for name, value in bound.arguments.items()
                    if name in KINDS and not (value is None and name in optional)
                    and not KINDS[name].is_allowed(value)]
        if problems:
            raise InvalidInput(problems)
        return function(*given, **named)

    return call


def _in_words(value: Any) -> str:
    """Return a value and its type for a message."""
    return f'{type(value).__name__} {quoted(shortened(str(value), LONGEST_QUOTED))}'
