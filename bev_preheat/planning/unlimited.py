# SPDX-License-Identifier: Apache-2.0
"""
The plan of a trip on which no limit is active, made by the compiled core in one call.

There `merit_order` and `optimal_switch` are the same, one instant of switching on, but for the trips on which
heating is cheaper elsewhere. The reference is what
the planner does without the core: `optimal_switch`, held against the limits, `caution`, `safeguard` and
`outcome`; for the paper's heuristic it is `paper`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.compiled import plans as compiled_plans
from bev_preheat.planning.dynamics import compiled_vehicle, energies_of, limits_along
from bev_preheat.planning.outcome import Outcome
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.planning.stretches import heating_stretches, HeatingStretch, REASONS
from bev_preheat.vehicle.model import make_euler, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.compiled.structs import SwitchPlanStruct
    from bev_preheat.planning.caution import Caution
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip


def plan_unlimited(trip: Trip, state: BatteryState, goal: Goal,
                   caution: Caution | None = None,
                   in_one_stretch: bool = True) -> tuple[Schedule, Outcome | None] | None:
    """
    Return the Schedule that arrives at the target, and its Outcome; None where anything limits it.

    That is a limit of the battery, with heating or without, or the charge that must be left. None too
    where the heat arrives late, and where the core does not answer. With a Caution it heats earlier.
    Unless it is to heat `in_one_stretch`, None where it may be cheaper elsewhere (`cheapest_steps`).
    Where that, or a limit of the battery, is the reason, the unheated Schedule is returned, limits left
    aside, and None.
    """
    vehicle = trip.vehicle
    compiled = compiled_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if compiled is None:
        return None
    lowest_c, highest_c = vehicle.battery.temperature_range_c
    target_c = goal.target_temperature_c if goal.charging_planned and goal.heating_pays else lowest_c
    asked = None
    if caution is not None and goal.charging_planned:
        target_c = min(target_c + caution.margin_k, highest_c)
        asked = caution.compiled
    found = compiled_plans.plan_switch(
        compiled, trip.compiled, state.soc, state.temperature_c, target_c, in_one_stretch, asked)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    schedule = Schedule(
        _known(instant_s), heater_power_w, np.zeros(len(heater_power_w)), soc, temperature_c,
        make_runge_kutta_4, None if plan is None else _known(plan.heating_end_s))
    if plan is None:
        return schedule, None
    if goal.charging_planned and not _leaves_enough(trip, goal, schedule, plan.least_soc):
        return None
    return schedule, Outcome(
        energies_of(plan.energy_wh[:]), _stretches(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def plan_unlimited_paper(trip: Trip, state: BatteryState, goal: Goal,
                         caution: Caution | None = None) -> tuple[Schedule, Outcome] | None:
    """Return the Schedule of the paper's heuristic and its Outcome; None where `plan_unlimited` says so."""
    vehicle = trip.vehicle
    compiled = compiled_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if compiled is None or caution is not None or not goal.charging_planned:
        return None
    target_c = goal.target_temperature_c if goal.heating_pays else vehicle.battery.temperature_range_c[0]
    found = compiled_plans.plan_paper(
        compiled, trip.compiled, state.soc, state.temperature_c, target_c)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    schedule = Schedule(
        _known(instant_s), heater_power_w, np.zeros(len(heater_power_w)), soc, temperature_c, make_euler)
    if not _leaves_enough(trip, goal, schedule, plan.least_soc):
        return None
    return schedule, Outcome(
        energies_of(plan.energy_wh[:]), _stretches(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def _known(instant_s: float) -> float | None:
    """Return an instant [s] of the core's; None for NaN."""
    return None if instant_s != instant_s else instant_s


def _leaves_enough(trip: Trip, goal: Goal, schedule: Schedule, least_soc: float) -> bool:
    """Return whether a Schedule leaves what must be left, on arrival and on the way."""
    return (schedule.soc.item(-1) >= reserve_soc(trip.vehicle, goal)
            and least_soc >= trip.vehicle.battery.soc_range[0])


def _stretches(trip: Trip, schedule: Schedule,
               plan: SwitchPlanStruct) -> tuple[HeatingStretch, ...]:
    """Return what `heating_stretches` does; the usual case is known already."""
    first = plan.first_heated
    if first == len(schedule.heater_power_w):
        return ()
    if plan.is_one_stretch:
        start_s = max(trip.time_s.item(first), plan.switching_instant_s)
        return (HeatingStretch(
            start_s, trip.time_s.item(plan.end_heated), plan.stretch_wh, REASONS[plan.reason]),)
    return heating_stretches(trip, schedule, limits_along(trip, schedule)[0])
