# SPDX-License-Identifier: Apache-2.0
"""Positions as messages: NavSatFix into a Fix, and the diagnostics of a Match."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np
from sensor_msgs.msg import NavSatFix, NavSatStatus

from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.nodes.convert import nanoseconds, stamp_problems
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.route.match import Cause, Fix

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from bev_preheat.route.match import Match

LIMITS = {'latitude': 90.0, 'longitude': 180.0}
# The place is known, or no longer needed.
GOOD = (Cause.MATCHED, Cause.RECKONED, Cause.ARRIVED)


def fix_from_message(message: NavSatFix, now_ns: int, oldest_s: float, ahead_s: float) -> Fix:
    """
    Return the Fix of a sensor_msgs/NavSatFix that arrives now [ns].

    Raises InvalidInput, with one problem per field: no fix, a position that is not finite or not on earth, a stamp
    more than `oldest_s` [s] old or more than `ahead_s` [s] ahead. An unusable covariance counts as unknown.
    """
    problems = stamp_problems(message.header.stamp)
    if not problems:
        age_s = (now_ns - nanoseconds(message.header.stamp)) / NS_PER_S
        if not -ahead_s <= age_s <= oldest_s:
            problems.append(f'header.stamp: the position is {age_beyond(age_s, ahead_s, oldest_s)}')
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


def _deviation_m(message: NavSatFix) -> float | None:
    """Return the largest horizontal standard deviation [m] of a NavSatFix; None: not known."""
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return None
    # Row-major, east, north, up.
    covariance_m2 = np.asarray(message.position_covariance, dtype=float).reshape(3, 3)[:2, :2]
    if not np.isfinite(covariance_m2).all() or not (np.diag(covariance_m2) > 0.0).all():
        return None
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance_m2)[-1]), 0.0))


def log_place(logger: RcutilsLogger, match: Match) -> None:
    """Log the cause of a Match: a warning unless the place is known or the vehicle has arrived."""
    line = f'{match.cause.value}: {match.sentence}.'
    # One call for each severity: rclpy raises if a line of code logs with a second one.
    if match.cause in GOOD:
        logger.info(line)
    else:
        logger.warning(line)


def position_diagnostics(name: str, hardware: str, match: Match, refusal: str, now_ns: int,
                         values: dict[str, str]) -> DiagnosticStatus:
    """
    Return the DiagnosticStatus `NODE: position` of a Match and of the latest refused message, '' if none.

    WARN unless the place is known or the vehicle has arrived.
    """
    if match.distance_m is not None and match.deviation_m is not None:
        values = {'distance on the line [m]': f'{match.distance_m:.0f}',
                  'its standard deviation [m]': f'{match.deviation_m:.1f}', **values}
    if match.stamp_ns:
        values['age [s]'] = f'{(now_ns - match.stamp_ns) / NS_PER_S:.1f}'
    is_good = match.cause in GOOD and not refusal
    return DiagnosticStatus(
        name=f'{name.lstrip("/")}: position', hardware_id=hardware,
        level=DiagnosticStatus.OK if is_good else DiagnosticStatus.WARN,
        message='; '.join(filter(None, [f'{match.cause.value}: {match.sentence}', refusal])),
        values=[KeyValue(key=key, value=value) for key, value in {'cause': match.cause.name, **values}.items()])
