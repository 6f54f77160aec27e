# SPDX-License-Identifier: Apache-2.0
"""Plans with one interval of heating, made without limits and checked afterwards: the Python engine."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.planning.dynamics import keeps_limits, limits_along, limits_of_steps_w, run_forward
from bev_preheat.planning.heat_run import initial_states, run_heated
from bev_preheat.planning.optimal_switch import find_switch
from bev_preheat.planning.paper import run_paper
from bev_preheat.planning.prices import is_cheaper_elsewhere
from bev_preheat.planning.schedule import Schedule
from bev_preheat.planning.two_switches import find_two_switches
from bev_preheat.vehicle.model import hottest_c, make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.planning.dynamics import Energies, FindLimits
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip


class OneInterval(NamedTuple):
    """A plan's only interval of heating: start and end [s], energy [Wh], and the number of its Reason."""

    start_s: float
    end_s: float
    energy_wh: float
    reason: int


class IntervalCosts(NamedTuple):
    """Energies of a plan, whether it heats, and its intervals, at most one; None: not looked for."""

    energy_wh: Energies
    is_heated: bool
    intervals: tuple[OneInterval, ...] | None


class SwitchPlan(NamedTuple):
    """
    The Schedule without heating and the one with one heating interval, both without regard to limits.

    `unheated_keeps_limits` and `keeps_limits`: whether they keep all limits of the battery; `costs_least`: heating
    in other steps cannot cost less. If the plan keeps the limits and costs least, `least_soc` is its least charge,
    and an engine may also give its `costs`.
    """

    unheated: Schedule
    schedule: Schedule
    unheated_keeps_limits: bool
    keeps_limits: bool
    costs_least: bool
    least_soc: float
    costs: IntervalCosts | None = None


def run_unheated(trip: Trip, state: BatteryState) -> Schedule:
    """Return the Schedule that never heats, ignoring limits."""
    idle_w = np.zeros(len(trip.route))
    if not trip.vehicle.heat_path.is_direct:
        return run_heated(trip, initial_states(state), idle_w)
    soc, temperature_c = run_forward(trip, make_runge_kutta_4, state.soc, state.temperature_c)
    return Schedule(None, idle_w, idle_w, soc, temperature_c, make_runge_kutta_4)


def plan_switch(trip: Trip, state: BatteryState, target_c: float, in_one_interval: bool = False) -> SwitchPlan:
    """
    Return the SwitchPlan that arrives at the target [deg C]: switched on once and, with a heat path, off early.

    Unless it is to be `in_one_interval` in any case, it is compared with heating in other steps (`prices`).
    """
    unheated = run_unheated(trip, state)
    is_direct = trip.vehicle.heat_path.is_direct
    schedule = (find_switch if is_direct else find_two_switches)(trip, target_c, unheated)
    kept = keeps_limits(trip, schedule)
    return SwitchPlan(
        unheated, schedule,
        kept if schedule is unheated else keeps_limits(trip, unheated), kept,
        in_one_interval or not is_direct or not kept or not is_cheaper_elsewhere(trip, schedule),
        float(schedule.soc.min()))


def plan_by_paper(trip: Trip, state: BatteryState, target_c: float) -> SwitchPlan:
    """Return the SwitchPlan of the paper's heuristic; it keeps limits if `is_driven_as_planned`."""
    unheated, schedule = run_unheated(trip, state), run_paper(trip, state, target_c)
    return SwitchPlan(unheated, schedule, keeps_limits(trip, unheated),
                      is_driven_as_planned(trip, schedule), True, float(schedule.soc.min()))


def is_driven_as_planned(trip: Trip, schedule: Schedule, find_w: FindLimits = limits_of_steps_w) -> bool:
    """Return whether a run has no power deficit and is described (`no_regret`); `find_w` as in `limits_along`."""
    _, most_w = limits_along(trip, schedule, find_w)
    return bool((trip.idle_power_w + schedule.drawn_power_w <= most_w).all()
                and schedule.soc.min() > 0.0 and schedule.soc.max() <= 1.0
                and schedule.temperature_c.max() <= hottest_c(trip.vehicle))
