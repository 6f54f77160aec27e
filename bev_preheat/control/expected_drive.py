# SPDX-License-Identifier: Apache-2.0
"""
The drive that the planner expects: between two instants for the estimator, and until a battery is to be warm.

For the estimator it is the route's; if the vehicle is late or early, that at the vehicle's actual place. A route
driven more slowly than planned takes proportionally less power, because the energy per metre is the same; driven
faster, it takes more. Until a battery is to be warm it is the route's, or the drive of the last minutes
continued. The vehicle stands while it is plugged in, before its route begins, at stops and after the route's
end. Instants are integers, in nanoseconds of the node's clock.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, reduce
from itertools import dropwhile, pairwise
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.charging.expectation import FASTEST_PACE
from bev_preheat.control.heater import SourcePowers
from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.control.regime import PlannedPower
from bev_preheat.control.timetable import Timetable
from bev_preheat.estimation.estimator import DrivenInterval
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.tunables import (
    AROUND_NS,
    AROUND_SHARE,
    ASSUMED_FROM_NS,
    LOOKED_UP_NS,
    MOST_AROUND_S,
    STANDING_AFTER_LONG_S,
    STANDING_AFTER_S,
    STANDING_W,
)
from bev_preheat.vehicle.description import Defaults, Vehicle
from bev_preheat.vehicle.variants import DriveInputs

# Places that are looked up.
SHIFTS = 25
# A segment lasts for many updates.
KEPT_SEGMENTS = 8


def intervals_between(edges_ns: Sequence[int], vehicle: Vehicle, timetable: Timetable | None,
                      powers: SourcePowers, of: int = 0) -> tuple[DrivenInterval, ...]:
    """
    Return the DrivenInterval between each of the instants [ns] and the next; None: without a route.

    It is `of` the heat source of a number, and the others deliver their shares.
    """
    own, hvch_watts = powers.each[of], None
    intervals = []
    for from_ns, to_ns in pairwise(edges_ns):
        drive, limit_w = _driven_between(vehicle, timetable, from_ns, to_ns)
        if drive is not None and len(powers.each) > 1:
            ambient_c = float(drive.ambient_temperature_c)
            limits_w = [each.limit_w(limit_w, drive, powers.temperature_c) for each in powers.each]
            hvch_w, drawn_w, source_heat_w = powers.others_w(of, from_ns, to_ns, ambient_c, limits_w)
            drive = replace(drive, heater_power_w=hvch_w, source_heat_w=source_heat_w,
                            auxiliary_power_w=drive.auxiliary_power_w + drawn_w)
            limit_w = limits_w[of]
            hvch_watts = None if own.source is None else own.hvch_watts(ambient_c, powers.temperature_c)
        intervals.append(DrivenInterval((to_ns - from_ns) / NS_PER_S, drive, own.history.mean_w(
            from_ns, to_ns), limit_w, hvch_watts))
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
    """Return the least mean propulsion power [W] over `over_s` [s], ending around an instant of the route [s]."""
    energy_j = np.concatenate(([0.0], np.cumsum(route.propulsion_power_w * route.duration_s)))
    over_s = min(over_s, route.total_duration_s)
    ends_s = np.clip(elapsed_s + np.linspace(-around_s, around_s, SHIFTS), over_s, route.total_duration_s)
    taken_j = np.interp(ends_s, route.time_s, energy_j) - np.interp(ends_s - over_s, route.time_s, energy_j)
    return float(taken_j.min() / over_s)


def _driven_between(vehicle: Vehicle, timetable: Timetable | None, from_ns: int,
                    to_ns: int) -> tuple[DriveInputs | None, float]:
    """Return (DriveInputs, heater power left by the cabin [W]) between two instants; (None, 0.0) off the route."""
    if timetable is None:
        return None, 0.0
    planned_from_ns, planned_to_ns = map(timetable.planned_ns, (from_ns, to_ns))
    drive, limit_w = _planned_at(
        vehicle, timetable.planned, (planned_from_ns + planned_to_ns) // 2)
    pace = min(max((planned_to_ns - planned_from_ns) / (to_ns - from_ns), 0.0), FASTEST_PACE)
    if drive is None or pace == 1.0:
        return drive, limit_w
    return replace(
        drive, speed_mps=pace * drive.speed_mps, propulsion_power_w=pace * drive.propulsion_power_w,
        power_variance_w2=pace**2 * drive.power_variance_w2,
        propulsion_power_magnitude_w=pace * drive.propulsion_power_magnitude_w), limit_w


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


# Samples are this far apart or more.
SPACED_NS = NS_PER_S


class DriveMemory(NamedTuple):
    """Samples (instant [ns], power [W]) of drivetrain and consumers in the last 5 min, oldest first; a value."""

    samples: tuple[tuple[int, float], ...] = ()

    def seen(self, stamp_ns: int, power_w: float | None, heater_w: float) -> DriveMemory:
        """Return the memory with the battery's power [W], None: unknown, which includes the heater's [W]."""
        samples = () if self.samples and stamp_ns < self.samples[-1][0] else self.samples
        if power_w is None or (samples and stamp_ns - samples[-1][0] < SPACED_NS):
            return self if samples is self.samples else DriveMemory(samples)
        recent = dropwhile(lambda sample: sample[0] < stamp_ns - ASSUMED_FROM_NS, samples)
        return DriveMemory((*recent, (stamp_ns, power_w - heater_w)))

    def propulsion_w(self, now_ns: int, others_w: float) -> tuple[float, float]:
        """Return (mean, rms) of the propulsion power [W] without `others_w` [W]; (0, 0) for a standing vehicle."""
        powers_w = np.array([power_w - others_w for stamp_ns, power_w in self.samples
                             if 0 <= now_ns - stamp_ns <= ASSUMED_FROM_NS])
        if not len(powers_w):
            return 0.0, 0.0
        mean_w = float(powers_w.mean())
        rms_w = max(math.sqrt(float(np.mean(powers_w**2))), abs(mean_w))
        stands = mean_w <= 0.0 or (mean_w < STANDING_W and rms_w < STANDING_W)
        return (0.0, 0.0) if stands else (mean_w, rms_w)


def steady_drive(duration_s: float, ambient_c: float, defaults: Defaults,
                 propulsion_w: tuple[float, float] = (0.0, 0.0)) -> Route:
    """Return a Route of one segment of unknown speed, 0, with (mean, rms) of the propulsion power [W]."""
    mean_w, rms_w = propulsion_w
    return make_route({
        'duration_s': [max(duration_s, LIMITS['duration_s'][0])], 'speed_mps': [0.0],
        'propulsion_power_w': [mean_w], 'propulsion_power_rms_w': [rms_w],
        'ambient_temperature_c': [ambient_c]}, defaults)


def drive_of_route(mission: Mission, from_ns: int, until_ns: int, defaults: Defaults) -> Route:
    """Return the Route between two instants [ns] of a Mission; the vehicle stands outside the legs."""
    parts, reached_ns = [], from_ns
    # Ends of standing, and of driving (None), with the segment whose air surrounds a vehicle that stands.
    spans: list[tuple[int, Leg, int | None]] = []
    for leg in mission.legs:
        spans += (leg.start_ns, leg, 0), (leg.arrival_ns, leg, None)
    for end_ns, leg, segment in (*spans, (until_ns, mission.legs[-1], -1)):
        end_ns = min(end_ns, until_ns)
        if end_ns > reached_ns:
            parts.append(_part(leg, reached_ns, end_ns) if segment is None else steady_drive(
                (end_ns - reached_ns) / NS_PER_S, float(leg.route.ambient_temperature_c[segment]), defaults))
            reached_ns = end_ns
    return reduce(Route.followed_by, parts)


def drives_between(mission: Mission, from_ns: int, until_ns: int) -> bool:
    """Return whether a Mission drives at any time between two instants [ns], or at the first."""
    return any(leg.start_ns < max(until_ns, from_ns + 1) and leg.arrival_ns > from_ns
               for leg in mission.legs)


def _part(leg: Leg, from_ns: int, until_ns: int) -> Route:
    """Return the Route of a Leg between two instants [ns] on it."""
    total_s = leg.route.total_duration_s
    after_s, before_s = ((instant_ns - leg.start_ns) / NS_PER_S for instant_ns in (from_ns, until_ns))
    route = leg.route.before(min(before_s, total_s))
    return route.after(after_s) if after_s > 0.0 else route
