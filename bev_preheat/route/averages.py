# SPDX-License-Identifier: Apache-2.0
"""Compares the powers of samples of the speed with the estimate from mean speeds of longer segments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics.factors import JOULES_PER_WH
from bev_preheat.route.motion import Motion, propulsion_columns, road_vehicle
from bev_preheat.route.road_load import battery_power_w, wheel_power_w
from bev_preheat.route.speed_changes import FULLY_SAMPLED_S

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle


@dataclass(frozen=True)
class Comparison:
    """Energy [Wh], mean magnitude [W] and root mean square [W] of the propulsion power of a whole drive."""

    energy_wh: float
    magnitude_w: float
    rms_w: float

    @classmethod
    def of(cls, duration_s: FloatArray, columns: dict[str, FloatArray]) -> Comparison:
        """Return the figures of columns of propulsion power over segments, shapes (N,)."""
        total_s = float(duration_s.sum())
        return cls(float(columns['propulsion_power_w'] @ duration_s) / JOULES_PER_WH,
                   float(columns['propulsion_power_magnitude_w'] @ duration_s) / total_s,
                   float(np.sqrt(columns['propulsion_power_rms_w']**2 @ duration_s / total_s)))


def compare_averages(motion: Motion, vehicle: Vehicle, ambient_temperature_c: FloatArray,
                     step_s: float) -> tuple[Comparison, Comparison, Comparison]:
    """
    Return the figures of a Motion of samples, of the estimate from mean speeds over `step_s`, and without it.

    The last are those of the mean speeds alone, without accelerations. Raises InvalidInput if the samples are
    too far apart.
    """
    if motion.boundary_speed_mps is None or motion.duration_s.max() > FULLY_SAMPLED_S:
        raise InvalidInput(f'--averages: needs a drive cycle with a sample every {FULLY_SAMPLED_S:g} s or more '
                           'often')
    if not FULLY_SAMPLED_S < step_s <= 3600.0:
        raise InvalidInput(f'--averages: {step_s:g} s is not allowed; it must be above {FULLY_SAMPLED_S:g}, at '
                           'most 3600 s')
    car = road_vehicle(vehicle)
    exact = Comparison.of(motion.duration_s, propulsion_columns(car, motion, ambient_temperature_c))
    time_s = np.concatenate(([0.0], np.cumsum(motion.duration_s)))
    edges_s = np.append(np.arange(0.0, time_s[-1] - FULLY_SAMPLED_S, step_s), time_s[-1])
    duration_s = np.diff(edges_s)
    speed_mps = np.diff(np.interp(edges_s, time_s, motion.distance_m)) / duration_s
    elevation_m = np.interp(edges_s, time_s, motion.elevation_m)
    ambient_c = np.interp(edges_s[:-1], time_s[:-1], ambient_temperature_c)
    means = Motion(duration_s, speed_mps, elevation_m)
    estimated = Comparison.of(duration_s, propulsion_columns(car, means, ambient_c))
    distance_m = means.distance_m
    power_w = battery_power_w(car, wheel_power_w(
        car, duration_s, distance_m, np.zeros(len(edges_s)), elevation_m, np.zeros(len(duration_s)), ambient_c))
    plain = Comparison.of(duration_s, {
        'propulsion_power_w': power_w, 'propulsion_power_rms_w': np.abs(power_w),
        'propulsion_power_magnitude_w': np.abs(power_w)})
    return exact, estimated, plain
