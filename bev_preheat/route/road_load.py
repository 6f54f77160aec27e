# SPDX-License-Identifier: Apache-2.0
"""Power for driving: inertia, slope, rolling and air resistance, drivetrain."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

GRAVITY_MPS2 = 9.80665
# International standard atmosphere (ISO 2533): pressure over elevation in the troposphere.
SEA_LEVEL_PRESSURE_PA = 101325.0
PRESSURE_PER_M = 2.25577e-5
PRESSURE_EXPONENT = 5.25588
GAS_CONSTANT_OF_AIR = 287.05
KELVIN_AT_0_C = 273.15


@dataclass(frozen=True)
class RoadVehicle:
    """
    Road load of a loaded car.

    `drag_area_m2` is drag coefficient times frontal area. `drivetrain_efficiency` applies from
    battery to wheel when driving and from wheel to battery when braking;
    `maximum_regeneration_power_w` is electrical, the friction brakes take the rest.
    """

    mass_kg: float
    drag_area_m2: float
    rolling_resistance: float
    drivetrain_efficiency: float
    maximum_regeneration_power_w: float


@dataclass(frozen=True)
class RoadForces:
    """Additional road load of a trip: payload, a roof box, snow on the road."""

    payload_kg: float = 0.0
    additional_drag_area_m2: float = 0.0
    rolling_resistance_factor: float = 1.0


def loaded(vehicle: Vehicle, load: RoadForces, maximum_regeneration_power_w: float = inf) -> RoadVehicle:
    """
    Return the RoadVehicle of a Vehicle that has a `road_load`, with RoadForces.

    `maximum_regeneration_power_w` [W] is the trip's; the lower of the trip's and the vehicle's
    applies.
    """
    road_load, drivetrain = vehicle.road_load, vehicle.drivetrain
    assert road_load is not None
    return RoadVehicle(
        mass_kg=road_load.mass_kg + load.payload_kg,
        drag_area_m2=(road_load.drag_coefficient * road_load.frontal_area_m2
                      + load.additional_drag_area_m2),
        rolling_resistance=road_load.rolling_resistance * load.rolling_resistance_factor,
        drivetrain_efficiency=drivetrain.efficiency,
        maximum_regeneration_power_w=min(drivetrain.maximum_regeneration_power_w,
                                         maximum_regeneration_power_w))


def air_density_kg_per_m3(ambient_temperature_c: FloatArray,
                          elevation_m: FloatArray) -> FloatArray:
    """Return the density of dry air [kg/m^3] at a temperature [deg C] and an elevation [m]."""
    pressure_pa = SEA_LEVEL_PRESSURE_PA * (1.0 - PRESSURE_PER_M * elevation_m)**PRESSURE_EXPONENT
    return pressure_pa / (GAS_CONSTANT_OF_AIR * (ambient_temperature_c + KELVIN_AT_0_C))


def wheel_power_w(vehicle: RoadVehicle, duration_s: FloatArray, distance_m: FloatArray,
                  speed_mps: FloatArray, elevation_m: FloatArray, slope: FloatArray,
                  ambient_temperature_c: FloatArray, headwind_mps: float = 0.0) -> FloatArray:
    """
    Return the mean power at the wheels [W] in each of N steps, shape (N,); negative when braking.

    `duration_s`, `slope` (rise over run) and `ambient_temperature_c` have shape (N,);
    `distance_m`, `speed_mps` and `elevation_m` (above sea level) have shape (N + 1,): the instants
    between the steps. Kinetic, potential and rolling energy are exact; the air resistance is that
    of the step's mean speed.
    """
    driven_m = np.diff(distance_m)
    mean_mps = driven_m / duration_s
    kinetic_j = 0.5 * vehicle.mass_kg * np.diff(speed_mps**2)
    weight_n = vehicle.mass_kg * GRAVITY_MPS2
    potential_j = weight_n * np.diff(elevation_m)
    rolling_j = vehicle.rolling_resistance * weight_n / np.hypot(1.0, slope) * driven_m
    density = air_density_kg_per_m3(
        ambient_temperature_c, 0.5 * (elevation_m[:-1] + elevation_m[1:]))
    air_mps = mean_mps + headwind_mps
    air_n = 0.5 * density * vehicle.drag_area_m2 * air_mps * np.abs(air_mps)
    return (kinetic_j + potential_j + rolling_j + air_n * driven_m) / duration_s


def battery_power_w(vehicle: RoadVehicle, power_at_wheels_w: FloatArray) -> FloatArray:
    """Return the electrical power of the drivetrain [W]; negative = regeneration; shape follows the input."""
    efficiency = vehicle.drivetrain_efficiency
    return np.where(
        power_at_wheels_w > 0.0,
        power_at_wheels_w / efficiency,
        np.maximum(power_at_wheels_w * efficiency, -vehicle.maximum_regeneration_power_w))
