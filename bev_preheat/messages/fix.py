# SPDX-License-Identifier: Apache-2.0
"""NavSatFix: a position, from which the place on the route is found."""

from __future__ import annotations

import math

from builtin_interfaces.msg import Time
import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus

from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.messages.fields import nanoseconds, stamp_problems
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.line import Fix

LIMITS = {'latitude': 90.0, 'longitude': 180.0}


def fix_from_message(message: NavSatFix, now_ns: int, oldest_s: float, ahead_s: float) -> Fix:
    """
    Return the Fix of a sensor_msgs/NavSatFix that arrives now [ns].

    Raises InvalidInput, with one problem per field: no fix, a position that is not finite or not on earth, a stamp
    more than `oldest_s` [s] old or more than `ahead_s` [s] ahead. An unusable covariance counts as unknown.
    """
    problems = stamp_problems(message.header.stamp) or _age_problems(
        message.header.stamp, now_ns, oldest_s, ahead_s)
    status = message.status.status
    if status < NavSatStatus.STATUS_FIX:
        meaning = 'no fix' if status == NavSatStatus.STATUS_NO_FIX else 'not known'
        problems.append(f'status.status: {status} means {meaning}; a receiver that has a fix sets it to 0 or more')
    for name, limit in LIMITS.items():
        value = getattr(message, name)
        if not abs(value) <= limit:
            problems.append(f'{name}: {value:g} is not allowed; it must be {-limit:g} ... {limit:g} deg')
    if message.latitude == message.longitude == 0.0:
        problems.append('latitude, longitude: 0, 0 means no position')
    if problems:
        raise InvalidInput(problems)
    return Fix(nanoseconds(message.header.stamp), message.latitude, message.longitude, _deviation_m(message))


def _age_problems(stamp: Time, now_ns: int, oldest_s: float, ahead_s: float) -> list[str]:
    """Return the problem of a stamp more than `oldest_s` [s] before now [ns], or `ahead_s` [s] after it."""
    age_s = (now_ns - nanoseconds(stamp)) / NS_PER_S
    return [] if -ahead_s <= age_s <= oldest_s else [
        f'header.stamp: the position is {age_beyond(age_s, ahead_s, oldest_s)}']


def _deviation_m(message: NavSatFix) -> float | None:
    """Return the largest horizontal standard deviation [m] of a NavSatFix; None: not known."""
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return None
    # Row-major, east, north, up.
    covariance_m2 = np.asarray(message.position_covariance, dtype=float).reshape(3, 3)[:2, :2]
    if not np.isfinite(covariance_m2).all() or not (np.diag(covariance_m2) > 0.0).all():
        return None
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance_m2)[-1]), 0.0))
