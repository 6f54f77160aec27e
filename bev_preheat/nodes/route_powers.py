# SPDX-License-Identifier: Apache-2.0
"""Propulsion power of a RoutePlan that has none: from its speeds and slopes and the vehicle's road load."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.route.motion import elevation_of_slope, Motion, propulsion_columns, road_vehicle
from bev_preheat.route.segments import LIMITS, MOST_SEGMENTS, problem_with_values
from bev_preheat.route.sources.journey import SLOPE_RANGE

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_msgs.msg import RoutePlan

GIVEN = 'given in the route plan'
# Fields of Route needed for the road load, and those that it gives.
NEEDED = ('duration_s', 'speed_mps', 'ambient_temperature_c')
MADE = ('propulsion_power_w', 'propulsion_power_rms_w', 'propulsion_power_magnitude_w')


def without_powers(columns: dict[str, FloatArray]) -> bool:
    """Return whether the columns of a route have no propulsion power."""
    return not len(columns['propulsion_power_w'])


def slope_problems(message: RoutePlan) -> list[str]:
    """Return the problems of a RoutePlan's slope as sentences, except its length."""
    slope = np.asarray(message.slope, dtype=float)
    problem = problem_with_values(slope, SLOPE_RANGE) if len(slope) else None
    return [f'slope{problem} (rise over run)'] if problem else []


def powers_of_road_load(message: RoutePlan, columns: dict[str, FloatArray],
                        vehicle: Vehicle) -> tuple[dict[str, FloatArray], str]:
    """
    Return the columns of a RoutePlan with the powers of the road load of a Vehicle, and their source in words.

    Columns that make_route will refuse are returned as they are. Raises InvalidInput if the vehicle has no
    road_load, or if rms or magnitude are given without the mean power.
    """
    given = [name for name in ('propulsion_power_rms', 'propulsion_power_magnitude')
             if len(getattr(message, name))]
    if given:
        raise InvalidInput(f'{" and ".join(given)}: given without propulsion_power; give all three, or none')
    if any(not len(columns[field]) for field in NEEDED):
        return columns, ''
    try:
        car = road_vehicle(vehicle)
    except InvalidInput as error:
        raise InvalidInput([f'propulsion_power: empty, and {problem}' for problem in error.problems]) from error
    lengths = {len(columns[field]) for field in columns} | {len(message.slope)}
    count = max(lengths)
    if lengths - {0, 1, count} or count > MOST_SEGMENTS or any(
            problem_with_values(columns[field], LIMITS[field]) for field in NEEDED):
        if len(message.slope) not in (0, 1, count):
            raise InvalidInput(f'slope: has {len(message.slope)} values; it must have 1 or {count}, the length of '
                               'the longest array, or none')
        # Any power of a valid length: make_route names the problem.
        return {**columns, 'propulsion_power_w': np.zeros(1)}, ''
    duration_s, speed_mps, ambient_c = (np.broadcast_to(columns[field], count) for field in NEEDED)
    slope = np.broadcast_to(np.asarray(message.slope if len(message.slope) else [0.0], dtype=float), count)
    motion = Motion(duration_s, speed_mps, elevation_of_slope(duration_s, speed_mps, slope))
    source = (f'computed from speeds{" and slopes" if len(message.slope) else " (no slope: level road)"} and the '
              f'road_load of vehicle {vehicle.name}; accelerations within the segments are estimated')
    return {**columns, **propulsion_columns(car, motion, ambient_c)}, source
