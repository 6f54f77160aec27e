# SPDX-License-Identifier: Apache-2.0
"""The outcome of a schedule: energies, heating intervals with reasons, deficits of charge and of power."""
from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics import JOULES_PER_WH
from bev_preheat.planning.engine import keep_accounts, limits_of_steps_w
from bev_preheat.planning.limits import colder, limits_along
from bev_preheat.planning.schedule import HeatingInterval, Reason, REASONS, Schedule, ScheduleOutcome, Stranding
from bev_preheat.tunables import HEATING_SHARE, POWER_TOLERANCE, ROUNDING_W, TOO_LATE_LAGS, WARMER_K

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray, IntArray
    from bev_preheat.planning.trip import Trip


SENTENCES = {
    Reason.ARRIVAL: 'to be warm on arrival',
    Reason.SURPLUS: 'with regeneration that the cold battery cannot accept',
    Reason.DESCENT: 'so that the battery accepts more of the regeneration ahead',
    Reason.CLIMB: 'so that the battery can deliver the power of the climb ahead',
}


def may_end_early(schedule: Schedule, target_c: float) -> bool:
    """Return whether heating for the arrival at a target [deg C] may end before it, because heat arrives late."""
    return schedule.heat is not None and float(schedule.temperature_c[-1]) <= target_c + WARMER_K


def heating_intervals(trip: Trip, schedule: Schedule, least_w: FloatArray,
                      target_c: float = math.inf) -> tuple[HeatingInterval, ...]:
    """
    Return the HeatingIntervals of a Schedule, in order.

    `least_w` is the least terminal power [W] that the battery may take in each step, shape (N,). The target
    [deg C] is that of heating for the arrival.
    """
    heater_w = schedule.heater_power_w
    heated = heater_w > HEATING_SHARE * trip.heater_limit_w
    if not heated.any():
        return ()
    regenerates = trip.route.propulsion_power_w < 0.0
    surplus = (heated & regenerates
               & (heater_w <= least_w - trip.idle_power_w + ROUNDING_W))
    first = int(heated.argmax())
    # If heat would come too late, heating ends before arrival.
    too_late, last_of_all = len(heated), int(np.flatnonzero(heated)[-1]) + 1
    left_s = trip.time_s[-1] - trip.time_s[last_of_all]
    if may_end_early(schedule, target_c) and left_s <= TOO_LATE_LAGS * trip.vehicle.heat_path.heat_lag_s:
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
        make_interval(schedule, start_s, end_s, energy_j / JOULES_PER_WH, REASONS[reason])
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
    """
    Power that the battery cannot deliver in the worst step [W].

    `worst_w` is 0 if the deficit is only rounding; `at` is the step.
    """

    worst_w: float
    at: int


def power_deficit(trip: Trip, schedule: Schedule, most_w: FloatArray | None = None) -> PowerDeficit:
    """
    Return the PowerDeficit of a Schedule of a Trip.

    `most_w` (N,) is the highest terminal power that the battery can give [W], if known.
    """
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
        schedule.heating_start_s if schedule.heater_power_w.any() else None,
        deficit.worst_w, float(trip.time_s[deficit.at]) if deficit.worst_w > 0.0 else None,
        find_stranding(trip, schedule))
