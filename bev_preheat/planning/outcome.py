# SPDX-License-Identifier: Apache-2.0
"""The outcome of a schedule: its energies, its heating intervals, and its deficits."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.native import plans as native_plans
from bev_preheat.planning.dynamics import energies_of, keep_accounts, limits_along, native_vehicle
from bev_preheat.planning.heating_intervals import heating_intervals, make_interval, may_end_early, REASONS
from bev_preheat.planning.no_regret import power_deficit
from bev_preheat.planning.stranding import find_stranding

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.dynamics import Energies
    from bev_preheat.planning.heating_intervals import HeatingInterval
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.stranding import Stranding
    from bev_preheat.planning.trip import Trip


class ScheduleOutcome(NamedTuple):
    """
    The outcome of a Schedule; the fields are those of Plan.

    `heating_start_s` is None if the schedule does not heat.
    """

    energy_wh: Energies
    intervals: tuple[HeatingInterval, ...]
    heating_start_s: float | None
    undeliverable_power_w: float = 0.0
    undeliverable_at_s: float | None = None
    stranding: Stranding | None = None


def find_outcome(trip: Trip, schedule: Schedule, target_c: float = math.inf) -> ScheduleOutcome:
    """Return the ScheduleOutcome of a Schedule of a Trip; the target [deg C] is the one to arrive at."""
    least_w, most_w = limits_along(trip, schedule)
    deficit = power_deficit(trip, schedule, most_w)
    # The circuit's own limit is at or above the battery's.
    is_deliverable = deficit.worst_w == 0.0
    energy_wh, intervals = _found_by_core(trip, schedule, target_c, least_w, is_deliverable) or (
        keep_accounts(trip, schedule, is_deliverable).energy_wh,
        heating_intervals(trip, schedule, least_w, target_c))
    return ScheduleOutcome(
        energy_wh, intervals, schedule.heating_start_s if schedule.heater_power_w.any() else None,
        deficit.worst_w, float(trip.time_s[deficit.at]) if deficit.worst_w > 0.0 else None,
        find_stranding(trip, schedule))


def _found_by_core(trip: Trip, schedule: Schedule, target_c: float, least_w: FloatArray,
                   is_deliverable: bool) -> tuple[Energies, tuple[HeatingInterval, ...]] | None:
    """
    Return energies and HeatingIntervals of a Schedule; None if the native core does not answer.

    Target [deg C] and `least_w` (N,) are those of `heating_intervals`. `is_deliverable`: the circuit delivers
    every requested power.
    """
    vehicle, heat = native_vehicle(trip.vehicle), schedule.heat
    if vehicle is None or schedule.driven_share is not None:
        return None
    found = native_plans.find_outcome(
        vehicle, schedule.make_integrator, trip.native, is_deliverable, schedule.soc,
        schedule.temperature_c, schedule.drawn_power_w, None if heat is None else heat.arriving_heat_w,
        schedule.brake_power_w, schedule.heater_power_w, least_w, may_end_early(schedule, target_c))
    if found is None:
        return None
    energies_wh, intervals = found
    instants_s = trip.time_s.tolist()
    return (energies_of(energies_wh, 0.0 if heat is None else heat.lost_electric_wh), tuple(
        make_interval(schedule, instants_s[first], instants_s[last], energy_wh, REASONS[reason])
        for first, last, reason, energy_wh in intervals))
