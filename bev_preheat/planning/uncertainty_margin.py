# SPDX-License-Identifier: Apache-2.0
"""
Heat a little earlier than the plan needs, to make up for the uncertainty.

Full power that comes too late cannot catch up, whereas heating too early loses only the leakage until arrival. So
the last heating interval begins early by the uncertainty, and ends once the target is certain. It is not
interrupted for a pause that is too short to justify switching.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.native.structs import UncertaintyMarginStruct
from bev_preheat.planning.bracketing import follow_slope, Trial
from bev_preheat.planning.dynamics import run_on
from bev_preheat.planning.heat_run import roll_heated, run_heated, states_at
from bev_preheat.planning.limits import course_within_limits, drive_as_planned, limits_hold, watch_everywhere
from bev_preheat.planning.schedule import HEATING_SHARE, Schedule, switched_on_s
from bev_preheat.planning.wanted_heat import WantedHeat
from bev_preheat.vehicle.model import make_runge_kutta_4

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.situation import BatteryState
    from bev_preheat.planning.trip import Trip

# Tolerance of the end of heating.
ARRIVAL_TOLERANCE_K = 1e-3
END_RESOLUTION_S = 1e-3
MOST_RUNS = 12


@dataclass(frozen=True)
class UncertaintyMargin:
    """
    Margins of a plan for the uncertainty.

    `margin_k`: by how much the battery is to arrive above the target [K]. `lead_k`: by how many kelvin of heating
    the last interval begins early. `is_heating`: the heater is on now; it then pauses only for longer than
    `least_pause_s`. A heater that is off is not switched on for less than `least_heating_s` of heating before
    arrival, or if most of its heat would come too late.
    """

    margin_k: float = 0.0
    lead_k: float = 0.0
    is_heating: bool = False
    least_pause_s: float = 0.0
    least_heating_s: float = 0.0

    @cached_property
    def native(self) -> UncertaintyMarginStruct:
        """The margin as a struct of the native core, whose target already includes `margin_k`."""
        return UncertaintyMarginStruct(self.lead_k, self.least_pause_s, self.least_heating_s, self.is_heating)


def heat_early(trip: Trip, state: BatteryState, schedule: Schedule, target_c: float,
               uncertainty_margin: UncertaintyMargin) -> Schedule:
    """Return the Schedule with its last heating interval begun as early as the UncertaintyMargin asks."""
    last = _last_interval(trip, schedule)
    if last is None:
        return schedule
    first, start_s = last
    end_s = _latest_end_s(trip, schedule)
    if not uncertainty_margin.is_heating and (_heated_s(trip, schedule, first) < uncertainty_margin.least_heating_s
                                              or _comes_too_late(trip, schedule, start_s)):
        return LastInterval(trip, state, schedule, first, start_s).without()
    early_s = _earlier_s(trip, start_s, uncertainty_margin.lead_k)
    if uncertainty_margin.is_heating and early_s <= uncertainty_margin.least_pause_s:
        early_s = 0.0
    if early_s >= start_s:
        return schedule
    interval = LastInterval(trip, state, schedule, trip.route.segment_at(early_s), early_s)
    # Heat that comes earlier is not needed later.
    guess_s = end_s - (start_s - early_s)
    if interval.may_leave_limits_aside():
        early = interval.until(_needed_until_s(interval, interval.arrival_c, target_c, guess_s))
        if limits_hold(trip, early):
            return early
    return interval.until_within_limits(
        _needed_until_s(interval, interval.arrival_within_limits_c, target_c, guess_s))


def _last_interval(trip: Trip, schedule: Schedule) -> tuple[int, float] | None:
    """Return (first step, instant [s]) of the heating that lasts until arrival; None without."""
    # Steps in which heating is impossible are not a pause.
    possible = (trip.heater_limit_w > 0.0) & (trip.time_s[:-1] < _latest_end_s(trip, schedule))
    heated = schedule.heater_power_w > HEATING_SHARE * trip.heater_limit_w
    last = np.flatnonzero(possible)[-1:]
    if not heated[last].any():
        return None
    pauses = np.flatnonzero(possible & ~heated)
    first = int(pauses[-1]) + 1 if len(pauses) else 0
    start_s = switched_on_s(
        trip, np.where(np.arange(len(heated)) >= first, schedule.heater_power_w, 0.0))
    return None if start_s is None else (first, start_s)


def _latest_end_s(trip: Trip, schedule: Schedule) -> float:
    """Return the instant [s] after which heat would come too late: the arrival, without a lag."""
    if schedule.heat is None or schedule.heating_end_s is None:
        return float(trip.time_s[-1])
    return schedule.heating_end_s


def _heated_s(trip: Trip, schedule: Schedule, first: int) -> float:
    """Return the planned heat from a step on, as time at full power [s]."""
    limit_w, power_w = trip.heater_limit_w[first:], schedule.heater_power_w[first:]
    possible = limit_w > 0.0
    return float((power_w[possible] / limit_w[possible] * trip.route.duration_s[first:][possible]).sum())


def _comes_too_late(trip: Trip, schedule: Schedule, start_s: float) -> bool:
    """Return whether most of the heat from an instant [s] on would be under way on arrival."""
    return (schedule.heat is not None
            and float(trip.time_s[-1]) - start_s < trip.vehicle.heat_path.heat_lag_s)


def _heat_w(trip: Trip, step: int) -> float:
    """Return the highest heat that the heater can give in a step [W]."""
    return trip.vehicle.hvch.efficiency * float(trip.heater_limit_w[step])


def _earlier_s(trip: Trip, until_s: float, lead_k: float) -> float:
    """
    Return the instant [s] from which the heater gives `lead_k` kelvin by `until_s` [s].

    Never an instant at which the cabin takes the whole heater; at the earliest the first other one.
    """
    if lead_k <= 0.0:
        return until_s
    heat_w = trip.vehicle.hvch.efficiency * trip.heater_limit_w
    given_j = np.concatenate(([0.0], np.cumsum(heat_w * trip.route.duration_s)))
    wanted_j = max(0.0, float(np.interp(until_s, trip.time_s, given_j))
                   - lead_k * trip.vehicle.battery.heat_capacity_j_per_k)
    # The last step that begins with no more heat than that gives some, so its power is not 0.
    step = int(np.searchsorted(given_j, wanted_j, side='right')) - 1
    return min(float(trip.time_s[step] + (wanted_j - given_j[step]) / heat_w[step]), until_s)


class LastInterval:
    """A Schedule whose last heating interval begins at a given instant."""

    def __init__(self, trip: Trip, state: BatteryState, schedule: Schedule, first: int,
                 start_s: float) -> None:
        """Take the step `first` in which the interval begins, and its instant `start_s` [s]."""
        self._trip, self._state, self._schedule = trip, state, schedule
        self._first, self.start_s = first, start_s
        # Earlier heating stays.
        self._before_w = np.where(
            np.arange(len(trip.route)) < first, schedule.heater_power_w, 0.0)
        # A run within limits: all of them are the same until the interval begins.
        self._driven: Schedule | None = None

    @property
    def arrival_s(self) -> float:
        """The instant of arrival [s]."""
        return float(self._trip.time_s[-1])

    @property
    def latest_end_s(self) -> float:
        """The instant after which heat would come too late [s]."""
        return _latest_end_s(self._trip, self._schedule)

    def rate_k_per_s(self, end_s: float) -> float:
        """Return how much warmer the battery arrives for each second of longer heating, approximately."""
        trip, step = self._trip, self._trip.route.segment_at(end_s)
        capacity = trip.vehicle.battery.heat_capacity_j_per_k
        left = math.exp(-float(trip.leakage_w_per_k[step]) / capacity * (self.arrival_s - end_s))
        return _heat_w(trip, step) / capacity * left

    def may_leave_limits_aside(self) -> bool:
        """Return whether no limit is active before the interval, in the unchanged part."""
        return self._first == 0 or limits_hold(self._trip, self._schedule, self._first)

    def without(self) -> Schedule:
        """Return the Schedule without the interval, within the battery's limits."""
        return drive_as_planned(self._trip, self._state, self._before_w, take_surplus=True)

    def arrival_within_limits_c(self, end_s: float) -> float:
        """Return the temperature on arrival [deg C] of `until_within_limits`, at less cost."""
        if self._driven is None:
            return float(self.until_within_limits(end_s).temperature_c[-1])
        states, _, _ = course_within_limits(
            self._trip, self._state, watch_everywhere(self._trip), WantedHeat(self._heater_w(end_s)),
            True, self._first, self._driven)
        return float(states[1, -1])

    def until_within_limits(self, end_s: float) -> Schedule:
        """Return the Schedule that heats until `end_s` [s], as far as the battery's limits allow."""
        self._driven = drive_as_planned(
            self._trip, self._state, self._heater_w(end_s), take_surplus=True, first=self._first,
            before=self._driven)
        return replace(self._driven, heating_end_s=self._heating_end_s(end_s))

    def arrival_c(self, end_s: float) -> float:
        """Return the temperature on arrival [deg C] of `until`, at less cost."""
        trip, planned, first = self._trip, self._schedule, self._first
        heater_w = self._heater_w(end_s)
        if planned.heat is not None:
            return float(roll_heated(
                trip, states_at(planned, first), heater_w, first, planned.brake_power_w)[1, -1])
        _, temperature_c = run_on(trip, make_runge_kutta_4, planned.soc, planned.temperature_c, first,
                                  heater_w, planned.brake_power_w)
        return float(temperature_c[-1])

    def until(self, end_s: float) -> Schedule:
        """Return the Schedule that heats until `end_s` [s], ignoring limits."""
        trip, planned, first = self._trip, self._schedule, self._first
        heater_w = self._heater_w(end_s)
        heating_start_s = switched_on_s(trip, self._before_w)
        if heating_start_s is None and end_s > self.start_s:
            heating_start_s = self.start_s
        if planned.heat is not None:
            run = run_heated(trip, states_at(planned, first), heater_w, planned.brake_power_w, first,
                             planned)
            return replace(run, heating_start_s=heating_start_s,
                           heating_end_s=self._heating_end_s(end_s))
        soc, temperature_c = run_on(
            trip, make_runge_kutta_4, planned.soc, planned.temperature_c, first, heater_w,
            planned.brake_power_w)
        return Schedule(
            heating_start_s, heater_w, planned.brake_power_w, soc, temperature_c, make_runge_kutta_4,
            self._heating_end_s(end_s))

    def _heater_w(self, end_s: float) -> FloatArray:
        """Return the mean heater power of each step [W], shape (N,)."""
        trip = self._trip
        heated_s = np.minimum(trip.time_s[1:], end_s) - np.maximum(trip.time_s[:-1], self.start_s)
        share = np.clip(heated_s / trip.route.duration_s, 0.0, 1.0)
        return np.maximum(self._before_w, share * trip.heater_limit_w)

    def _heating_end_s(self, end_s: float) -> float | None:
        return end_s if self.start_s < end_s < self.arrival_s else None


def _needed_until_s(interval: LastInterval, arrival_c: Callable[[float], float], target_c: float,
                    guess_s: float) -> float:
    """Return the end of heating [s] with which the battery arrives at the target."""
    def heated_until(end_s: float) -> Trial[None]:
        return Trial(end_s, arrival_c(end_s) - target_c, None)

    # The later heating ends, the warmer the battery arrives.
    first = heated_until(min(max(guess_s, interval.start_s), interval.latest_end_s))
    return follow_slope(
        interval.latest_end_s, interval.start_s, first, interval.rate_k_per_s(first.value), heated_until,
        ARRIVAL_TOLERANCE_K, END_RESOLUTION_S, MOST_RUNS).value
