# SPDX-License-Identifier: Apache-2.0
"""The changes of `preheat replay`: other vehicle file, method, parameters, signals."""

from __future__ import annotations

from difflib import get_close_matches
import json
from typing import Any, TYPE_CHECKING

from bev_preheat.control.settings import FIELD_OF_PARAMETER
from bev_preheat.errors import InvalidInput, quoted

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.recording.player import Changes
    from bev_preheat.recording.recordings import Planner

VEHICLE = 'vehicle'


def planner_of(arguments: Namespace) -> Planner:
    """Return the Planner of `--vehicle`, `--method` and `--set`; raises InvalidInput for unknown parameters."""
    from bev_preheat.recording.recordings import Planner
    parameters: dict[str, Any] = {}
    for text in arguments.parameters:
        name, sign, value = text.partition('=')
        if not sign or name not in FIELD_OF_PARAMETER:
            raise InvalidInput(f'--set: {quoted(text)} is not allowed{_meant(name)}; it must be PARAMETER=VALUE, '
                               f'with a parameter of {", ".join(FIELD_OF_PARAMETER)}')
        parameters[name] = _value('--set', name, value)
    if arguments.method is not None:
        parameters['method'] = _value('--method', 'method', arguments.method)
    return Planner(arguments.vehicle, parameters)


def changes_of(arguments: Namespace, planner: Planner) -> Changes:
    """Return the Changes of `--change`, on top of those of a Planner; raises InvalidInput, naming the change."""
    from bev_preheat.recording.player import Changes
    from bev_preheat.recording.signal_changes import ALIASES, signal_change, SIGNALS
    vehicle, parameters = planner.vehicle, dict(planner.parameters)
    signals, keys = [], dict[str, Any]()
    for text in arguments.changes:
        name, sign, value = text.partition('=')
        name = ALIASES.get(name, name)
        if sign and name == VEHICLE:
            vehicle = value
        elif sign and name in FIELD_OF_PARAMETER:
            parameters[name] = _value('--change', name, value)
        elif sign and name in SIGNALS:
            try:
                signals.append(signal_change(name, value))
            except InvalidInput as error:
                raise InvalidInput(f'--change: {error}') from error
        elif sign and '.' in name:
            keys[name] = _number_or_text(value)
        else:
            raise InvalidInput(f'--change: {quoted(text)} is not allowed{_meant(name)}; it must be SIGNAL=VALUE, '
                               f'=+NUMBER, =-NUMBER or =*NUMBER with a signal of {_signals_with_units()}, or '
                               'vehicle=FILE, or KEY=VALUE with a dotted key of the vehicle file, or '
                               'PARAMETER=VALUE')
    return Changes(vehicle, keys, parameters, tuple(signals))


def _signals_with_units() -> str:
    from bev_preheat.recording.signal_changes import UNITS
    return ', '.join(f'{signal} [{unit or "0 ... 1"}]' for signal, (unit, _, _) in UNITS.items())


def _meant(name: str) -> str:
    """Return the names that a person may have meant, as a part of a message; '' for none."""
    from bev_preheat.recording.signal_changes import ALIASES, SIGNALS
    from bev_preheat.recording.vehicle_keys import keys_of_text
    from bev_preheat.vehicle import vehicle_contents
    meant: dict[str, str] = {known: known for known in (*FIELD_OF_PARAMETER, VEHICLE)}
    meant |= {known: f'--change {ALIASES.get(known, known)}' for known in (*SIGNALS, *ALIASES)}
    # Keys by their last part too.
    for key in keys_of_text(vehicle_contents('reference').decode()):
        for known in (key, key.rpartition('.')[2]):
            meant.setdefault(known, f'--change {key}')
    near = dict.fromkeys(meant[known] for known in get_close_matches(name, meant, 3, 0.6))
    return f'; did you mean {" or ".join(f"{each}=..." for each in near)}?' if near else ''


def _number_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _value(option: str, name: str, text: str) -> Any:
    from bev_preheat.nodes.parameters import check, IN_WORDS
    from bev_preheat.nodes.planner_parameters import PARAMETERS
    [parameter] = [each for each in PARAMETERS if each.name == name]
    kind = type(parameter.default)
    try:
        value = text if kind is str else float(text) if kind is float else json.loads(text)
    except ValueError:
        value = None
    if not isinstance(value, kind):
        raise InvalidInput(f'{option}: {name}: {quoted(text)} is not allowed; it must be {IN_WORDS[kind]}')
    check([parameter], {name: value})
    return value
