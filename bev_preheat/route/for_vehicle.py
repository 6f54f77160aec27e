# SPDX-License-Identifier: Apache-2.0
"""
A route by name or file, for a given car.

A route file has fixed powers, which are valid for one car; a description of legs, and speeds of any
source (`sources`), are the same road for every car. Their powers come from the road load or from the source's
consumption.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields
import os
from pathlib import Path
from typing import Any

import numpy as np

from bev_preheat.errors import InvalidInput, located
from bev_preheat.numerics import FloatArray, JOULES_PER_WH
from bev_preheat.route.csv_file import in_one_line, rounded, route_file, route_of_table
from bev_preheat.route.legs import legs_file, load_legs
from bev_preheat.route.line import RouteLine
from bev_preheat.route.road_load import propulsion_columns
from bev_preheat.route.segments import make_route, Route
from bev_preheat.route.sources.journey import ChargingStop, Journey, RouteOptions, SEGMENT_S, SLOPE_RANGE
from bev_preheat.route.sources.registry import read_journey
from bev_preheat.vehicle.description import Vehicle

AMBIENT = 'ambient_temperature_c'
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

    A name is that of a file in config/routes, `legs/NAME` that of a description in config/routes/legs; a text with
    any other slash or with a suffix is a file of any format, relative to `folder` if given. `options` complete
    such a file. Raises InvalidInput naming file, place, value and allowed range.
    """
    is_legs, source = _source(name_or_file, folder)
    name = in_one_line(vehicle.name)
    options = options or RouteOptions()
    if is_legs:
        # Rounded as in a file, so that the plan equals that for the file made from the legs.
        route = rounded(load_legs(source, vehicle).route)
        _refuse_options(legs_file(source), options)
        return RouteForVehicle(route, name, legs_file(source), None)
    file = route_file(source)
    journey = read_journey(file, options)
    if isinstance(journey, Journey):
        route, remarks = drive_journey(journey, vehicle, options, file)
        # Rounded, as from legs.
        return RouteForVehicle(rounded(route), name, file, None, journey.line, tuple(remarks), journey.stops)
    route, made_for, stops = route_of_table(journey, vehicle.defaults)
    _refuse_options(file, options)
    return RouteForVehicle(route, made_for, file, _warning(file, made_for, vehicle), stops=stops)


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
        raise InvalidInput(f'{file}: has its own ambient temperature; leave out {options.name(AMBIENT)}')
    for each in fields(RouteOptions):
        if each.compare and getattr(options, each.name) is not None:
            raise InvalidInput(f'{file}: has powers; leave out {options.name(each.name)}')


def _warning(file: Path, made_for: str | None, vehicle: Vehicle) -> str | None:
    """Return a sentence if the powers of a route file are those of another vehicle."""
    name = in_one_line(vehicle.name)
    if made_for is None or made_for == name:
        return None
    # The same road with the powers of this vehicle.
    advice = 'make it again from its legs or logs, with preheat route'
    with suppress(InvalidInput):
        if legs_file(file.stem).parent.parent == file.parent:
            advice = f'--route {LEGS_PREFIX}{file.stem}' + (
                ', once its file has a road_load' if vehicle.road_load is None else '')
    return f'route {file.stem} has the powers of vehicle {made_for}; for {name}: {advice}'


LEAST_DISTANCE_M = 10.0
# Elevations of segments may be wrong by this.
ELEVATION_ERROR_M = 10.0


def drive_journey(journey: Journey, vehicle: Vehicle, options: RouteOptions,
                  path: Path) -> tuple[Route, list[str]]:
    """Return the Route of a Vehicle along a Journey, and remarks; raise InvalidInput if a figure is missing."""
    motion = journey.motion
    remarks = list(journey.remarks)
    if motion.distance_m[-1] < LEAST_DISTANCE_M:
        raise InvalidInput(f'{path}: this {journey.kind} is {motion.distance_m[-1]:.1f} m long; at least '
                           f'{LEAST_DISTANCE_M:g} m are needed; check column and unit of the speed')
    rise_m, length_m = np.diff(motion.elevation_m), np.diff(motion.distance_m)
    at = int(np.argmax(beyond_m := np.abs(rise_m) - SLOPE_RANGE[1] * length_m))
    if beyond_m[at] > ELEVATION_ERROR_M:
        remarks.append(f'the elevation changes by {rise_m[at]:.0f} m over {length_m[at]:.0f} m at '
                       f'km {motion.distance_m[at] / 1e3:.1f}; roads have at most {100.0 * SLOPE_RANGE[1]:g} %; '
                       'correct the elevations, also those of tunnels and bridges')
    ambient_c = ambient_of(journey, options, path)
    columns: dict[str, Any] = {
        'duration_s': motion.duration_s, 'speed_mps': motion.speed_mps, 'ambient_temperature_c': ambient_c,
        'cabin_heating_power_w': journey.cabin_heating_power_w,
        'auxiliary_power_w': journey.auxiliary_power_w}
    with located(path):
        if journey.consumption_wh is None or vehicle.road_load is not None:
            columns.update(propulsion_columns(vehicle, motion, ambient_c))
        if journey.consumption_wh is None:
            if options.with_auxiliaries is not None:
                raise InvalidInput(f'has no consumption; leave out {options.name("with_auxiliaries")}')
            estimated = '' if journey.sampled else ', accelerations within the segments estimated'
            remarks.append(f'propulsion power: from the speeds of this {journey.kind} and the road_load of '
                           f'vehicle {vehicle.name}{estimated}')
        else:
            _use_consumption(columns, journey.consumption_wh, vehicle, options, remarks)
        route = make_route(columns, vehicle.defaults)
    return route.resampled(SEGMENT_S) if journey.sampled else route, remarks


def ambient_of(journey: Journey, options: RouteOptions, path: Path) -> FloatArray:
    """Return the ambient temperatures [degC] of a Journey, shape (N,); raise InvalidInput without any."""
    count = len(journey.motion.duration_s)
    if journey.ambient_temperature_c is not None:
        if options.ambient_temperature_c is not None:
            raise InvalidInput(f'{path}: has its own ambient temperature; leave out {options.name(AMBIENT)}')
        return journey.ambient_temperature_c
    if options.ambient_temperature_c is None:
        raise InvalidInput(f'{path}: this {journey.kind} has no ambient temperature; '
                           + options.advice(AMBIENT, 'give it'))
    if not -60.0 <= options.ambient_temperature_c <= 60.0:
        raise InvalidInput(f'{options.name(AMBIENT)}: {options.ambient_temperature_c:g} degC is not allowed; it '
                           'must be -60 ... 60 degC')
    return np.full(count, float(options.ambient_temperature_c))


def _use_consumption(columns: dict[str, Any], consumption_wh: FloatArray, vehicle: Vehicle,
                     options: RouteOptions, remarks: list[str]) -> None:
    """Replace the mean power by that of the source's consumption; variation is that of the road load."""
    if options.with_auxiliaries is None:
        raise InvalidInput('the consumption in this file may include heating and auxiliaries, or be that of the '
                           f'drivetrain alone; {options.advice("with_auxiliaries", "say which")}')
    mean_w = consumption_wh * JOULES_PER_WH / columns['duration_s']
    if options.with_auxiliaries:
        for key in ('cabin_heating_power_w', 'auxiliary_power_w'):
            own = columns[key]
            mean_w = mean_w - (getattr(vehicle.defaults, key) if own is None else own)
    rms_w, magnitude_w = np.abs(mean_w), np.abs(mean_w)
    if vehicle.road_load is not None:
        road_w = columns['propulsion_power_w']
        road_rms_w, road_magnitude_w = columns['propulsion_power_rms_w'], columns['propulsion_power_magnitude_w']
        variance_w2 = np.maximum(road_rms_w**2 - road_w**2, 0.0)
        rms_w = np.sqrt(mean_w**2 + variance_w2)
        # The difference between magnitude and mean is the energy braked and driven again.
        magnitude_w = np.clip(magnitude_w + road_magnitude_w - np.abs(road_w), magnitude_w, rms_w)
    columns.update(propulsion_power_w=mean_w, propulsion_power_rms_w=rms_w,
                   propulsion_power_magnitude_w=magnitude_w)
    remarks.append('propulsion power: from the consumption in the file' + (
        ', less cabin heating and auxiliaries' if options.with_auxiliaries else ', of the drivetrain alone')
        + (f'; its variation from the road_load of vehicle {vehicle.name}' if vehicle.road_load else ''))
