# SPDX-License-Identifier: Apache-2.0
"""
A trip as the planner would have predicted it, from its first reading and its measured powers.

The powers are given as mean and root mean square of steps of 30 s, as in routes, and the step is that of plans
(`vehicle.heated_step`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.arithmetic import SATURATING_FLOATS
from bev_preheat.vehicle.heated_step import make_heated_step, sensor_reading_c

if TYPE_CHECKING:
    from bev_preheat.identification.trips import Trip
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.vehicle.description import Vehicle

PREDICTION_STEP_S = 30.0


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    Predicted course of a trip at `time_s` (M + 1,) [s].

    `reading_c` is the temperature sensor's [deg C], `temperature_c` the battery's, `soc` the state of charge.
    """

    time_s: FloatArray
    temperature_c: FloatArray
    reading_c: FloatArray
    soc: FloatArray


def step_edges(trip: Trip, step_s: float = PREDICTION_STEP_S) -> FloatArray:
    """Return the edges of steps of about `step_s` that divide a trip evenly [s], whole seconds, shape (M + 1,)."""
    count = max(1, round(len(trip) / step_s))
    return np.round(np.linspace(0.0, len(trip), count + 1))


def predict(vehicle: Vehicle, trip: Trip, start_c: float | None = None) -> Prediction:
    """Return the Prediction of a Trip with a Vehicle; it starts at the first reading, or at `start_c` [deg C]."""
    edges = step_edges(trip)
    durations_s = np.diff(edges)
    power_w, magnitude_w = trip.means(trip.power_w, edges), trip.means(np.abs(trip.propulsion_power_w), edges)
    variance_w2 = np.maximum(trip.means(trip.power_w**2, edges) - power_w**2, 0.0)
    gamma = vehicle.battery.leakage.coefficient_w_per_k(trip.means(trip.speed_mps, edges))
    heat_w = gamma * trip.means(trip.ambient_c, edges) + vehicle.drivetrain.heat_to_battery_w(magnitude_w)
    step = make_heated_step(vehicle, SATURATING_FLOATS)
    temperature_c = reading_c = trip.start_c if start_c is None else start_c
    soc, excess_k = float(trip.soc[0]), 0.0
    courses = [(temperature_c, reading_c, soc)]
    for duration_s, *inputs in zip(*map(np.ndarray.tolist, (
            durations_s, power_w, variance_w2, heat_w, gamma, trip.means(trip.heater_w, edges)))):
        before_c = temperature_c
        # The logged heater power is the electrical one, so only the coolant delays its heat.
        soc, temperature_c, _, excess_k, *_ = step(soc, temperature_c, inputs[-1], excess_k, duration_s, *inputs)
        reading_c = sensor_reading_c(
            vehicle.heat_path, reading_c, before_c, temperature_c, duration_s, SATURATING_FLOATS)
        courses.append((temperature_c, reading_c, soc))
    return Prediction(edges, *np.array(courses).T)
