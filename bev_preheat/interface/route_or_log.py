# SPDX-License-Identifier: Apache-2.0
"""A route for people: a drive log that is given as one is named in the refusal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.route import route_for
from bev_preheat.route.for_vehicle import route_source

if TYPE_CHECKING:
    from pathlib import Path

    from bev_preheat.route.for_vehicle import RouteForVehicle
    from bev_preheat.route.sources.journey import RouteOptions
    from bev_preheat.vehicle import Vehicle

# Larger files [bytes] that are no routes are not read a second time.
LARGEST_LOG = 32_000_000


def route_or_log(name_or_file: str | Path, vehicle: Vehicle, options: RouteOptions) -> RouteForVehicle:
    """Return the RouteForVehicle of `route_for`; if a file is refused and is a drive log, InvalidInput says so."""
    try:
        return route_for(name_or_file, vehicle, options=options)
    except InvalidInput as error:
        # An unknown name is refused here again, as before.
        file = route_source(name_or_file)
        if not _is_drive_log(file):
            raise
        raise type(error)([f'{file}: is a drive log, no route; preheat route --log {file} --vehicle NAME --output '
                           'ROUTE.csv makes a route of it', *error.problems]) from error


def _is_drive_log(file: Path) -> bool:
    """Return whether a file that is no route has readings of a battery."""
    if file.stat().st_size > LARGEST_LOG:
        return False
    # Most routes are read at once.
    from bev_preheat.logs.reading import read_recording
    try:
        signals = read_recording(file).signals
    except InvalidInput:
        return False
    return bool({'battery_temperature_c', 'soc'} & signals.keys())
