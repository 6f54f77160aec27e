# SPDX-License-Identifier: Apache-2.0
"""Reads the battery output of SUMO (battery-export): speeds and consumption of a simulated vehicle."""

from __future__ import annotations

import numpy as np

from bev_preheat.errors import figure, InvalidInput, quoted
from bev_preheat.route.motion import Motion
from bev_preheat.route.segments import LIMITS, LONGEST_ROUTE_S
from bev_preheat.route.sources.journey import Journey, RouteOptions
from bev_preheat.route.sources.texts import check_xml
from bev_preheat.tables.numbers import NUMBER

KIND = 'SUMO battery output'
# Vehicles named in a message.
NAMED_VEHICLES = 8
# A stop with charging has no power for the drive; its energy is negative in the consumption.
CONSUMPTION_RANGE_WH = (-1e5, 1e5)


def read_sumo(text: bytes, options: RouteOptions) -> Journey:
    """Return the Journey of the only vehicle, or of that of the options; raise InvalidInput naming the line."""
    rows: dict[str, list[tuple[float, float, float]]] = {}
    time_s = [float('nan')]
    root: list[str] = []

    def on_element(name: str, attributes: dict[str, str], line: int) -> None:
        if not root:
            root.append(name)
        if name == 'timestep':
            time_s[0] = _number(attributes, 'time', name, line)
        elif name == 'vehicle':
            vehicle = attributes.get('id')
            if vehicle is None:
                raise InvalidInput(f'line {line}: vehicle: missing id')
            rows.setdefault(vehicle, []).append((
                time_s[0], _number(attributes, 'speed', name, line),
                _number(attributes, 'energyConsumed', name, line)))

    check_xml(text, on_element)
    if not rows:
        raise InvalidInput(f'{root[0] if root else "the file"}: has no vehicle with a battery; the simulation '
                           'needs --battery-output and a vehicle with has.battery.device')
    chosen = _chosen(rows, options)
    at_s, speed_mps, energy_wh = np.array(rows[chosen]).T
    if len(at_s) < 2:
        raise InvalidInput(f'vehicle {quoted(chosen)}: has {len(at_s)} timestep; at least 2 are needed')
    steps_s = np.diff(at_s)
    if not (steps_s > 0.0).all():
        at = int(np.argmin(steps_s > 0.0)) + 1
        raise InvalidInput(f'vehicle {quoted(chosen)}: timestep {at + 1}: time {figure(float(at_s[at]))} s is '
                           'not after the previous one')
    for name, values, (low, high) in (('speed', speed_mps, LIMITS['speed_mps']),
                                      ('energyConsumed', energy_wh, CONSUMPTION_RANGE_WH)):
        bad = ~((values >= low) & (values <= high))
        if bad.any():
            at = int(np.argmax(bad))
            raise InvalidInput(f'vehicle {quoted(chosen)}: timestep {at + 1}: {name}: '
                               f'{figure(float(values[at]))} is not allowed; it must be {low:g} ... {high:g}')
    if at_s[-1] - at_s[0] > LONGEST_ROUTE_S:
        raise InvalidInput(f'lasts {figure(float(at_s[-1] - at_s[0]))} s; at most {LONGEST_ROUTE_S:g} s are '
                           'planned')
    mean_mps = 0.5 * (speed_mps[1:] + speed_mps[:-1])
    # The energy of a timestep is that of the step that ends with it.
    return Journey(KIND, Motion(steps_s, mean_mps, np.zeros(len(at_s)), speed_mps), consumption_wh=energy_wh[1:],
                   remarks=(f'vehicle {chosen} of the simulation',), sampled=True)


def _chosen(rows: dict[str, list[tuple[float, float, float]]], options: RouteOptions) -> str:
    names = ', '.join(list(rows)[:NAMED_VEHICLES]) + (', …' if len(rows) > NAMED_VEHICLES else '')
    if options.vehicle_id is not None:
        if options.vehicle_id not in rows:
            raise InvalidInput(f'--vehicle-id: {quoted(options.vehicle_id)} is not in the file; it has: {names}')
        return options.vehicle_id
    if len(rows) > 1:
        raise InvalidInput(f'has {len(rows)} vehicles; choose one, such as: --vehicle-id {next(iter(rows))} (it '
                           f'has: {names})')
    return next(iter(rows))


def _number(attributes: dict[str, str], key: str, element: str, line: int) -> float:
    text = attributes.get(key)
    if text is None:
        raise InvalidInput(f'line {line}: {element}: missing {key}')
    match = NUMBER.fullmatch(text.strip())
    if match is None or match[2]:
        raise InvalidInput(f'line {line}: {element}: {key}: {quoted(text)} is not a number')
    return float(text)
