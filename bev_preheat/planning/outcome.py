# SPDX-License-Identifier: Apache-2.0
"""The outcome of a schedule: its energies, its heating intervals, and its deficits of charge and of power."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.factors import JOULES_PER_WH
from bev_preheat.planning.engine import keep_accounts
from bev_preheat.planning.heating_intervals import heating_intervals
from bev_preheat.planning.limits import limits_along
from bev_preheat.tunables import POWER_TOLERANCE

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.planning.dynamics import Energies
    from bev_preheat.planning.heating_intervals import HeatingInterval
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
