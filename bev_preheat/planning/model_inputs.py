# SPDX-License-Identifier: Apache-2.0
"""The model's inputs in each step of a route, without battery heating, and the steps that the model can take."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.tunables import LONGEST_STEP_S, TIME_CONSTANT_SHARE
from bev_preheat.vehicle.model import idle_heat_w, idle_power_w
from bev_preheat.vehicle.trip_columns import TripColumns

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle


def model_inputs(vehicle: Vehicle, route: Route, heater_share: float,
                 heat_lag_s: float) -> tuple[Route, TripColumns]:
    """Return a route, with long segments divided, and its TripColumns; see `trip.make_trip`."""
    whole, leakage = route, vehicle.battery.leakage
    leakage_w_per_k = leakage.coefficient_w_per_k(whole.speed_mps)
    route = whole.divided(_longest_steps_s(vehicle, leakage_w_per_k))
    if route is not whole:
        leakage_w_per_k = leakage.coefficient_w_per_k(route.speed_mps)
    drivetrain_heat_w = vehicle.drivetrain.heat_to_battery_w(route.propulsion_power_magnitude_w)
    heater_limit_w = heater_share * np.maximum(
        vehicle.hvch.maximum_power_w - route.cabin_heating_power_w, 0.0)
    if heat_lag_s > 0.0:
        heater_limit_w = _in_time(route, heat_lag_s) * heater_limit_w
    return route, TripColumns.of_columns(
        route.time_s, route.duration_s,
        idle_power_w(route.propulsion_power_w, route.cabin_heating_power_w, route.auxiliary_power_w),
        route.propulsion_power_variance_w2,
        idle_heat_w(leakage_w_per_k, route.ambient_temperature_c, drivetrain_heat_w),
        leakage_w_per_k, heater_limit_w, route.propulsion_power_w, drivetrain_heat_w,
        route.ambient_temperature_c)


def _in_time(route: Route, heat_lag_s: float) -> BoolArray:
    """Return the steps (N,) whose heat mostly arrives before the end."""
    left_s = route.total_duration_s - route.time_s[1:] + 0.5 * route.duration_s
    in_time: BoolArray = left_s > heat_lag_s
    return in_time


def _longest_steps_s(vehicle: Vehicle, leakage_w_per_k: FloatArray) -> FloatArray | float:
    """Return the longest step for integrating the model [s], for each leakage (N,) or for all."""
    stiff = stiff_w_per_k(vehicle)
    if leakage_w_per_k.max() <= stiff:
        return LONGEST_STEP_S
    return LONGEST_STEP_S * np.minimum(1.0, stiff / np.maximum(leakage_w_per_k, stiff))


def stiff_w_per_k(vehicle: Vehicle) -> float:
    """Return the leakage above which steps must be shorter [W/K]."""
    return (TIME_CONSTANT_SHARE / LONGEST_STEP_S) * vehicle.battery.heat_capacity_j_per_k
