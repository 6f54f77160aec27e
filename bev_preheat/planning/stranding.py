# SPDX-License-Identifier: Apache-2.0
"""Where the charge runs out along a trip, and the energy missing to arrive."""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.planning.dynamics import JOULES_PER_WH

if TYPE_CHECKING:
    from bev_preheat.planning.schedule import Schedule
    from bev_preheat.planning.trip import Trip


class Stranding(NamedTuple):
    """
    The charge runs out `at_s` [s] and `at_m` [m] after the start of the trip.

    `deficit_wh` is the energy at the battery's terminals for the rest of the trip [Wh]; the losses of a battery
    that had this energy come on top.
    """

    at_s: float
    at_m: float
    deficit_wh: float


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
