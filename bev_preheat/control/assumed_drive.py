# SPDX-License-Identifier: Apache-2.0
"""
The drive until a battery is to be warm: the route's, or the drive of the last minutes continued.

The vehicle stands while it is plugged in, before its route begins, at stops and after the route's end.
Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from functools import reduce
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.route.segments import LIMITS, make_route, Route
from bev_preheat.tunables import ASSUMED_FROM_NS, STANDING_W

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg, Mission
    from bev_preheat.vehicle.description import Defaults

# Samples are this far apart or more.
SPACED_NS = NS_PER_S


class DriveMemory(NamedTuple):
    """
    Power that drivetrain and other consumers took from the battery in the last 5 minutes; a value.

    `samples` are (instant [ns], power [W]), oldest first; (): the vehicle stands.
    """

    samples: tuple[tuple[int, float], ...] = ()

    def seen(self, stamp_ns: int, power_w: float | None, heater_w: float) -> DriveMemory:
        """Return the memory with the battery's power [W], None: unknown, which includes the heater's [W]."""
        samples = () if self.samples and stamp_ns < self.samples[-1][0] else self.samples
        if power_w is None or (samples and stamp_ns - samples[-1][0] < SPACED_NS):
            return self if samples is self.samples else DriveMemory(samples)
        first = next((at for at, sample in enumerate(samples) if sample[0] >= stamp_ns - ASSUMED_FROM_NS),
                     len(samples))
        return DriveMemory((*samples[first:], (stamp_ns, power_w - heater_w)))

    def propulsion_w(self, now_ns: int, others_w: float) -> tuple[float, float]:
        """
        Return (mean, root mean square) of the propulsion power [W]; (0, 0) for a vehicle that stands.

        `others_w` [W] is the power of cabin and auxiliaries.
        """
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
    """
    Return a Route of one segment for a vehicle that keeps driving, or stands; its speed is unknown: 0.

    `propulsion_w` is (mean, root mean square) of its propulsion power [W].
    """
    mean_w, rms_w = propulsion_w
    return make_route({
        'duration_s': [max(duration_s, LIMITS['duration_s'][0])], 'speed_mps': [0.0],
        'propulsion_power_w': [mean_w], 'propulsion_power_rms_w': [rms_w],
        'ambient_temperature_c': [ambient_c]}, defaults)


def drive_of_route(mission: Mission, from_ns: int, until_ns: int, defaults: Defaults) -> Route:
    """Return the Route between two instants [ns] of a Mission; the vehicle stands outside the legs."""
    parts, reached_ns = [], from_ns

    def stand(to_ns: int, leg: Leg, segment: int) -> None:
        nonlocal reached_ns
        if to_ns > reached_ns:
            parts.append(steady_drive((to_ns - reached_ns) / NS_PER_S, float(
                leg.route.ambient_temperature_c[segment]), defaults))
            reached_ns = to_ns

    for leg in mission.legs:
        stand(min(leg.start_ns, until_ns), leg, 0)
        end_ns = min(leg.arrival_ns, until_ns)
        if end_ns > reached_ns:
            parts.append(_part(leg, reached_ns, end_ns))
            reached_ns = end_ns
    stand(until_ns, mission.legs[-1], -1)
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
