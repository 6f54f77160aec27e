# SPDX-License-Identifier: Apache-2.0
"""What comes of a schedule: its energies, its stretches of heating, and what the drive lacks."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.planning.dynamics import keep_accounts, limits_along
from bev_preheat.planning.safeguard import lacking_power
from bev_preheat.planning.stranding import find_stranding
from bev_preheat.planning.stretches import heating_stretches

if TYPE_CHECKING:
    from bev_preheat.planning.dynamics import Energies
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.stranding import Stranding
    from bev_preheat.planning.stretches import HeatingStretch
    from bev_preheat.planning.trip import Trip


class Outcome(NamedTuple):
    """
    What comes of a Schedule; the fields are those of Plan.

    `heating_start_s` is None where the schedule does not heat.
    """

    energy_wh: Energies
    stretches: tuple[HeatingStretch, ...]
    heating_start_s: float | None
    undeliverable_power_w: float = 0.0
    undeliverable_at_s: float | None = None
    stranding: Stranding | None = None


def find_outcome(trip: Trip, schedule: Schedule) -> Outcome:
    """Return the Outcome of a Schedule of a Trip."""
    least_w, most_w = limits_along(trip, schedule)
    lacking = lacking_power(trip, schedule, most_w)
    # The circuit's own limit lies at the battery's or above it.
    accounts = keep_accounts(trip, schedule, deliverable=lacking.worst_w == 0.0)
    return Outcome(
        accounts.energy_wh, heating_stretches(trip, schedule, least_w),
        schedule.heating_start_s if schedule.heater_power_w.any() else None,
        lacking.worst_w, float(trip.time_s[lacking.at]) if lacking.worst_w > 0.0 else None,
        find_stranding(trip, schedule))
