# SPDX-License-Identifier: Apache-2.0
"""The Route of a car along a Journey: powers from the road load or from the source's consumption."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import JOULES_PER_WH
from bev_preheat.route.motion import propulsion_columns, road_vehicle
from bev_preheat.route.segments import make_route, Route

if TYPE_CHECKING:
    from pathlib import Path

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.route.sources.journey import Journey, RouteOptions
    from bev_preheat.vehicle.description import Vehicle

# Duration [s] of the segments that samples are joined to.
SEGMENT_S = 30.0
LEAST_DISTANCE_M = 10.0


def drive_journey(journey: Journey, vehicle: Vehicle, options: RouteOptions,
                  path: Path) -> tuple[Route, list[str]]:
    """
    Return the Route of a Vehicle along the Journey of a file, and remarks on how its powers were made.

    Raises InvalidInput if the ambient temperature, the road load or the meaning of a consumption is missing.
    """
    motion = journey.motion
    remarks = list(journey.remarks)
    if motion.distance_m[-1] < LEAST_DISTANCE_M:
        raise InvalidInput(f'{path}: this {journey.kind} is {motion.distance_m[-1]:.1f} m long; at least '
                           f'{LEAST_DISTANCE_M:g} m are needed; check column and unit of the speed')
    ambient_c = ambient_of(journey, options, path)
    columns: dict[str, FloatArray | None] = {
        'duration_s': motion.duration_s, 'speed_mps': motion.speed_mps, 'ambient_temperature_c': ambient_c,
        'cabin_heating_power_w': journey.cabin_heating_power_w,
        'auxiliary_power_w': journey.auxiliary_power_w}
    try:
        if journey.consumption_wh is None or vehicle.road_load is not None:
            columns.update(propulsion_columns(road_vehicle(vehicle), motion, ambient_c))
        if journey.consumption_wh is None:
            if options.with_auxiliaries is not None:
                raise InvalidInput('has no consumption; leave out --consumption')
            remarks.append(_road_load_remark(vehicle, journey))
        else:
            _use_consumption(columns, journey, vehicle, options, remarks)
        route = make_route(columns, vehicle.defaults)
    except InvalidInput as error:
        raise InvalidInput([f'{path}: {problem}' for problem in error.problems]) from error
    return route.resampled(SEGMENT_S) if journey.sampled else route, remarks


def ambient_of(journey: Journey, options: RouteOptions, path: Path) -> FloatArray:
    """Return the ambient temperatures [degC] of a Journey, shape (N,); raise InvalidInput without any."""
    count = len(journey.motion.duration_s)
    if journey.ambient_temperature_c is not None:
        if options.ambient_temperature_c is not None:
            raise InvalidInput(f'{path}: has its own ambient temperature; leave out --ambient')
        return journey.ambient_temperature_c
    if options.ambient_temperature_c is None:
        raise InvalidInput(f'{path}: this {journey.kind} has no ambient temperature; give it [degC], such as: '
                           '--ambient -5; in a scenario or an itinerary: ambient_temperature_c: -5 beside route')
    if not -60.0 <= options.ambient_temperature_c <= 60.0:
        raise InvalidInput(f'--ambient: {options.ambient_temperature_c:g} degC is not allowed; it must be '
                           '-60 ... 60 degC')
    return np.full(count, float(options.ambient_temperature_c))


def _road_load_remark(vehicle: Vehicle, journey: Journey) -> str:
    estimated = '' if journey.sampled else ', accelerations within the segments estimated'
    return (f'propulsion power: from the speeds of this {journey.kind} and the road_load of vehicle '
            f'{vehicle.name}{estimated}')


def _use_consumption(columns: dict[str, FloatArray | None], journey: Journey, vehicle: Vehicle,
                     options: RouteOptions, remarks: list[str]) -> None:
    """Replace the mean power by that of the source's consumption; variation is that of the road load."""
    consumption_wh, duration_s = journey.consumption_wh, journey.motion.duration_s
    assert consumption_wh is not None
    if options.with_auxiliaries is None:
        raise InvalidInput('the consumption in this file may include heating and auxiliaries, or be that of the '
                           'drivetrain alone; say which: --consumption total or --consumption drivetrain')
    mean_w = consumption_wh * JOULES_PER_WH / duration_s
    if options.with_auxiliaries:
        count = len(duration_s)
        for key in ('cabin_heating_power_w', 'auxiliary_power_w'):
            own = columns[key]
            mean_w = mean_w - (np.full(count, getattr(vehicle.defaults, key)) if own is None else own)
    rms_w, magnitude_w = np.abs(mean_w), np.abs(mean_w)
    if vehicle.road_load is not None:
        road_w = columns['propulsion_power_w']
        road_rms_w, road_magnitude_w = columns['propulsion_power_rms_w'], columns['propulsion_power_magnitude_w']
        assert road_w is not None and road_rms_w is not None and road_magnitude_w is not None
        variance_w2 = np.maximum(road_rms_w**2 - road_w**2, 0.0)
        rms_w = np.sqrt(mean_w**2 + variance_w2)
        # The difference between magnitude and mean is the energy braked and driven again.
        magnitude_w = np.clip(magnitude_w + road_magnitude_w - np.abs(road_w),
                              magnitude_w, rms_w)
    columns.update(propulsion_power_w=mean_w, propulsion_power_rms_w=rms_w,
                   propulsion_power_magnitude_w=magnitude_w)
    remarks.append('propulsion power: from the consumption in the file' + (
        ', less cabin heating and auxiliaries' if options.with_auxiliaries else ', of the drivetrain alone')
        + (f'; its variation from the road_load of vehicle {vehicle.name}' if vehicle.road_load else ''))
