# SPDX-License-Identifier: Apache-2.0
"""Methods `optimal_switch` and `paper`, and the shortcut for trips on which no limit is active."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.planning import engine
from bev_preheat.planning.heating_intervals import heating_intervals, HeatingInterval, REASONS
from bev_preheat.planning.limits import limits_along
from bev_preheat.planning.outcome import ScheduleOutcome
from bev_preheat.planning.paper import run_paper
from bev_preheat.planning.situation import reserve_soc

if TYPE_CHECKING:
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.switch_plan import SwitchPlan
    from bev_preheat.planning.trip import Trip


def plan_optimal_switch(trip: Trip, state: BatteryState, goal: Goal,
                        switched: SwitchPlan | None = None) -> Schedule:
    """
    Return the Schedule whose forward run arrives at the target, switching on once.

    With a heat path it is also switched off before arrival. `switched` is the engine's plan for this goal, if
    known.
    """
    found = switched or engine.plan_switch(trip, state, goal.target_temperature_c, in_one_interval=True)
    return found.schedule


def plan_paper(trip: Trip, state: BatteryState, goal: Goal, terminal_soc: float | None = None,
               switched: SwitchPlan | None = None) -> Schedule:
    """
    Return the Schedule of the paper's forward and backward simulation; see `paper`.

    `terminal_soc` is its soc_f, by default that of the forward run. `switched` is the engine's plan for this goal,
    if known.
    """
    if terminal_soc is not None:
        return run_paper(trip, state, goal.target_temperature_c, terminal_soc)
    found = switched or engine.plan_by_paper(trip, state, goal.target_temperature_c)
    return found.schedule


def is_best(trip: Trip, goal: Goal, found: SwitchPlan) -> bool:
    """Return whether a SwitchPlan is the optimum: it keeps all limits and the reserve, and costs least."""
    return found.keeps_limits and found.costs_least and (
        not goal.charging_planned or leaves_enough(trip, goal, found))


def leaves_enough(trip: Trip, goal: Goal, found: SwitchPlan) -> bool:
    """Return whether a SwitchPlan keeps the reserve, on arrival and on the way."""
    return (found.schedule.soc.item(-1) >= reserve_soc(trip.vehicle, goal)
            and found.least_soc >= trip.vehicle.battery.soc_range[0])


def outcome_of(trip: Trip, found: SwitchPlan) -> ScheduleOutcome | None:
    """Return the ScheduleOutcome of a SwitchPlan, as far as it comes with the plan; None if it does not."""
    schedule, costs = found.schedule, found.costs
    if costs is None:
        return None
    return ScheduleOutcome(
        costs.energy_wh,
        heating_intervals(trip, schedule, limits_along(trip, schedule)[0]) if costs.intervals is None else tuple([
            HeatingInterval(start_s, end_s, energy_wh, REASONS[reason])
            for start_s, end_s, energy_wh, reason in costs.intervals]),
        schedule.heating_start_s if costs.is_heated else None)
