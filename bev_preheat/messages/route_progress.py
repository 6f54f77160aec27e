# SPDX-License-Identifier: Apache-2.0
"""The vehicle's place on the route: RouteProgress, and NavSatFix, from which a place is found."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus

from bev_preheat.control.events import ProgressArrived, ProgressUnreadable
from bev_preheat.control.inputs import Progress
from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.messages.fields import nanoseconds, route_id_problems, stamp_problems, time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.line import Fix
from bev_preheat_msgs.msg import RouteProgress

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

LIMITS = {'latitude': 90.0, 'longitude': 180.0}


def progress_event(message: RouteProgress, hint: str = '') -> ProgressArrived | ProgressUnreadable:
    """Return the event of a RouteProgress; `hint` is added to a refusal."""
    problems = []
    if message.distance == 0.0 and not message.has_distance:
        problems.append('distance: 0 counts as not given where has_distance is false; set it for a '
                        'vehicle that has not left the start')
    problems += route_id_problems(message.route_id) + stamp_problems(message.header.stamp)
    if problems:
        return ProgressUnreadable(InvalidInput([*problems, hint] if hint else problems))
    return ProgressArrived(Progress(
        message.distance, nanoseconds(message.header.stamp), message.route_id,
        nanoseconds(message.route_stamp) or None), hint)


def progress_message(progress: Progress) -> RouteProgress:
    """Return the RouteProgress of a Progress."""
    message = RouteProgress(route_id=progress.route_id, distance=progress.distance_m, has_distance=True,
                            route_stamp=time_message(progress.route_start_ns or 0))
    message.header.stamp = time_message(progress.stamp_ns)
    return message


def fix_from_message(message: NavSatFix, now_ns: int, oldest_s: float, ahead_s: float) -> Fix:
    """
    Return the Fix of a sensor_msgs/NavSatFix that arrives now [ns].

    Raises InvalidInput, with one problem per field: no fix, a position that is not finite or not on earth, a stamp
    more than `oldest_s` [s] old or more than `ahead_s` [s] ahead. An unusable covariance counts as unknown.
    """
    problems = stamp_problems(message.header.stamp) or age_problems(
        message.header.stamp, now_ns, oldest_s, ahead_s, 'position')
    status = message.status.status
    if status < NavSatStatus.STATUS_FIX:
        meaning = 'no fix' if status == NavSatStatus.STATUS_NO_FIX else 'not known'
        problems.append(f'status.status: {status} means {meaning}; a receiver that has a fix sets it to 0 or more')
    for name, limit in LIMITS.items():
        value = getattr(message, name)
        if not abs(value) <= limit:
            problems.append(f'{name}: {value:g} is not allowed; it must be {-limit:g} ... {limit:g} deg')
    if problems:
        raise InvalidInput(problems)
    return Fix(nanoseconds(message.header.stamp), message.latitude, message.longitude, _deviation_m(message))


def age_problems(stamp: Time, now_ns: int, oldest_s: float, ahead_s: float, what: str) -> list[str]:
    """Return the problem of a stamp more than `oldest_s` [s] before now [ns], or `ahead_s` [s] after it."""
    age_s = (now_ns - nanoseconds(stamp)) / NS_PER_S
    return [] if -ahead_s <= age_s <= oldest_s else [
        f'header.stamp: the {what} is {age_beyond(age_s, ahead_s, oldest_s)}']


def _deviation_m(message: NavSatFix) -> float | None:
    """Return the largest horizontal standard deviation [m] of a NavSatFix; None: not known."""
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return None
    # Row-major, east, north, up.
    covariance_m2 = np.asarray(message.position_covariance, dtype=float).reshape(3, 3)[:2, :2]
    if not np.isfinite(covariance_m2).all() or not (np.diag(covariance_m2) > 0.0).all():
        return None
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance_m2)[-1]), 0.0))
