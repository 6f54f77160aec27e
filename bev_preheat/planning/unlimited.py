# SPDX-License-Identifier: Apache-2.0
"""
Trips on which no limit is active: one switching instant is the optimum, found with one call of the native core.

The reference is the plan without the core: `switch_within_limits`, then `no_regret` and `outcome`; for the paper's
heuristic it is `paper`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import plans as native_plans
from bev_preheat.planning.dynamics import energies_of, limits_along, native_vehicle
from bev_preheat.planning.heating_intervals import heating_intervals, HeatingInterval, REASONS
from bev_preheat.planning.limits import limits_hold
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.outcome import ScheduleOutcome
from bev_preheat.planning.prices import is_cheaper_elsewhere
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.situation import reserve_soc
from bev_preheat.vehicle.model import make_euler, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.native.structs import SwitchPlanStruct
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip


def switch_within_limits(trip: Trip, state: BatteryState, goal: Goal,
                         unheated: Schedule | None = None) -> Schedule | None:
    """
    Return the Schedule of `optimal_switch` if it is the optimum: it keeps all limits and the reserve.

    None also if heating in other steps may be cheaper (`prices`). `unheated` is the Schedule without any heating,
    ignoring limits, if known.
    """
    schedule = plan_optimal_switch(trip, state, goal, unheated)
    if not limits_hold(trip, schedule) or not _leaves_enough(trip, goal, schedule, float(schedule.soc.min())):
        return None
    if trip.vehicle.heat_path.is_direct and is_cheaper_elsewhere(trip, schedule):
        return None
    return schedule


def plan_unlimited(trip: Trip, state: BatteryState, goal: Goal,
                   in_one_interval: bool = True) -> tuple[Schedule, ScheduleOutcome | None] | None:
    """
    Return the Schedule that arrives at the target, and its ScheduleOutcome; None if any limit interferes.

    Such limits are the battery's, with heating or without, and the reserve. None also if the heat arrives late, or
    the core does not answer. Without `in_one_interval`, None if heating may be cheaper elsewhere (`prices`). In
    that case, and for a limit of the battery, the result is the unheated Schedule, ignoring limits, and None.
    """
    vehicle = trip.vehicle
    native = native_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if native is None:
        return None
    lowest_c = vehicle.battery.temperature_range_c[0]
    target_c = goal.target_temperature_c if goal.charging_planned and goal.heating_pays else lowest_c
    found = native_plans.plan_switch(
        native, trip.native, state.soc, state.temperature_c, target_c, in_one_interval)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    schedule = Schedule(
        _known(instant_s), heater_power_w, np.zeros(len(heater_power_w)), soc, temperature_c,
        make_runge_kutta_4)
    if plan is None:
        return schedule, None
    if goal.charging_planned and not _leaves_enough(trip, goal, schedule, plan.least_soc):
        return None
    return schedule, ScheduleOutcome(
        energies_of(plan.energy_wh.in_a_row()), _intervals(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def plan_unlimited_paper(
        trip: Trip, state: BatteryState, goal: Goal) -> tuple[Schedule, ScheduleOutcome] | None:
    """Return Schedule and ScheduleOutcome of the paper's heuristic; None in the cases of `plan_unlimited`."""
    vehicle = trip.vehicle
    native = native_vehicle(vehicle) if vehicle.heat_path.is_direct else None
    if native is None or not goal.charging_planned:
        return None
    target_c = goal.target_temperature_c if goal.heating_pays else vehicle.battery.temperature_range_c[0]
    found = native_plans.plan_paper(
        native, trip.native, state.soc, state.temperature_c, target_c)
    if found is None:
        return None
    plan, (instant_s, soc, temperature_c, heater_power_w) = found
    schedule = Schedule(
        _known(instant_s), heater_power_w, np.zeros(len(heater_power_w)), soc, temperature_c, make_euler)
    if not _leaves_enough(trip, goal, schedule, plan.least_soc):
        return None
    return schedule, ScheduleOutcome(
        energies_of(plan.energy_wh.in_a_row()), _intervals(trip, schedule, plan),
        schedule.heating_start_s if plan.is_heated else None)


def _known(instant_s: float) -> float | None:
    """Return an instant [s] of the core; None for NaN."""
    return None if instant_s != instant_s else instant_s


def _leaves_enough(trip: Trip, goal: Goal, schedule: Schedule, least_soc: float) -> bool:
    """Return whether a Schedule keeps the reserve, on arrival and on the way."""
    return (schedule.soc.item(-1) >= reserve_soc(trip.vehicle, goal)
            and least_soc >= trip.vehicle.battery.soc_range[0])


def _intervals(trip: Trip, schedule: Schedule,
               plan: SwitchPlanStruct) -> tuple[HeatingInterval, ...]:
    """Return the same as `heating_intervals`; the usual case is already known."""
    first = plan.first_heated
    if first == len(schedule.heater_power_w):
        return ()
    if plan.is_one_interval:
        start_s = max(trip.time_s.item(first), plan.switching_instant_s)
        return (HeatingInterval(
            start_s, trip.time_s.item(plan.end_heated), plan.interval_wh, REASONS[plan.reason]),)
    return heating_intervals(trip, schedule, limits_along(trip, schedule)[0])
