# SPDX-License-Identifier: Apache-2.0
"""The changes of `preheat replay`: other vehicle file, method, parameters, signals."""

from __future__ import annotations

import json
from typing import Any, TYPE_CHECKING

from bev_preheat.control.settings import FIELD_OF_PARAMETER
from bev_preheat.errors import InvalidInput, quoted

if TYPE_CHECKING:
    from argparse import Namespace

    from bev_preheat.replay.player import Changes
    from bev_preheat.replay.recordings import Planner

VEHICLE = 'vehicle'


def planner_of(arguments: Namespace) -> Planner:
    """Return the Planner of `--vehicle`, `--method` and `--set`; raises InvalidInput for unknown parameters."""
    from bev_preheat.replay.recordings import Planner
    parameters: dict[str, Any] = {}
    for text in arguments.parameters:
        name, sign, value = text.partition('=')
        if not sign or name not in FIELD_OF_PARAMETER:
            raise InvalidInput(f'--set: {quoted(text)} is not allowed; it must be PARAMETER=VALUE, with a '
                               f'parameter of {", ".join(FIELD_OF_PARAMETER)}')
        parameters[name] = _value('--set', name, value)
    if arguments.method is not None:
        parameters['method'] = _value('--method', 'method', arguments.method)
    return Planner(arguments.vehicle, parameters)


def changes_of(arguments: Namespace, planner: Planner) -> Changes:
    """Return the Changes of `--change`, on top of those of a Planner; raises InvalidInput, naming the change."""
    from bev_preheat.replay.player import Changes
    from bev_preheat.replay.signal_changes import signal_change, SIGNALS
    vehicle, parameters, signals = planner.vehicle, dict(planner.parameters), []
    for text in arguments.changes:
        name, sign, value = text.partition('=')
        if sign and name == VEHICLE:
            vehicle = value
        elif sign and name in FIELD_OF_PARAMETER:
            parameters[name] = _value('--change', name, value)
        elif sign and name in SIGNALS:
            try:
                signals.append(signal_change(name, value))
            except InvalidInput as error:
                raise InvalidInput(f'--change: {error}') from error
        else:
            raise InvalidInput(f'--change: {quoted(text)} is not allowed; it must be SIGNAL=+NUMBER, -NUMBER or '
                               f'*NUMBER with a signal of {", ".join(SIGNALS)}, or vehicle=FILE, or '
                               'PARAMETER=VALUE')
    return Changes(vehicle, parameters, tuple(signals))


def _value(option: str, name: str, text: str) -> Any:
    from bev_preheat.nodes.parameters import check, IN_WORDS
    from bev_preheat.nodes.planner_node import PARAMETERS
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
