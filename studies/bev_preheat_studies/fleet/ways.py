# SPDX-License-Identifier: Apache-2.0
"""The ways to heat a fleet: not at all, always, and by each planning method; the arrival of one trip in each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import PlanningFailure
from bev_preheat.numerics.factors import JOULES_PER_WH
from bev_preheat.planning.engine import run_forward
from bev_preheat.planning.limits import run_within_limits
from bev_preheat.planning.planner import METHODS, plan_preheating
from bev_preheat.planning.trip import make_trip
from bev_preheat.planning.wanted_heat import WantedHeat
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bev_preheat.planning.plan import Plan
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_studies.fleet.drawn_fleet import FleetTrip

NONE, ALWAYS = 'no_heating', 'always_on'
WAYS = (NONE, ALWAYS, *reversed(METHODS))
# A smaller shortfall does not count as missing the target; see planning.planner.
REACHED_K = 0.2


@dataclass(frozen=True)
class Arrival:
    """A trip's end: heater energy before arrival [Wh], battery temperature [deg C], state of charge."""

    heater_wh: float
    temperature_c: float
    soc: float


def arrivals_of(trip: FleetTrip, vehicle: Vehicle,
                methods: Iterable[str] = tuple(METHODS)) -> dict[str, Arrival] | None:
    """
    Return the Arrival of each of WAYS; None if the car cannot drive the trip even without heating.

    Of the planned ways, only those in `methods`.

    Every plan is simulated with the model's own steps; the method's own prediction is not used.
    """
    inputs = vehicle, trip.route, trip.state
    try:
        unheated = plan_preheating(*inputs, replace(trip.goal, charging_planned=False))
        if unheated.stranding is not None or unheated.undeliverable_power_w > 0.0:
            return None
        plans = {method: plan_preheating(*inputs, trip.goal, method) for method in methods}
    except PlanningFailure:
        return None
    arrivals = {NONE: _arrival(unheated), ALWAYS: _always_on(trip, vehicle)}
    for method, plan in plans.items():
        # The paper's method predicts with Euler steps.
        arrivals[method] = (_driven(trip, vehicle, plan) if method == 'paper' and plan.heating_start_s is not None
                            else arrivals[NONE] if plan.heating_start_s is None else _arrival(plan))
    return {way: arrivals[way] for way in WAYS if way in arrivals}


def _arrival(plan: Plan) -> Arrival:
    return Arrival(plan.energy_wh.hvch_electric, plan.arrival_temperature_c, plan.arrival_soc)


def _driven(trip: FleetTrip, vehicle: Vehicle, plan: Plan) -> Arrival:
    """Return the Arrival of a plan's heater powers, driven with Runge-Kutta steps."""
    soc, temperature_c = run_forward(
        make_trip(vehicle, trip.route), make_runge_kutta_4, trip.state.soc, trip.state.temperature_c,
        plan.hvch_battery_power_w)
    return Arrival(plan.energy_wh.hvch_electric, float(temperature_c[-1]), float(soc[-1]))


def _always_on(trip: FleetTrip, vehicle: Vehicle) -> Arrival:
    """
    Return the Arrival of a car that heats from the start and then holds the target.

    A thermostat: in each step that starts below the target, the heater runs at the power the cabin leaves.
    """
    driven = make_trip(vehicle, trip.route)
    schedule = run_within_limits(
        driven, trip.state, WantedHeat(driven.heater_limit_w, trip.goal.target_temperature_c), take_surplus=False)
    # Summed step by step, as in the native core.
    heater_wh = float(np.cumsum(driven.route.duration_s / JOULES_PER_WH * schedule.heater_power_w)[-1])
    return Arrival(heater_wh, float(schedule.temperature_c[-1]), float(np.maximum(schedule.soc[-1], 0.0)))
