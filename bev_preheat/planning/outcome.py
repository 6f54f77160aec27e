# SPDX-License-Identifier: Apache-2.0
"""What comes of a schedule: its energies, its stretches of heating, and what the drive lacks."""

from __future__ import annotations

import math
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.compiled import plans as compiled_plans
from bev_preheat.planning.dynamics import compiled_vehicle, energies_of, keep_accounts, limits_along
from bev_preheat.planning.safeguard import lacking_power
from bev_preheat.planning.stranding import find_stranding
from bev_preheat.planning.stretches import heating_stretches, make_stretch, may_end_early, REASONS

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray
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


def find_outcome(trip: Trip, schedule: Schedule, target_c: float = math.inf) -> Outcome:
    """Return the Outcome of a Schedule of a Trip; the target [deg C] is what heating for the arrival is for."""
    least_w, most_w = limits_along(trip, schedule)
    lacking = lacking_power(trip, schedule, most_w)
    # The circuit's own limit lies at the battery's or above it.
    is_deliverable = lacking.worst_w == 0.0
    energy_wh, stretches = _found_by_core(trip, schedule, target_c, least_w, is_deliverable) or (
        keep_accounts(trip, schedule, is_deliverable).energy_wh,
        heating_stretches(trip, schedule, least_w, target_c))
    return Outcome(
        energy_wh, stretches, schedule.heating_start_s if schedule.heater_power_w.any() else None,
        lacking.worst_w, float(trip.time_s[lacking.at]) if lacking.worst_w > 0.0 else None,
        find_stranding(trip, schedule))


def _found_by_core(trip: Trip, schedule: Schedule, target_c: float, least_w: FloatArray,
                   is_deliverable: bool) -> tuple[Energies, tuple[HeatingStretch, ...]] | None:
    """
    Return energies and HeatingStretches of a Schedule; None where the compiled core does not answer.

    Target [deg C] and `least_w` (N,) are those of `heating_stretches`. `is_deliverable`: the circuit gives
    every power that is asked for.
    """
    vehicle, heat = compiled_vehicle(trip.vehicle), schedule.heat
    if vehicle is None or schedule.driven_share is not None:
        return None
    found = compiled_plans.find_outcome(
        vehicle, schedule.make_integrator, trip.compiled, is_deliverable, schedule.soc,
        schedule.temperature_c, schedule.drawn_power_w, None if heat is None else heat.arriving_heat_w,
        schedule.brake_power_w, schedule.heater_power_w, least_w, may_end_early(schedule, target_c))
    if found is None:
        return None
    energies_wh, stretches = found
    instants_s = trip.time_s.tolist()
    return (energies_of(energies_wh, 0.0 if heat is None else heat.lost_electric_wh), tuple(
        make_stretch(schedule, instants_s[first], instants_s[last], energy_wh, REASONS[reason])
        for first, last, reason, energy_wh in stretches))
