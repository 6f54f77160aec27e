# SPDX-License-Identifier: Apache-2.0
"""Reads the battery output of SUMO (battery-export): speeds and consumption of a simulated vehicle."""

from __future__ import annotations

from dataclasses import replace

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.table import Table
from bev_preheat.files.units import split_unit
from bev_preheat.route.sources.headers import column, headers_of
from bev_preheat.route.sources.journey import Journey, RouteOptions
from bev_preheat.route.sources.table import journey_of_table
from bev_preheat.route.sources.texts import check_xml

KIND = 'SUMO battery output'
# Vehicles named in a message.
NAMED_VEHICLES = 8
HEADER = ('time_s', 'speed_mps', 'consumption_wh')


def read_sumo(text: bytes, options: RouteOptions) -> Journey:
    """Return the Journey of the only vehicle, or of that of the options; refuse others by timestep."""
    rows: dict[str, list[tuple[str, str, str]]] = {}
    time = ['']
    root: list[str] = []

    def on_element(name: str, attributes: dict[str, str], line: int) -> None:
        if not root:
            root.append(name)
        if name == 'timestep':
            time[0] = attributes.get('time', '')
        elif name == 'vehicle':
            missing = [key for key in ('id', 'speed', 'energyConsumed') if key not in attributes]
            if missing:
                raise InvalidInput(f'line {line}: vehicle: missing {missing[0]}')
            rows.setdefault(attributes['id'], []).append(
                (time[0], attributes['speed'], attributes['energyConsumed']))

    check_xml(text, on_element)
    if not rows:
        raise InvalidInput(f'{root[0] if root else "the file"}: has no vehicle with a battery; the simulation '
                           'needs --battery-output and a vehicle with has.battery.device')
    chosen = _chosen(rows, options)
    table = Table(f'vehicle {quoted(chosen)}', HEADER, tuple(split_unit(name).unit for name in HEADER),
                  tuple(zip(*rows[chosen])), range(len(rows[chosen])), row_name='timestep')
    journey = journey_of_table(table)
    energy_wh = column(table, headers_of(table)[0]['consumption'])
    # The energy of a timestep is that of the step that ends with it.
    return replace(journey, kind=KIND, consumption_wh=energy_wh[1:],
                   remarks=(f'vehicle {chosen} of the simulation',))


def _chosen(rows: dict[str, list[tuple[str, str, str]]], options: RouteOptions) -> str:
    names = ', '.join(list(rows)[:NAMED_VEHICLES]) + (', …' if len(rows) > NAMED_VEHICLES else '')
    if options.vehicle_id is not None:
        if options.vehicle_id not in rows:
            raise InvalidInput(f'--vehicle-id: {quoted(options.vehicle_id)} is not in the file; it has: {names}')
        return options.vehicle_id
    if len(rows) > 1:
        raise InvalidInput(f'has {len(rows)} vehicles; choose one, such as: --vehicle-id {next(iter(rows))} (it '
                           f'has: {names})')
    return next(iter(rows))
