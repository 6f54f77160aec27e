# SPDX-License-Identifier: Apache-2.0
"""
The outcome of a schedule: energies, heating intervals with reasons, deficits; none is worse than not heating.

Paid heating costs charge. If the charge is not enough for the trip, nothing is heated. A plan that would use
charge from the reserve, or that increases a power deficit of the drive, is made again for the warmest target that
does neither.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.numerics import FloatArray, FLOATS, IntArray, JOULES_PER_WH
from bev_preheat.planning.bracketing import halve
from bev_preheat.planning.engine import keep_accounts, limits_of_steps_w
from bev_preheat.planning.limits import colder, limits_along, limits_hold, run_unheated
from bev_preheat.planning.schedule import HeatingInterval, HeldBack, Reason, Schedule, ScheduleOutcome, Stranding
from bev_preheat.planning.situation import BatteryState, Goal, reserve_soc
from bev_preheat.planning.trip import Trip
from bev_preheat.tunables import (
    HEATING_SHARE,
    NO_WORSE_W,
    POWER_TOLERANCE,
    ROUNDING_W,
    SOC_TOLERANCE,
    TARGET_HALVINGS,
    TOO_LATE_LAGS,
    WARMER_K,
)

SENTENCES = {
    Reason.ARRIVAL: 'to be warm on arrival',
    Reason.SURPLUS: 'with regeneration that the cold battery cannot accept',
    Reason.DESCENT: 'so that the battery accepts more of the regeneration ahead',
    Reason.CLIMB: 'so that the battery can deliver the power of the climb ahead',
}


def heating_intervals(trip: Trip, schedule: Schedule, least_w: FloatArray,
                      target_c: float = math.inf) -> tuple[HeatingInterval, ...]:
    """
    Return the HeatingIntervals of a Schedule, in order.

    `least_w` is the least terminal power [W] that the battery may take in each step, shape (N,). The target
    [deg C] is that of heating for the arrival.
    """
    heater_w = (schedule.heater_power_w if trip.mix.is_alone else
                np.where(schedule.heater_power_w > 0.0, schedule.drawn_power_w, 0.0))
    heated = heater_w > HEATING_SHARE * trip.heater_limit_w
    if not heated.any():
        return ()
    regenerates = trip.route.propulsion_power_w < 0.0
    surplus = (heated & regenerates
               & (heater_w <= least_w - trip.idle_power_w + ROUNDING_W))
    first = int(heated.argmax())
    too_late, last_of_all = len(heated), int(np.flatnonzero(heated)[-1]) + 1
    left_s = trip.time_s[-1] - trip.time_s[last_of_all]
    if (schedule.heat is not None and float(schedule.temperature_c[-1]) <= target_c + WARMER_K
            and left_s <= TOO_LATE_LAGS * trip.vehicle.heat_path.heat_lag_s):
        # Heat for the arrival would come too late, so heating ends before it.
        too_late = last_of_all
    if heated[first:too_late].all() and not surplus.any():
        # The usual case: from one instant on until arrival.
        steps = slice(first, too_late)
        return (make_interval(
            schedule, float(trip.time_s[first]), float(trip.time_s[too_late]),
            float(heater_w[steps] @ trip.route.duration_s[steps]) / JOULES_PER_WH, Reason.ARRIVAL),)
    kinds = np.where(surplus, int(Reason.SURPLUS), np.where(heated, int(Reason.ARRIVAL), -1))
    edges = np.concatenate(([0], np.flatnonzero(kinds[1:] != kinds[:-1]) + 1))
    reasons = kinds[edges]
    # The first step after each interval that gives a reason for heating before it.
    ends = np.append(edges[1:], len(kinds))
    for_later = np.flatnonzero((reasons == Reason.ARRIVAL) & (ends < too_late))
    if len(for_later):
        events = _events(trip, schedule)
        telling = np.flatnonzero(events >= 0)
        following = np.searchsorted(telling, ends[for_later])
        reasons[for_later] = np.append(events[telling], int(Reason.ARRIVAL))[following]
    energies_j = np.add.reduceat(heater_w * trip.route.duration_s, edges)
    is_interval = reasons >= 0
    return tuple(
        make_interval(schedule, start_s, end_s, energy_j / JOULES_PER_WH, Reason(reason))
        for start_s, end_s, energy_j, reason in zip(*(column[is_interval].tolist() for column in (
            trip.time_s[edges], trip.time_s[ends], energies_j, reasons))))


def make_interval(schedule: Schedule, start_s: float, end_s: float, energy_wh: float,
                  reason: Reason) -> HeatingInterval:
    """Return the HeatingInterval of a Schedule between two instants [s], with its energy [Wh]."""
    if schedule.heating_start_s is not None:
        start_s = max(start_s, schedule.heating_start_s)
    if schedule.heat is not None and schedule.heating_end_s is not None:
        end_s = min(end_s, schedule.heating_end_s)
    return HeatingInterval(start_s, end_s, energy_wh, reason)


def _events(trip: Trip, schedule: Schedule) -> IntArray:
    """Return the reason of each step for heating before it, shape (N,); -1 without one."""
    least_w, most_w = limits_of_steps_w(
        trip.vehicle, schedule.soc, colder(trip.vehicle, schedule.temperature_c),
        trip.power_variance_w2)
    events = np.full(len(trip.route), -1)
    events[(trip.route.propulsion_power_w < 0.0) & (trip.idle_power_w < least_w)] = Reason.DESCENT
    events[trip.idle_power_w > most_w] = Reason.CLIMB
    return events


def find_stranding(trip: Trip, schedule: Schedule) -> Stranding | None:
    """Return the Stranding of a Schedule of a Trip; None if the charge is enough for the trip."""
    if schedule.empty_at_s is None or schedule.driven_share is None:
        return None
    distance_m = np.concatenate(([0.0], np.cumsum(trip.route.duration_s * trip.route.speed_mps)))
    rest_j = np.cumsum(
        (1.0 - schedule.driven_share) * trip.idle_power_w * trip.route.duration_s)
    # Energy recovered on a later descent does not help before it.
    return Stranding(schedule.empty_at_s,
                     float(np.interp(schedule.empty_at_s, trip.time_s, distance_m)),
                     max(0.0, float(rest_j.max())) / JOULES_PER_WH)


class PowerDeficit(NamedTuple):
    """Power that the battery cannot deliver in the worst step [W], 0 for rounding, and that step."""

    worst_w: float
    at: int


def power_deficit(trip: Trip, schedule: Schedule, most_w: FloatArray | None = None) -> PowerDeficit:
    """Return the PowerDeficit of a Schedule; `most_w` (N,) is the most terminal power [W], if known."""
    if most_w is None:
        _, most_w = limits_along(trip, schedule)
    power_w = trip.idle_power_w + schedule.drawn_power_w - most_w
    if schedule.driven_share is not None:
        # When the vehicle stands without charge, it is short of energy, not of power.
        power_w = np.where(schedule.driven_share < 1.0, 0.0, power_w)
    at = int(power_w.argmax())
    worst_w = float(power_w[at])
    is_rounding = worst_w <= POWER_TOLERANCE * abs(float(trip.idle_power_w[at]))
    return PowerDeficit(0.0 if is_rounding else worst_w, at)


def find_outcome(trip: Trip, schedule: Schedule, target_c: float = math.inf) -> ScheduleOutcome:
    """Return the ScheduleOutcome of a Schedule of a Trip; the target [deg C] is the one to arrive at."""
    least_w, most_w = limits_along(trip, schedule)
    deficit = power_deficit(trip, schedule, most_w)
    # The circuit's own limit is at or above the battery's.
    is_deliverable = deficit.worst_w == 0.0
    return ScheduleOutcome(
        keep_accounts(trip, schedule, is_deliverable).energy_wh,
        heating_intervals(trip, schedule, least_w, target_c),
        schedule.heating_start_s if (schedule.heater_power_w > 0.0).any() else None,
        deficit.worst_w, float(trip.time_s[deficit.at]) if deficit.worst_w > 0.0 else None,
        find_stranding(trip, schedule))


# Returns the Schedule for a target [deg C].
Proposal = Callable[[float], Schedule]


def unheated_within_limits(trip: Trip, state: BatteryState, unheated: Schedule) -> Schedule:
    """Return the unheated Schedule if it keeps the limits, else a Schedule heated with free surplus only."""
    return unheated if limits_hold(trip, unheated) else run_unheated(trip, state)


class NoRegretCheck:
    """Checks proposals for one trip, state and goal against the trip without paid heating."""

    def __init__(self, trip: Trip, state: BatteryState, goal: Goal, unheated: Schedule) -> None:
        """`unheated` is the Schedule without any heating, ignoring limits."""
        self._trip, self._goal = trip, goal
        self.unheated = unheated_within_limits(trip, state, unheated)
        self._reserve = reserve_soc(trip.vehicle, goal)
        self._lowest_soc = trip.vehicle.battery.soc_range[0]
        deficit_w = power_deficit(trip, self.unheated).worst_w
        self._allowed_w = deficit_w + NO_WORSE_W if deficit_w > 0.0 else 0.0
        # If the reserve is missed without heating, heat may still pay for itself.
        self._least_spare = min(self._spare_soc(self.unheated), 0.0)

    def serve(self, proposals: Sequence[Proposal]) -> Schedule:
        """
        Return the first allowed Schedule of proposals, the last one's for the warmest allowed target, or unheated.

        A proposal is a function of a target [deg C] that returns a Schedule; the most demanding comes first.
        """
        if self.unheated.empty_at_s is not None:
            return self.unheated
        wanted_c, most_c = self._goal.target_temperature_c, self._goal.highest_arrival_c
        for propose in proposals:
            wanted = propose(wanted_c)
            if self.allows(wanted):
                return wanted
        if float(self.unheated.temperature_c[-1]) > most_c:
            wanted_c = most_c
        held_back = HeldBack.RESERVE if self._spare_soc(wanted) < self._least_spare else HeldBack.POWER
        return replace(self._warmest(propose, wanted_c), held_back=held_back)

    def allows(self, schedule: Schedule) -> bool:
        """Return whether a Schedule keeps the reserve, as far as the unheated one does, and the drive's power."""
        return (self._spare_soc(schedule) >= self._least_spare
                and power_deficit(self._trip, schedule).worst_w <= self._allowed_w)

    def _spare_soc(self, schedule: Schedule) -> float:
        """
        Charge to spare: above the reserve on arrival, and above the lowest state of charge on the way.

        Negative by the deficit if the charge runs out, even without a reserve.
        """
        spare = min(float(schedule.soc[-1]) - self._reserve,
                    float(schedule.soc.min()) - self._lowest_soc)
        stranding = find_stranding(self._trip, schedule)
        if stranding is None:
            return spare
        battery = self._trip.vehicle.battery
        whole_wh = battery.capacity_ah * battery.open_circuit_voltage.function(FLOATS)(
            0.0, float(schedule.temperature_c[-1]))
        return spare - max(stranding.deficit_wh / whole_wh, SOC_TOLERANCE)

    def _warmest(self, propose: Proposal, wanted_c: float) -> Schedule:
        """Return the warmest allowed Schedule, or coldest, of a proposal not allowed for its target [deg C]."""
        best = self.unheated

        def is_allowed(target_c: float) -> bool:
            nonlocal best
            schedule = propose(target_c)
            allowed = self.allows(schedule)
            best = schedule if allowed else best
            return allowed

        # Also above the arrival of the wanted plan: a heater that gives way to the drive misses any target.
        halve(float(best.temperature_c[-1]), wanted_c, is_allowed, TARGET_HALVINGS)
        return best
