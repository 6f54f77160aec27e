# SPDX-License-Identifier: Apache-2.0
"""Propulsion power of a car that drives segments with known speeds: mean, rms and mean magnitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.route.road_load import (
    air_density_kg_per_m3,
    battery_power_w,
    GRAVITY_MPS2,
    loaded,
    RoadForces,
    RoadVehicle,
    wheel_power_w,
)
from bev_preheat.route.speed_changes import speed_changes

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

# The wheel power within a segment has a Laplace distribution: the mean magnitude of v a is 0.65 ... 0.73 standard
# deviations in public drive cycles, 0.71 in theory (0.80 for a normal distribution). Its quantiles at the middles
# of equal probabilities, with variance 1.
QUANTILES = 32
_PROBABILITY = (np.arange(QUANTILES) + 0.5) / QUANTILES
_LAPLACE = np.sign(_PROBABILITY - 0.5) * -np.log(1.0 - 2.0 * np.abs(_PROBABILITY - 0.5))
DEVIATIONS = _LAPLACE / np.sqrt(np.mean(_LAPLACE**2))
# Largest difference in elevation on a route [m].
MOST_RISE_M = 6000.0
# Segments computed at once, so that a long route needs no more memory.
AT_ONCE = 10_000


@dataclass(frozen=True)
class Motion:
    """
    Motion of any car along N segments: durations and mean speeds, shapes (N,).

    `elevation_m` above sea level at the boundaries has shape (N + 1,). `boundary_speed_mps`, shape (N + 1,), are
    the
    speeds there if they are known.
    """

    duration_s: FloatArray
    speed_mps: FloatArray
    elevation_m: FloatArray
    boundary_speed_mps: FloatArray | None = None

    @property
    def distance_m(self) -> FloatArray:
        """Distance from the start at the boundaries [m], shape (N + 1,)."""
        return np.concatenate(([0.0], np.cumsum(self.duration_s * self.speed_mps)))


def elevation_of_slope(duration_s: FloatArray, speed_mps: FloatArray, slope: FloatArray) -> FloatArray:
    """
    Return the elevations [m] at the boundaries of N segments with slopes (rise over run), shape (N + 1,).

    The lowest place is at sea level. Raises InvalidInput if the road would be higher than any.
    """
    rise_m = duration_s * speed_mps * slope / np.hypot(1.0, slope)
    elevation_m = np.concatenate(([0.0], np.cumsum(rise_m)))
    elevation_m -= elevation_m.min()
    if elevation_m.max() > MOST_RISE_M:
        raise InvalidInput(f'slope: the road rises by {elevation_m.max():.0f} m in total; at most '
                           f'{MOST_RISE_M:g} m are plausible; it must be rise over run')
    return elevation_m


def road_vehicle(vehicle: Vehicle, load: RoadForces | None = None) -> RoadVehicle:
    """Return the RoadVehicle of a Vehicle; raise InvalidInput if it has no `road_load`."""
    if vehicle.road_load is None:
        raise InvalidInput(no_road_load(vehicle))
    return loaded(vehicle, load or RoadForces())


def no_road_load(vehicle: Vehicle) -> str:
    """Return the sentence on a vehicle without `road_load`."""
    return (f'vehicle {vehicle.name!r} has no road_load, so its power on a road is '
            'unknown; add it to the vehicle file, with the figures of the car, such as '
            'road_load: {mass_kg: 1900, frontal_area_m2: 2.4, drag_coefficient: 0.27, '
            'rolling_resistance: 0.010}')


def propulsion_columns(car: RoadVehicle, motion: Motion,
                       ambient_temperature_c: FloatArray) -> dict[str, FloatArray]:
    """
    Return the columns propulsion_power_w, _rms_w and _magnitude_w [W] of a Motion, each of shape (N,).

    `ambient_temperature_c` [deg C] has shape (N,).
    """
    duration_s, speed_mps, distance_m = motion.duration_s, motion.speed_mps, motion.distance_m
    changes = speed_changes(duration_s, speed_mps, motion.boundary_speed_mps)
    driven_m = np.diff(distance_m)
    rise_m = np.where(driven_m > 0.0, np.diff(motion.elevation_m), 0.0)
    sine = np.clip(rise_m / np.maximum(driven_m, 1e-9), -0.99, 0.99)
    slope = sine / np.sqrt(1.0 - sine**2)
    at_wheels_w = wheel_power_w(car, duration_s, distance_m, changes.boundary_speed_mps, motion.elevation_m,
                                slope, ambient_temperature_c)
    density = air_density_kg_per_m3(ambient_temperature_c, motion.elevation_m[:-1])
    drag = 0.5 * density * car.drag_area_m2
    # The mean of v^3 exceeds the cube of the mean speed by 3 v var(v).
    at_wheels_w += 3.0 * drag * speed_mps * changes.speed_variance_m2ps2
    force_n = car.mass_kg * GRAVITY_MPS2 * (car.rolling_resistance + sine) + 3.0 * drag * speed_mps**2
    deviation_w = np.sqrt(car.mass_kg**2 * changes.kinetic_power_variance
                          + force_n**2 * changes.speed_variance_m2ps2)
    mean_w, rms_w, magnitude_w = (np.empty(len(duration_s)) for _ in range(3))
    for start in range(0, len(duration_s), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        power_w = battery_power_w(car, at_wheels_w[part, np.newaxis]
                                  + deviation_w[part, np.newaxis] * DEVIATIONS)
        mean_w[part] = power_w.mean(axis=1)
        rms_w[part] = np.sqrt(np.mean(power_w**2, axis=1))
        magnitude_w[part] = np.abs(power_w).mean(axis=1)
    return {'propulsion_power_w': mean_w, 'propulsion_power_rms_w': rms_w,
            'propulsion_power_magnitude_w': magnitude_w}
