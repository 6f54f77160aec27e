# SPDX-License-Identifier: Apache-2.0
"""
Heat from the grid when it costs the least: price times energy against the heat that leaks until departure.

A vehicle that stands and is fed by the grid has a linear model: a watt in a step makes the battery warmer at the
end by an amount that depends on the step alone. The cost of a kelvin at the end is therefore a figure for each
step, and filling the steps in the order of these figures is exact. The battery's highest temperature limits the
heat of all steps up to an instant; such nested limits form a polymatroid, on which filling in order is still
exact (J. Edmonds, Submodular functions, matroids, and certain polyhedra, 1970).

A negative price counts as 0: otherwise the plan would heat as early and as hot as it may, and let the heat leak,
because the grid pays for it.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.planning.dynamics import JOULES_PER_WH
from bev_preheat.planning.limits import drive_as_planned
from bev_preheat.planning.planner import finish_plan, plan_without_heating
from bev_preheat.planning.prices import find_prices
from bev_preheat.planning.schedule import switched_on_s
from bev_preheat.planning.situation import check_situation
from bev_preheat.planning.trip import BELOW_HIGHEST_K, make_trip
from bev_preheat.planning.uncertainty_margin import UncertaintyMargin

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.numerics.arrays import FloatArray, IntArray
    from bev_preheat.planning.plan import Plan
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.situation import BatteryState, Goal
    from bev_preheat.planning.trip import Trip
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle

    # From instants [s] (N + 1,) of a plan to the mean price [per kWh] of each step (N,).
    StepPrices = Callable[[FloatArray], FloatArray]

WH_PER_KWH = 1000.0
# Tolerance of the temperature at the end; each further run corrects the heat by the miss of the last one.
ARRIVAL_TOLERANCE_K = 1e-4
MOST_RUNS = 6
# Heat of a step below this [K] is rounding.
LEAST_K = 1e-9


def plan_in_cheapest_hours(vehicle: Vehicle, route: Route, state: BatteryState, goal: Goal, method: str,
                           step_prices: StepPrices, uncertainty_margin: UncertaintyMargin | None = None,
                           heater_share: float = 1.0, heat_lag_s: float = 0.0) -> Plan:
    """
    Return the Plan that reaches a goal at the least cost, for a vehicle that stands and is fed by the grid.

    `vehicle` is that of `vehicle.grid.grid_fed`. `step_prices` gives the mean price per kWh of each step; a
    negative one counts as 0, and the plan never heats more than the target needs. `method` is the name in the
    plan; the other arguments are those of `plan_preheating`. Raises the same errors for input outside the
    model's range.
    """
    started = perf_counter()
    check_situation(vehicle, route, state, goal)
    trip = make_trip(vehicle, route, heater_share, heat_lag_s)
    margin = uncertainty_margin or UncertaintyMargin()
    highest_c = vehicle.battery.temperature_range_c[1]
    target_c = min(goal.target_temperature_c + margin.margin_k, highest_c)
    schedule = _Hours(trip, state, target_c, step_prices(trip.time_s)).schedule(margin)
    return finish_plan(trip, goal, schedule, method, started)


def cost_of(plan: Plan, step_prices: StepPrices) -> float:
    """Return the cost of the heater's energy in a Plan, in the currency of the prices."""
    energy_wh = plan.drawn_power_w * np.diff(plan.time_s) / JOULES_PER_WH
    return float(energy_wh @ step_prices(plan.time_s)) / WH_PER_KWH


def fill_in_order(order: IntArray, most_k: FloatArray, room_k: FloatArray, wanted_k: float) -> FloatArray:
    """
    Return the heat of each step (N,) [K at the end] that sums to `wanted_k`, or to the largest possible sum.

    Each step in `order` takes the most it can: at most `most_k` (N,), and so that the sum of all steps up to
    each one stays within `room_k` (N,).
    """
    heat_k, room_k = np.zeros(len(most_k)), room_k.copy()
    for step in order.tolist():
        if wanted_k <= LEAST_K:
            break
        taken_k = min(most_k.item(step), wanted_k, float(room_k[step:].min()))
        if taken_k <= LEAST_K:
            continue
        heat_k[step] = taken_k
        room_k[step:] -= taken_k
        wanted_k -= taken_k
    return heat_k


class _Hours:
    """The steps of a trip in the order of their cost per kelvin at the end."""

    def __init__(self, trip: Trip, state: BatteryState, target_c: float, price_per_kwh: FloatArray) -> None:
        self._trip, self._state, self._target_c = trip, state, target_c
        self._unheated = unheated = plan_without_heating(trip, state)
        self._warmth_k_per_w = np.where(
            self._arrives_in_time(), find_prices(trip, unheated).warmth_k_per_w, 0.0)
        self._most_k = self._warmth_k_per_w * trip.heater_limit_w
        usable = np.flatnonzero(self._most_k > LEAST_K)
        # Cost of a kelvin at the end; at the same cost the later step, because less can go wrong after it.
        counted_per_kwh = np.maximum(price_per_kwh[usable], 0.0)
        per_k = counted_per_kwh * trip.route.duration_s[usable] / self._warmth_k_per_w[usable]
        self._order = usable[np.lexsort((-usable, per_k))]
        self._room_k = self._room(unheated)

    def _arrives_in_time(self) -> FloatArray:
        """Return 1 for each step whose heat reaches the battery before the end, else 0."""
        path = self._trip.vehicle.heat_path
        left_s = self._trip.time_s[-1] - self._trip.time_s[1:]
        lag_s = 0.0 if path.is_direct else path.heat_lag_s
        return np.where(left_s + 0.5 * self._trip.route.duration_s > lag_s, 1.0, 0.0)

    def _room(self, unheated: Schedule) -> FloatArray:
        """Return the heat up to the end of each step (N,) [K at the end] that keeps the battery's range."""
        trip = self._trip
        ceiling_c = max(trip.vehicle.battery.temperature_range_c[1] - BELOW_HIGHEST_K, self._target_c)
        leaks = trip.leakage_w_per_k * trip.route.duration_s / trip.vehicle.battery.heat_capacity_j_per_k
        # Share of a kelvin at the end of a step that is left at the end of the trip.
        left = np.exp(-(leaks.sum() - np.cumsum(leaks)))
        room_k: FloatArray = np.maximum(ceiling_c - unheated.temperature_c[1:], 0.0) * left
        return room_k

    def schedule(self, margin: UncertaintyMargin) -> Schedule:
        """Return the Schedule that arrives at the target, with an UncertaintyMargin's lead."""
        needed_k = self._target_c - self._unheated.temperature_c.item(-1)
        if needed_k <= 0.0:
            return drive_as_planned(self._trip, self._state, np.zeros(len(self._most_k)))
        asked_k = needed_k
        for _ in range(MOST_RUNS):
            heat_k, end_s = self._with_lead(asked_k, margin)
            schedule = self._run(heat_k, end_s)
            missed_k = self._target_c - schedule.temperature_c.item(-1)
            if abs(missed_k) <= ARRIVAL_TOLERANCE_K or heat_k.sum() < asked_k - ARRIVAL_TOLERANCE_K:
                break
            asked_k += missed_k
        return schedule

    def _with_lead(self, asked_k: float, margin: UncertaintyMargin) -> tuple[FloatArray, float | None]:
        """
        Return the heat of each step [K at the end], and the instant [s] at which it ends within a step, or None.

        Where too little room for a correction is left after the heating, it begins early and ends early by as much
        as the margin asks for. A heater that is on does not pause for less than the least pause.
        """
        heat_k = fill_in_order(self._order, self._most_k, self._room_k, asked_k)
        last = int(np.flatnonzero(heat_k)[-1]) if heat_k.any() else 0
        spare_k = float(self._most_k[last + 1:].sum())
        lead_k = max(0.0, margin.lead_k - spare_k)
        if margin.is_heating:
            lead_k += float(self._most_k[0] / self._trip.route.duration_s[0]) * margin.least_pause_s
        if lead_k == 0.0:
            return heat_k, None
        early_k = fill_in_order(self._order, self._most_k, self._room_k, asked_k + lead_k)
        return self._ended_early(early_k, max(0.0, float(early_k.sum()) - asked_k))

    def _ended_early(self, heat_k: FloatArray, by_k: float) -> tuple[FloatArray, float | None]:
        """Return the heat without the last `by_k` [K at the end], and the instant [s] at which it ends or None."""
        end_s = None
        for step in np.flatnonzero(heat_k)[::-1].tolist():
            if by_k <= LEAST_K:
                break
            taken_k = min(heat_k.item(step), by_k)
            if taken_k < heat_k.item(step):
                share = (heat_k.item(step) - taken_k) / self._most_k.item(step)
                end_s = float(self._trip.time_s[step] + share * self._trip.route.duration_s[step])
            heat_k[step] -= taken_k
            by_k -= taken_k
        return heat_k, end_s

    def _run(self, heat_k: FloatArray, end_s: float | None) -> Schedule:
        """Return the Schedule of the heat of each step [K at the end]."""
        trip = self._trip
        power_w = np.zeros(len(heat_k))
        heated = np.flatnonzero(heat_k)
        power_w[heated] = heat_k[heated] / self._warmth_k_per_w[heated]
        power_w = np.minimum(power_w, trip.heater_limit_w)
        run = drive_as_planned(trip, self._state, power_w)
        start_s = switched_on_s(trip, power_w)
        if end_s is not None and start_s is not None and len(heated) and (
                trip.time_s[heated[-1]] <= start_s):
            # One step holds both instants: it is heated from its beginning.
            start_s = float(trip.time_s[heated[-1]])
        return replace(run, heating_start_s=start_s, heating_end_s=end_s)
