# SPDX-License-Identifier: Apache-2.0
"""
The built-in methods: `value_function`, `optimal_switch`, `paper`, and the shortcut without an active limit.

`value_function` is the plan of least battery energy within the limits, by the passes of `recursion`.
"""
from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bev_preheat.planning import engine
from bev_preheat.planning.heat_run import initial_states
from bev_preheat.planning.kept_values import KeptValues, Requirements
from bev_preheat.planning.limits import drive_as_planned, run_unheated
from bev_preheat.planning.paper import run_paper
from bev_preheat.planning.recursion import Recursion, ValueTable
from bev_preheat.planning.schedule import ended_within, HeldBack
from bev_preheat.planning.situation import reserve_soc, Uncertainty
from bev_preheat.tunables import LACK_PRICE, LEAST_HEATING_W, NEAR_K, SOC_TOLERANCE, SPARE_SOC

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.planning.one_interval import SwitchPlan
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
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


def plan_by_values(trip: Trip, state: BatteryState, goal: Goal,
                   switched: SwitchPlan | None = None, uncertainty: Uncertainty | None = None,
                   price: FloatArray | None = None, kept: KeptValues | None = None) -> Schedule:
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    Without an active limit it is the Schedule of `optimal_switch`. With an Uncertainty it has the least expected
    energy, of a plan that is made again on the way. `price` (N,) are factors of the battery energy of the steps,
    such as shares of the highest price. `switched` is the engine's plan with one interval for this goal, if known.
    `kept` has the values of an earlier plan of the drive, and takes those of this one.
    If the charge does not carry the trip, only surplus heats.
    """
    if uncertainty is None:
        if price is None:
            switched = switched or engine.plan_switch(trip, state, goal.target_temperature_c)
            if is_best(trip, goal, switched):
                return switched.schedule
        uncertainty = Uncertainty(0.0, is_heating=state.heater_power_w > LEAST_HEATING_W)
    reserve = reserve_soc(trip.vehicle, goal)
    aimed_soc = reserve + SPARE_SOC if reserve > 0.0 else 0.0
    start = initial_states(state)
    if trip.vehicle.heat_path.is_direct:
        start = *start[:2], 0.0, 0.0
    wanted = Requirements(goal.target_temperature_c, aimed_soc, uncertainty, price)
    values = None if kept is None else kept.that_hold(trip, wanted)
    found = None if values is None else engine.follow_values(trip, start, wanted, values)
    if found is None:
        found = engine.find_values(trip, start, wanted)
        if kept is not None:
            kept.keep(trip, start, wanted, found.values)
    if found.command_w is None:
        return run_unheated(trip, state)
    schedule = drive_as_planned(trip, state, found.command_w)
    if found.ends_in is not None:
        schedule = ended_within(trip, schedule, found.ends_in)
    return replace(schedule, held_back=_what_holds_back(trip, state, goal.target_temperature_c, reserve, schedule))


def _what_holds_back(trip: Trip, state: BatteryState, target_c: float, reserve: float,
                     schedule: Schedule) -> HeldBack | None:
    """Return what keeps a Schedule from its target [deg C] although more could be heated; None: nothing does."""
    arrival_c = float(schedule.temperature_c[-1])
    if arrival_c < target_c and float(schedule.soc[-1]) < reserve + SOC_TOLERANCE:
        return HeldBack.RESERVE
    if arrival_c > target_c - NEAR_K:
        return None
    warmest = drive_as_planned(trip, state, trip.heater_limit_w)
    return HeldBack.POWER if float(warmest.temperature_c[-1]) > arrival_c + NEAR_K else None


def value_table(trip: Trip, state: BatteryState, goal: Goal) -> ValueTable | None:
    """
    Return the ValueTable over the whole range, with the charge of the plan: for pictures and for study.

    The heater was off before each instant. None if the charge does not carry the trip.
    """
    certain = Uncertainty(0.0, state.heater_power_w > LEAST_HEATING_W)
    recursion = Recursion(trip, initial_states(state), Requirements(
        goal.target_temperature_c, reserve_soc(trip.vehicle, goal), certain), LACK_PRICE)
    return None if recursion.plan() is None else recursion.table()
