# SPDX-License-Identifier: Apache-2.0
"""The outcome of a schedule: its energies, its heating intervals, and its deficits."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.planning.dynamics import keep_accounts, limits_along
from bev_preheat.planning.heating_intervals import heating_intervals
from bev_preheat.planning.no_regret import power_deficit
from bev_preheat.planning.stranding import find_stranding

if TYPE_CHECKING:
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
    return ScheduleOutcome(
        keep_accounts(trip, schedule, is_deliverable).energy_wh,
        heating_intervals(trip, schedule, least_w, target_c),
        schedule.heating_start_s if schedule.heater_power_w.any() else None,
        deficit.worst_w, float(trip.time_s[deficit.at]) if deficit.worst_w > 0.0 else None,
        find_stranding(trip, schedule))
