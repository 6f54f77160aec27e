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
from bev_preheat.planning.caution import heat_early
from bev_preheat.planning.cheapest_steps import heat_cheapest
from bev_preheat.planning.dynamics import compiled_vehicle, energies_of, limits_along
from bev_preheat.planning.limits import limits_hold
from bev_preheat.planning.outcome import find_outcome, Outcome
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.stretches import heating_stretches, HeatingStretch, Reason
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.compiled.structs import SwitchPlanStruct
    from bev_preheat.planning.caution import Caution
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip


def plan_unlimited(trip: Trip, state: BatteryState, goal: Goal,
                   caution: Caution | None = None,
                   in_one_stretch: bool = True) -> tuple[Schedule, Outcome] | None:
    """
    Return the Schedule that arrives at the target, and its Outcome; None where anything limits it.

    That is a limit of the battery, with heating or without, or the charge that must be left. None too
    where the heat arrives late, and where the core does not answer. With a Caution it heats earlier.
    Unless it is to heat `in_one_stretch`, None where it is cheaper elsewhere (`cheapest_steps`).
    """
    vehicle = trip.vehicle
    compiled = compiled_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if compiled is None:
        return None
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    target_c = goal.target_temperature_c if goal.charging_planned and goal.heating_pays else lowest_c
    if caution is not None and goal.charging_planned:
        target_c = min(target_c + caution.margin_k, highest_c)
    found = compiled_plans.plan_switch(
        compiled, trip.compiled, state.soc, state.temperature_c, target_c)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    schedule = Schedule(
        None if instant_s != instant_s else instant_s, heater_power_w, np.zeros(len(heater_power_w)),
        soc, temperature_c, make_runge_kutta_4)
    if not in_one_stretch and plan.is_heated and heat_cheapest(trip, schedule, target_c) is not schedule:
        return None
    if goal.charging_planned:
        if caution is not None:
            early = heat_early(trip, state, schedule, target_c, caution)
            if early is not schedule:
                return (early, find_outcome(trip, early)) if limits_hold(trip, early) and _leaves_enough(
                    trip, goal, early, float(early.soc.min())) else None
        if not _leaves_enough(trip, goal, schedule, plan.least_soc):
            return None
    return schedule, Outcome(
        energies_of(plan.energy_wh[:]), _stretches(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def _leaves_enough(trip: Trip, goal: Goal, schedule: Schedule, least_soc: float) -> bool:
    """Return whether a Schedule leaves what must be left, on arrival and on the way."""
    return (bool(schedule.soc[-1] >= reserve_soc(trip.vehicle, goal))
            and least_soc >= trip.vehicle.battery.soc_range[0])


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
