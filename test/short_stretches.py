# SPDX-License-Identifier: Apache-2.0
"""Trips with a short interval of high power, in which heating may be cheaper than at the end."""

from dataclasses import replace

import numpy as np

from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.situation import BatteryState, Goal
from bev_preheat.planning.trip import make_trip
from bev_preheat.route.segments import make_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.model import make_runge_kutta_4
from bev_preheat_studies.optimality.drawn_trips import scale_vehicle

# The limits of this vehicle are never active.
CAR = scale_vehicle(load_vehicle('reference'), 1.0, 1.0, 10.0)


def draw(number, steps=None):
    """Return (vehicle, route, state, goal) with a short interval of high power, drawn at random."""
    random = np.random.default_rng([41, number])
    efficiency = float(random.choice([0.4, 0.87]))
    vehicle = replace(CAR, hvch=replace(CAR.hvch, efficiency=efficiency))
    steps = steps or int(random.integers(40, 120))
    power_w = np.full(steps, random.uniform(5e3, 20e3))
    first = int(random.integers(0, steps))
    power_w[first:first + int(random.integers(1, max(2, steps // 10)))] = random.uniform(40e3, 180e3)
    ambient_c = float(random.uniform(-20.0, 5.0))
    route = make_route({
        'duration_s': [30.0], 'speed_mps': [25.0], 'propulsion_power_w': power_w,
        'ambient_temperature_c': [ambient_c], 'cabin_heating_power_w': [1500.0],
        'auxiliary_power_w': [400.0]}, vehicle.defaults)
    state = BatteryState(ambient_c, float(random.uniform(0.5, 0.95)))
    trip = make_trip(vehicle, route)
    coldest_c, warmest_c = (float(run_forward(
        trip, make_runge_kutta_4, state.soc, ambient_c, share * trip.heater_limit_w)[1][-1])
        for share in (0.0, 1.0))
    # Reached with part of the available heating.
    return vehicle, route, state, Goal(coldest_c + random.uniform(0.1, 0.9) * (warmest_c - coldest_c))
