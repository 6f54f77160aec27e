# SPDX-License-Identifier: Apache-2.0
"""A recorded drive replayed to the planner's step, with the estimation running and without."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.events import BatteryStateArrived, RouteArrived
from bev_preheat.control.inputs import Leg, Measurement, Mission
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.identification.prediction import step_edges
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import make_route

if TYPE_CHECKING:
    from bev_preheat.identification.trips import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

# Predictions are compared with the arrival this long before it [s].
LEADS_S = (600, 300, 120, 60)
LOG_START_NS = 10**15
# Steps of the state of charge and of the power that a car publishes.
SOC_DIGITS = 3


def route_of(trip: Trip, vehicle: Vehicle) -> Route:
    """Return the Route of a trip planner that knows the drive, in steps of 30 s."""
    edges = step_edges(trip)
    other_w = np.maximum(trip.power_w - trip.propulsion_power_w - trip.cabin_heating_power_w, 0.0)
    return make_route({
        'duration_s': np.diff(edges), 'speed_mps': trip.means(trip.speed_mps, edges),
        'propulsion_power_w': trip.means(trip.propulsion_power_w, edges),
        'propulsion_power_rms_w': np.sqrt(trip.means(trip.propulsion_power_w**2, edges)),
        'propulsion_power_magnitude_w': trip.means(np.abs(trip.propulsion_power_w), edges),
        'ambient_temperature_c': trip.means(trip.ambient_c, edges),
        'cabin_heating_power_w': trip.means(trip.cabin_heating_power_w, edges),
        'auxiliary_power_w': trip.means(other_w, edges)}, vehicle.defaults)


def can_be_replayed(trip: Trip) -> bool:
    """Whether a trip is a drive without battery heating, which is all that a replay can command."""
    return trip.kind == 'drive' and not trip.heats and len(trip) > LEADS_S[-1]


def replay_errors_k(vehicle: Vehicle, trip: Trip, estimation: bool) -> dict[int, float]:
    """
    Return predicted minus measured arrival temperature [K] by lead [s], as the node would publish it.

    The planner gets one battery state a second, with power if it is known. Leads longer than the trip are absent.
    """
    supervisor = Supervisor(vehicle, Settings(estimation=estimation))
    now_ns = LOG_START_NS
    # No target asks for heat.
    target_c = vehicle.battery.temperature_range_c[0]
    supervisor.step(now_ns, RouteArrived(Mission(
        trip.name, (Leg(route_of(trip, vehicle), now_ns, True, target_c),))))
    length, errors_k = len(trip), {}
    electrical = () if trip.voltage_v is None or trip.current_a is None else tuple(
        zip(trip.voltage_v.tolist(), trip.current_a.tolist()))
    for at, (temperature_c, soc) in enumerate(zip(trip.battery_temperature_c.tolist(), trip.soc.tolist())):
        now_ns += NS_PER_S
        supervisor.step(now_ns, BatteryStateArrived(Measurement(
            BatteryState(temperature_c, round(soc, SOC_DIGITS)), now_ns, *(electrical[at] if electrical else ()))))
        plan = supervisor.state.decision.plan
        if length - at in LEADS_S and plan is not None:
            errors_k[length - at] = plan.arrival_temperature_c - trip.arrival_c
    return errors_k
