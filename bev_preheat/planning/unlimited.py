# SPDX-License-Identifier: Apache-2.0
"""
The plan of a trip on which no limit is active, made by the compiled core in one call.

There `merit_order` and `optimal_switch` are the same: one instant of switching on. The reference is what
the planner does without the core: `optimal_switch`, held against the limits, `safeguard` and `outcome`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.compiled import plans as compiled_plans
from bev_preheat.planning.dynamics import compiled_vehicle, energies_of, limits_along
from bev_preheat.planning.outcome import Outcome
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.stretches import heating_stretches, HeatingStretch, Reason
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.compiled.structs import SwitchPlanStruct
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip


def plan_unlimited(trip: Trip, state: BatteryState,
                   goal: Goal) -> tuple[Schedule, Outcome] | None:
    """
    Return the Schedule that arrives at the target, and its Outcome; None where anything limits it.

    That is a limit of the battery, with heating or without, or the charge that must be left. None too
    where the heat arrives late, and where the core does not answer.
    """
    vehicle = trip.vehicle
    compiled = compiled_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if compiled is None:
        return None
    lowest_c = vehicle.battery.temperature_range_c[0]
    is_heating = goal.charging_planned and goal.heating_pays
    found = compiled_plans.plan_switch(
        compiled, trip.compiled, state.soc, state.temperature_c,
        goal.target_temperature_c if is_heating else lowest_c)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    if goal.charging_planned and (soc[-1] < reserve_soc(vehicle, goal)
                                  or plan.least_soc < vehicle.battery.soc_range[0]):
        return None
    schedule = Schedule(
        None if instant_s != instant_s else instant_s, heater_power_w, np.zeros(len(heater_power_w)),
        soc, temperature_c, make_runge_kutta_4)
    return schedule, Outcome(
        energies_of(plan.energy_wh[:]), _stretches(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def _stretches(trip: Trip, schedule: Schedule,
               plan: SwitchPlanStruct) -> tuple[HeatingStretch, ...]:
    """Return what `heating_stretches` does; the usual case is known already."""
    first = plan.first_heated
    if first == len(schedule.heater_power_w):
        return ()
    if plan.is_one_stretch:
        start_s = max(float(trip.time_s[first]), plan.switching_instant_s)
        return (HeatingStretch(start_s, float(trip.time_s[-1]), plan.stretch_wh, Reason.ARRIVAL),)
    return heating_stretches(trip, schedule, limits_along(trip, schedule)[0])
