# SPDX-License-Identifier: Apache-2.0
"""
The built-in methods: `value_function`, `optimal_switch`, `paper`, and the shortcut without an active limit.

`switched` is the engine's plan with one interval for the same goal, if it is known.

`value_function` is the plan of least battery energy within the limits, by the passes of `recursion`. Its values
are the worth of each temperature at each instant of a drive, so they serve wherever the battery is a moment later,
and an update is the forward pass alone. They are found again once they no longer hold: for another route, heater,
goal, uncertainty or price, or after VALUES_KEPT_S of driving, because the corrected model has moved on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.planning import engine
from bev_preheat.planning.heat_run import initial_states, States
from bev_preheat.planning.limits import drive_as_planned, run_unheated
from bev_preheat.planning.one_interval import SwitchPlan
from bev_preheat.planning.outcome import power_deficit
from bev_preheat.planning.paper import run_paper
from bev_preheat.planning.schedule import ended_within, HeldBack, Schedule
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc, Uncertainty
from bev_preheat.planning.trip import Trip
from bev_preheat.tunables import (
    LEAST_HEATING_W,
    MOST_CHANGED_SHARE,
    MOST_DEVIATION_SHARE,
    NEAR_K,
    ROUNDING_W,
    SOC_TOLERANCE,
    SPARE_SOC,
    VALUES_KEPT_S,
)

# An update makes plans for a heater as it is and as it should be.
KEPT_VALUE_FUNCTIONS = 2


@dataclass(frozen=True)
class Requirements:
    """Requirements on a plan by values: arrival [deg C], charge to leave, Uncertainty, and prices of the steps."""

    target_c: float
    reserve: float
    uncertainty: Uncertainty
    price: FloatArray | None = None
    most_c: float = math.inf


@dataclass(eq=False)
class KeptValues:
    """The `latest` plans of a drive whose values are kept: to begin with, and, after a plan, for the next one."""

    latest: tuple[Kept, ...] = ()

    def keep(self, trip: Trip, start: States, wanted: Requirements, values: Any) -> None:
        """Keep the values of a plan; None: it found none."""
        kept = Kept(trip, start, wanted, values is not None)
        _VALUES[kept] = values
        self.latest = (kept, *self.latest)[:KEPT_VALUE_FUNCTIONS]

    def that_hold(self, trip: Trip, wanted: Requirements) -> Any:
        """Return the values that hold for the rest of their trip, or None."""
        return next((kept.values for kept in self.latest if kept.holds_for(trip, wanted)), None)


@dataclass(frozen=True, eq=False)
class Kept:
    """One plan whose values are kept, if it has any: trip, start and requirements, from which they follow."""

    trip: Trip
    start: States
    wanted: Requirements
    has_values: bool

    @property
    def values(self) -> Any:
        """The values; they are found again if they are not in this process."""
        if self not in _VALUES:
            _VALUES[self] = (engine.find_values(self.trip, self.start, self.wanted).values
                             if self.has_values else None)
        return _VALUES[self]

    def holds_for(self, trip: Trip, wanted: Requirements) -> bool:
        """Return whether the values hold for the rest of their trip."""
        if not _is_rest_of(self.trip, trip):
            return False
        made = self.wanted
        passed = len(self.trip.route) - len(trip.route)
        left_share = trip.route.total_duration_s / self.trip.route.total_duration_s
        expected_k = made.uncertainty.deviation_k * left_share
        return ((wanted.target_c, wanted.most_c, wanted.reserve) == (made.target_c, made.most_c, made.reserve)
                and abs(wanted.uncertainty.deviation_k - expected_k) <= MOST_DEVIATION_SHARE * expected_k
                and (wanted.price is None) == (made.price is None)
                and (wanted.price is None or made.price is None
                     or np.array_equal(wanted.price, made.price[passed:])))


# The values of the plans that are kept.
_VALUES: WeakKeyDictionary[Kept, Any] = WeakKeyDictionary()


def _is_rest_of(whole: Trip, trip: Trip) -> bool:
    """Return whether a trip is the rest of another, as far as the values of that depend on it."""
    passed = len(whole.route) - len(trip.route)
    passed_s = whole.route.total_duration_s - trip.route.total_duration_s
    battery, battery_then = trip.vehicle.battery, whole.vehicle.battery
    if not (passed >= 0 and 0.0 <= passed_s <= VALUES_KEPT_S
            and battery.discharge_power_limit == battery_then.discharge_power_limit
            and battery.charge_power_limit == battery_then.charge_power_limit
            and battery.temperature_range_c == battery_then.temperature_range_c):
        return False
    power_w = whole.idle_power_w[passed:]
    return bool(
        np.array_equal(trip.route.duration_s[1:], whole.route.duration_s[passed + 1:])
        and np.array_equal(trip.heater_limit_w, whole.heater_limit_w[passed:])
        and np.abs(trip.idle_power_w - power_w).max() <= MOST_CHANGED_SHARE * np.abs(power_w).max())


def plan_optimal_switch(trip: Trip, state: BatteryState, goal: Goal,
                        switched: SwitchPlan | None = None) -> Schedule:
    """Return the Schedule switched on once to arrive at the target; with a heat path also off before arrival."""
    found = switched or engine.plan_switch(trip, state, goal.target_temperature_c, in_one_interval=True)
    return found.schedule


def plan_paper(trip: Trip, state: BatteryState, goal: Goal, terminal_soc: float | None = None,
               switched: SwitchPlan | None = None) -> Schedule:
    """Return the Schedule of the paper's forward and backward simulation; see `paper.run_paper`."""
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
    such as shares of the highest price. `kept` has the values of an earlier plan of the drive, and takes those of
    this one. If the charge does not carry the trip, only surplus heats.
    """
    if uncertainty is None:
        if price is None and trip.mix.is_alone:
            switched = switched or engine.plan_switch(trip, state, goal.target_temperature_c)
            if is_best(trip, goal, switched):
                return switched.schedule
        uncertainty = Uncertainty(0.0, int(state.heater_power_w > LEAST_HEATING_W))
    reserve = reserve_soc(trip.vehicle, goal)
    aimed_soc = reserve + SPARE_SOC if reserve > 0.0 else 0.0
    start = initial_states(state)
    if trip.vehicle.heat_path.is_direct:
        start = *start[:2], 0.0, 0.0
    wanted = Requirements(
        goal.target_temperature_c, aimed_soc, uncertainty, price, goal.highest_arrival_c)
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
    if float(warmest.temperature_c[-1]) <= arrival_c + NEAR_K:
        return None
    gives_way = bool((warmest.heater_power_w < trip.heater_limit_w - ROUNDING_W).any())
    return HeldBack.POWER if gives_way or power_deficit(trip, warmest).worst_w > 0.0 else HeldBack.START
