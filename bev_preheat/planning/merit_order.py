# SPDX-License-Identifier: Apache-2.0
"""
Method `merit_order`: heat where a watt-hour of battery energy brings the most.

Steps with surplus regeneration that the battery cannot accept come first: heating with the surplus is free. Next
come the steps in which a kelvin is worth the most to the rest of the trip, relative to its cost (`thresholds`):
before a descent, so that a warmer battery accepts more power; before a climb that the cold battery cannot deliver;
and before arrival, the later the better because of leakage. Heating stops at the target or at the highest
temperature. `no_regret` limits the charge that it may cost, and checks that it serves its purpose. If thresholds
lead to a worse plan than one heating interval within the limits (`limited_switch`), the latter is the plan.

Without an active limit only the end of the trip matters (`optimal_switch`), except on the few trips on which
heating is cheaper elsewhere (`cheapest_steps`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native import searches as native_searches
from bev_preheat.native.structs import SettlingStruct
from bev_preheat.planning.bracketing import ARRIVAL_TOLERANCE_K
from bev_preheat.planning.charge_acceptance import find_acceptance_loss, no_acceptance_loss
from bev_preheat.planning.cheapest_steps import heat_cheapest, whole_charge_wh
from bev_preheat.planning.dynamics import JOULES_PER_WH, native_vehicle, run_forward
from bev_preheat.planning.exchange import exchange_heat
from bev_preheat.planning.heat_run import initial_states, roll_heated, with_coolant_in_battery
from bev_preheat.planning.limited_switch import switch_within_limits
from bev_preheat.planning.limits import drive_as_planned, limits_hold, watch_limits, within_limits
from bev_preheat.planning.no_regret import NO_WORSE_W
from bev_preheat.planning.optimal_switch import plan_optimal_switch
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.rows import schedule_of, states_of
from bev_preheat.planning.threshold_search import ThresholdSearch
from bev_preheat.planning.thresholds import find_thresholds, PENALTY
from bev_preheat.planning.two_switches import paid_until
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip

# The curve is recomputed if the resulting run differs by more than this in state of charge, or regenerates less
# than assumed. If exchanges of heat do the rest, only if it differs by more than the second value. The plan is the
# best of the runs after the first pass.
SOC_AGREEMENT = 5e-4
SOC_AGREEMENT_FOR_EXCHANGES = 5e-3
MOST_PASSES = 3
# A saving below this share of the charge, about 0.05 Wh, is not worth another plan.
LEAST_SAVING_SOC = 1e-6
# Arriving this much nearer to the target justifies the cost.
LEAST_WARMER_K = 0.1


def plan_merit_order(trip: Trip, state: BatteryState, goal: Goal, unheated: Schedule | None = None,
                     serves_climbs: bool = True) -> Schedule:
    """
    Return the Schedule with the least battery energy that reaches the target within limits.

    Without `serves_climbs` nothing is heated for a climb that the battery cannot deliver. `unheated` is the
    Schedule without any heating, ignoring limits, if known.
    """
    found = _found_by_core(trip, state, goal.target_temperature_c, unheated, serves_climbs)
    if found is not None:
        return found
    schedule = plan_optimal_switch(trip, state, goal, unheated)
    if limits_hold(trip, schedule):
        if not trip.vehicle.heat_path.is_direct:
            return schedule
        cheapest = heat_cheapest(trip, schedule, goal.target_temperature_c)
        return cheapest if cheapest is schedule or limits_hold(trip, cheapest) else schedule
    # Thresholds are computed as if heat arrived at once, in battery and coolant; heat of a step is compared with
    # the thresholds of the step in which it arrives. Heat later than in the plan without limits is not paid for.
    paid_w, lumped = trip.heater_limit_w, trip
    if not trip.vehicle.heat_path.is_direct:
        paid_w = paid_until(trip, schedule.heating_end_s)
        lumped = replace(trip, vehicle=with_coolant_in_battery(trip.vehicle))
    best = within_limits(trip, state, _passes(
        trip, lumped, state, schedule, paid_w, goal, serves_climbs))
    if not trip.vehicle.heat_path.is_direct:
        best = _or_without_thresholds(trip, state, best, schedule, goal)
        switched = _switched_once(trip, state, best, schedule, goal)
        return switched if _saves(trip, switched, best, goal) else best
    best = exchange_heat(trip, state, best, goal.target_temperature_c)
    switched = _switched_once(trip, state, best, schedule, goal)
    return (exchange_heat(trip, state, switched, goal.target_temperature_c)
            if _saves(trip, switched, best, goal) else best)


def _found_by_core(trip: Trip, state: BatteryState, target_c: float, unheated: Schedule | None,
                   serves_climbs: bool) -> Schedule | None:
    """Return the Schedule as the native core plans it; None if the core does not answer."""
    vehicle, path = native_vehicle(trip.vehicle), trip.vehicle.heat_path
    if vehicle is None:
        return None
    if unheated is not None:
        idle_states = states_of(unheated)
    elif path.is_direct:
        idle_states = np.array(run_forward(trip, make_runge_kutta_4, state.soc, state.temperature_c))
    else:
        idle_states = roll_heated(trip, initial_states(state), np.zeros(len(trip.route)))
    settling = SettlingStruct(serves_climbs, target_c, trip.vehicle.battery.soc_range[0])
    plan = native_searches.plan_merit_order(vehicle, trip.native, settling, idle_states)
    return None if plan is None else schedule_of(trip, plan)


def _passes(trip: Trip, lumped: Trip, state: BatteryState, schedule: Schedule, paid_w: FloatArray,
            goal: Goal, serves_climbs: bool) -> Schedule:
    """
    Return the best of the Schedules from successive passes of thresholds, each computed along the previous run.

    The first thresholds are computed along a Schedule that ignores limits. `lumped` is the Trip of a vehicle whose
    heat arrives at once; `paid_w` (N,) is the highest heater power worth paying for in each step [W].
    """
    loss = no_acceptance_loss(trip)
    best: Schedule | None = None
    for number in range(MOST_PASSES):
        watch = watch_limits(trip, schedule.soc, schedule.temperature_c)
        thresholds = find_thresholds(
            lumped, watch, schedule, goal.target_temperature_c, loss, serves_climbs,
            is_first_look=number == 0)
        assumed_soc = schedule.soc
        schedule = ThresholdSearch(trip, state, watch, thresholds, paid_w).settle(
            goal.target_temperature_c, serves_climbs)
        if number > 0 and (best is None or _is_better(
                trip, schedule, best, goal, serves_climbs)):
            best = schedule
        # The heating decides where the charge limit is active, and vice versa: going half way keeps the passes
        # from oscillating.
        assumed_loss, loss = loss, loss.blended(find_acceptance_loss(trip, watch, schedule))
        # Limits depend on the state of charge, and the curve was computed for another one.
        apart = float(np.abs(schedule.soc - assumed_soc).max())
        agrees = apart <= SOC_AGREEMENT and assumed_loss.any == loss.any
        if number > 0 and (agrees or (apart <= SOC_AGREEMENT_FOR_EXCHANGES
                                      and _is_exchanged(trip, schedule, serves_climbs))):
            break
    return best or schedule


def _or_without_thresholds(trip: Trip, state: BatteryState, best: Schedule, once: Schedule,
                           goal: Goal) -> Schedule:
    """
    Return the best Schedule, or one without thresholds that saves charge and meets the same requirements.

    Thresholds ignore that heat arrives late, and may cost more than they bring. The alternatives are the Schedule
    `once`, planned without limits, and the unheated one, both as executed within the limits, with surplus and
    without: a heater with lag goes on when the surplus is over.
    """
    for command_w in (once.heater_power_w, np.zeros(len(trip.route))):
        for takes_surplus in (True, False):
            other = drive_as_planned(trip, state, command_w, takes_surplus)
            if _saves(trip, other, best, goal):
                best = other
    return best


def _switched_once(trip: Trip, state: BatteryState, best: Schedule, once: Schedule, goal: Goal) -> Schedule:
    """Return the run within limits with one heating interval that ends with that of `once`."""
    off_s = float(trip.time_s[-1]) if once.heating_end_s is None else once.heating_end_s
    return switch_within_limits(trip, state, goal.target_temperature_c, best, off_s)


def _saves(trip: Trip, schedule: Schedule, other: Schedule, goal: Goal) -> bool:
    """
    Return whether a Schedule is nearer to the target than another, or saves charge, and is no worse otherwise.

    The cost of getting a little nearer is bounded as for thresholds.
    """
    lowest_soc = trip.vehicle.battery.soc_range[0]
    more_missed_k = _missed_k(schedule, goal) - _missed_k(other, goal)
    soc_per_k = (PENALTY * trip.vehicle.battery.heat_capacity_j_per_k / trip.vehicle.hvch.efficiency
                 / (whole_charge_wh(trip, other) * JOULES_PER_WH))
    return bool(
        schedule.empty_at_s is None
        and (more_missed_k < -LEAST_WARMER_K
             or (more_missed_k < -ARRIVAL_TOLERANCE_K
                 and other.soc[-1] - schedule.soc[-1] <= -more_missed_k * soc_per_k)
             or (more_missed_k <= ARRIVAL_TOLERANCE_K
                 and schedule.soc[-1] > other.soc[-1] + LEAST_SAVING_SOC))
        and schedule.soc.min() >= min(lowest_soc, other.soc.min())
        and power_deficit(trip, schedule).worst_w <= power_deficit(trip, other).worst_w)


def _missed_k(schedule: Schedule, goal: Goal) -> float:
    """Return by how much a Schedule misses the target [K]."""
    return max(0.0, goal.target_temperature_c - float(schedule.temperature_c[-1]))


def _is_exchanged(trip: Trip, schedule: Schedule, serves_climbs: bool) -> bool:
    """Return whether exchanges of heat can optimise a Schedule: it has no deficit, and heat arrives at once."""
    return (trip.vehicle.heat_path.is_direct and schedule.empty_at_s is None
            and (not serves_climbs or power_deficit(trip, schedule).worst_w == 0.0))


def _is_better(trip: Trip, schedule: Schedule, other: Schedule, goal: Goal,
               serves_climbs: bool) -> bool:
    """Return whether a Schedule has a smaller deficit than another, or the same deficit at less cost."""
    if (schedule.empty_at_s is None) != (other.empty_at_s is None):
        return schedule.empty_at_s is None
    if serves_climbs:
        more_w = power_deficit(trip, schedule).worst_w - power_deficit(trip, other).worst_w
        if abs(more_w) > NO_WORSE_W:
            return more_w < 0.0
    missed_k, other_missed_k = (_missed_k(run, goal) for run in (schedule, other))
    if abs(missed_k - other_missed_k) > ARRIVAL_TOLERANCE_K:
        return missed_k < other_missed_k
    return bool(schedule.soc[-1] > other.soc[-1])
