# SPDX-License-Identifier: Apache-2.0
"""
The drive that the route plans between two instants, for the estimator.

If the vehicle is late or early, it is the drive at the vehicle's actual place. A route driven more slowly than
planned takes proportionally less power, because the energy per metre is the same; driven faster, it takes more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.charging.expectation import FASTEST_PACE
from bev_preheat.control.regime import PlannedPower
from bev_preheat.estimation.estimator import DrivenInterval
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.tunables import (
    AROUND_NS,
    AROUND_SHARE,
    LOOKED_UP_NS,
    MOST_AROUND_S,
    STANDING_AFTER_LONG_S,
    STANDING_AFTER_S,
)
from bev_preheat.vehicle.uncertain_car import DriveInputs

if TYPE_CHECKING:
    from bev_preheat.control.command_history import CommandHistory
    from bev_preheat.control.inputs import Leg, Mission
    from bev_preheat.control.timetable import Timetable
    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Defaults, Vehicle

# Places that are looked up.
SHIFTS = 25
# A segment lasts for many updates.
KEPT_SEGMENTS = 8


def intervals_between(edges_ns: Sequence[int], vehicle: Vehicle, timetable: Timetable | None,
                      commands: CommandHistory) -> tuple[DrivenInterval, ...]:
    """
    Return the estimation.estimator.DrivenInterval between each of the instants [ns] and the next.

    `timetable` is None without a route; `commands` is the CommandHistory.
    """
    intervals = []
    for from_ns, to_ns in zip(edges_ns, edges_ns[1:]):
        drive, limit_w = _driven_between(vehicle, timetable, from_ns, to_ns)
        intervals.append(DrivenInterval((to_ns - from_ns) / NS_PER_S, drive,
                                        commands.mean_w(from_ns, to_ns), limit_w))
    return tuple(intervals)


def driven_at(vehicle: Vehicle, timetable: Timetable | None, instant_ns: int) -> DriveInputs | None:
    """Return the DriveInputs that the route plans at an instant [ns]; None outside the legs."""
    if timetable is None:
        return None
    return _planned_at(vehicle, timetable.planned, timetable.planned_ns(instant_ns))[0]


def planned_around(timetable: Timetable | None, instant_ns: int, defaults: Defaults) -> PlannedPower:
    """Return the PlannedPower within AROUND_NS of an instant [ns]; from the Defaults outside the legs."""
    if timetable is not None:
        mission, planned_ns = timetable.planned, timetable.planned_ns(instant_ns)
        leg = mission.legs[mission.leg_number(planned_ns)]
        if leg.start_ns <= planned_ns < leg.arrival_ns:
            return _planned_power(leg, (planned_ns - leg.start_ns) // LOOKED_UP_NS)
    others_w = defaults.cabin_heating_power_w + defaults.auxiliary_power_w
    return PlannedPower(0.0, 0.0, 0.0, others_w, 0.0, 0.0, False)


@lru_cache(maxsize=KEPT_SEGMENTS)
def _planned_power(leg: Leg, number: int) -> PlannedPower:
    """Return the PlannedPower around an instant of a Leg, `number` times LOOKED_UP_NS after its start."""
    route, elapsed_s = leg.route, number * LOOKED_UP_NS / NS_PER_S
    around_s = min(AROUND_NS / NS_PER_S + AROUND_SHARE * elapsed_s, MOST_AROUND_S)
    first, last = (route.segment_at(elapsed_s + by_s) for by_s in (-around_s, around_s))
    part = slice(first, last + 1)
    propulsion_w = route.propulsion_power_w[part]
    return PlannedPower(
        float(np.average(propulsion_w, weights=route.duration_s[part])),
        float(propulsion_w.min()), float(propulsion_w.max()),
        float((route.cabin_heating_power_w[part] + route.auxiliary_power_w[part]).max()),
        _least_mean_w(route, elapsed_s, around_s, STANDING_AFTER_S),
        _least_mean_w(route, elapsed_s, around_s, STANDING_AFTER_LONG_S))


def _least_mean_w(route: Route, elapsed_s: float, around_s: float, over_s: float) -> float:
    """
    Return the least mean of the propulsion power [W] over `over_s` [s].

    The time ends within `around_s` [s] of an instant `elapsed_s` [s] after the start of the route.
    """
    energy_j = np.concatenate(([0.0], np.cumsum(route.propulsion_power_w * route.duration_s)))
    over_s = min(over_s, route.total_duration_s)
    ends_s = np.clip(elapsed_s + np.linspace(-around_s, around_s, SHIFTS), over_s, route.total_duration_s)
    taken_j = np.interp(ends_s, route.time_s, energy_j) - np.interp(ends_s - over_s, route.time_s, energy_j)
    return float(taken_j.min() / over_s)


def _driven_between(vehicle: Vehicle, timetable: Timetable | None, from_ns: int,
                    to_ns: int) -> tuple[DriveInputs | None, float]:
    """
    Return (DriveInputs, heater power left by the cabin [W]) for the middle of two instants [ns].

    (None, 0.0) outside the route: before its start, at stops, after its end.
    """
    if timetable is None:
        return None, 0.0
    planned_from_ns, planned_to_ns = map(timetable.planned_ns, (from_ns, to_ns))
    drive, limit_w = _planned_at(
        vehicle, timetable.planned, (planned_from_ns + planned_to_ns) // 2)
    pace = min(max((planned_to_ns - planned_from_ns) / (to_ns - from_ns), 0.0), FASTEST_PACE)
    return drive if drive is None or pace == 1.0 else _at_pace(drive, pace), limit_w


def _at_pace(drive: DriveInputs, pace: float) -> DriveInputs:
    """Return the DriveInputs of a route driven at `pace` times the planned pace."""
    return replace(
        drive, speed_mps=pace * drive.speed_mps,
        propulsion_power_w=pace * drive.propulsion_power_w,
        power_variance_w2=pace**2 * drive.power_variance_w2,
        propulsion_power_magnitude_w=pace * drive.propulsion_power_magnitude_w)


def _planned_at(vehicle: Vehicle, mission: Mission,
                middle_ns: int) -> tuple[DriveInputs | None, float]:
    """Return (DriveInputs, heater power left by the cabin [W]) that a Mission plans at an instant."""
    if middle_ns < mission.start_ns:
        return None, 0.0
    leg = mission.legs[mission.leg_number(middle_ns)]
    if leg.ended_for_s(middle_ns) >= 0.0:
        return None, 0.0
    return _planned_in(vehicle, leg, leg.route.segment_at((middle_ns - leg.start_ns) / NS_PER_S))


@lru_cache(maxsize=KEPT_SEGMENTS)
def _planned_in(vehicle: Vehicle, leg: Leg, at: int) -> tuple[DriveInputs, float]:
    """Return (DriveInputs, heater power left by the cabin [W]) of a segment of a Leg."""
    route = leg.route
    power_w = float(route.propulsion_power_w[at])
    rms_w = float(route.propulsion_power_rms_w[at])
    cabin_w = float(route.cabin_heating_power_w[at])
    drive = DriveInputs(
        speed_mps=float(route.speed_mps[at]),
        ambient_temperature_c=float(route.ambient_temperature_c[at]),
        propulsion_power_w=power_w,
        power_variance_w2=max(rms_w**2 - power_w**2, 0.0),
        propulsion_power_magnitude_w=float(route.propulsion_power_magnitude_w[at]),
        cabin_heating_power_w=cabin_w,
        auxiliary_power_w=float(route.auxiliary_power_w[at]),
        heater_power_w=0.0)
    return drive, max(0.0, vehicle.hvch.maximum_power_w - cabin_w)
