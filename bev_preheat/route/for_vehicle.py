# SPDX-License-Identifier: Apache-2.0
"""
A route by name or file, for a given car.

A route file has fixed powers, which are valid for one car; a description of legs, and speeds of any
source (`sources`), are the same road for every car.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.route.csv_file import in_one_line, rounded, route_file, route_of_table
from bev_preheat.route.driven import drive_journey
from bev_preheat.route.legs import legs_file, load_legs
from bev_preheat.route.line import RouteLine
from bev_preheat.route.segments import Route
from bev_preheat.route.sources.journey import ChargingStop, Journey, RouteOptions
from bev_preheat.route.sources.registry import read_journey

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

LEGS_PREFIX = 'legs/'
LEGS_SUFFIXES = ('.yaml', '.yml')


@dataclass(frozen=True)
class RouteForVehicle:
    """
    A Route, and the car that its powers are valid for.

    `made_for` is the name of that vehicle, None if the file does not name it; `file` is the path;
    `warning` is a sentence if it is not the vehicle that will drive, else None. `line` is the route's line on the
    map, None if the file has no coordinates. `remarks` are sentences on how the powers were made, `stops` the
    charging stops of the file.
    """

    route: Route
    made_for: str | None
    file: Path
    warning: str | None
    line: RouteLine | None = None
    remarks: tuple[str, ...] = ()
    stops: tuple[ChargingStop, ...] = ()


def route_for(name_or_file: str | Path, vehicle: Vehicle,
              folder: Path | None = None, options: RouteOptions | None = None) -> RouteForVehicle:
    """
    Return the RouteForVehicle of a name or a file.

    A name is that of a file in config/routes, `legs/NAME` that of a description in
    config/routes/legs; a text with any other slash or with a suffix is a file of any format, relative
    to `folder` if given. `options` complete such a file. Raises InvalidInput naming
    file, place, value and allowed range.
    """
    is_legs, source = _source(name_or_file, folder)
    name = in_one_line(vehicle.name)
    options = options or RouteOptions()
    if is_legs:
        _refuse_options(legs_file(source), options)
        # Rounded as in a file, so that the plan equals that for the file made from the legs.
        return RouteForVehicle(rounded(load_legs(source, vehicle).route), name, legs_file(source),
                               None)
    file = route_file(source)
    journey = read_journey(file, options)
    if isinstance(journey, Journey):
        route, remarks = drive_journey(journey, vehicle, options, file)
        # Rounded, as from legs.
        return RouteForVehicle(rounded(route), name, file, None, journey.line, tuple(remarks), journey.stops)
    loaded = route_of_table(journey, vehicle.defaults)
    _refuse_options(file, options)
    return RouteForVehicle(loaded.route, loaded.made_for, file,
                           _warning(file, loaded.made_for, vehicle), stops=loaded.stops)


def route_source(name_or_file: str | Path) -> Path:
    """Return the path of the file that `route_for` reads; raise InvalidInput if it does not exist."""
    is_legs, source = _source(name_or_file)
    return legs_file(source) if is_legs else route_file(source)


def _source(name_or_file: str | Path, folder: Path | None = None) -> tuple[bool, str]:
    """Return whether it is a description of legs, and the name or file within that kind."""
    text = os.path.expanduser(str(name_or_file))
    legs_name = text.removeprefix(LEGS_PREFIX)
    if text.startswith(LEGS_PREFIX) and '/' not in legs_name and not Path(legs_name).suffix:
        return True, legs_name
    is_legs = Path(text).suffix.lower() in LEGS_SUFFIXES
    if is_legs and '/' not in text:
        # A text with a slash is a file, whatever its suffix.
        text = f'./{text}'
    if folder is not None and ('/' in text or Path(text).suffix):
        # Path('.') / text would lose the slash that makes it a file.
        text = os.path.join(folder, text)
    elif '/' not in text and Path(text).suffix and os.path.isfile(text):
        text = f'./{text}'
    return is_legs, text


def _refuse_options(file: Path, options: RouteOptions) -> None:
    """Raise InvalidInput if figures are given that the file has itself."""
    if options.ambient_temperature_c is not None:
        raise InvalidInput(f'{file}: has its own ambient temperature; leave out --ambient')
    if options != RouteOptions():
        raise InvalidInput(f'{file}: has powers; --consumption, --free-speed, --stop-duration and --vehicle-id do '
                           'not apply')


def _warning(file: Path, made_for: str | None, vehicle: Vehicle) -> str | None:
    name = in_one_line(vehicle.name)
    if made_for is None or made_for == name:
        return None
    return (f'route {file.stem} has the powers of vehicle {made_for}; for {name}: '
            f'{_advice(file, vehicle)}')


def _advice(file: Path, vehicle: Vehicle) -> str:
    """Return how to get the same road with the powers of the vehicle."""
    try:
        described = legs_file(file.stem)
    except InvalidInput:
        described = None
    if described is None or described.parent.parent != file.parent:
        return 'make it again from its legs or logs, with preheat route'
    if vehicle.road_load is None:
        return f'--route {LEGS_PREFIX}{file.stem}, once its file has a road_load'
    return f'--route {LEGS_PREFIX}{file.stem}'
