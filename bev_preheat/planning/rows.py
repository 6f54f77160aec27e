# SPDX-License-Identifier: Apache-2.0
"""Converts schedules to the native core's rows of states and powers, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.heat_run import make_heat_run
from bev_preheat.planning.limits import where_stranded
from bev_preheat.planning.schedule import Schedule
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.native.searches import MeritPlan
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.trip import Trip


def states_of(schedule: Schedule) -> FloatArray:
    """Return charge and temperature [deg C] of a run, and heater and coolant of a heat path: (2 or 4, N + 1)."""
    heat = schedule.heat
    return np.array((schedule.soc, schedule.temperature_c) if heat is None else (
        schedule.soc, schedule.temperature_c, heat.heater_power_w, heat.coolant_excess_k))


def powers_of(schedule: Schedule) -> FloatArray:
    """Return heater and brake power [W], with a heat path also the heater's power and heat: (2 or 4, N)."""
    heat = schedule.heat
    return np.array((schedule.heater_power_w, schedule.brake_power_w) if heat is None else (
        schedule.heater_power_w, schedule.brake_power_w, heat.drawn_power_w, heat.arriving_heat_w))


def schedule_of(trip: Trip, plan: MeritPlan) -> Schedule:
    """Return the Schedule of a plan of the core."""
    (soc, temperature_c, *heat_states), (heater_w, brake_w, *heat_w) = plan.states, plan.powers_w
    return Schedule(
        plan.start_s, heater_w, brake_w, soc, temperature_c, make_runge_kutta_4, plan.end_s,
        *where_stranded(trip, plan.stranded),
        heat=make_heat_run(trip.vehicle.heat_path, *heat_states, *heat_w) if heat_states else None)
