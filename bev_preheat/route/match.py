# SPDX-License-Identifier: Apache-2.0
"""A position fix, and its place on the route or the reason for none."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Cause(Enum):
    """The reason for a place, or for none."""

    MATCHED = 'on the route'
    RECKONED = 'on the route by the odometer'
    SILENT = 'no position yet'
    CONFIRMING = 'place to be confirmed'
    AMBIGUOUS = 'several places possible'
    UNCERTAIN = 'place too uncertain'
    OUTLIER = 'position contradicts the place'
    OFF_ROUTE = 'off the route'
    ELSEWHERE = 'on another part of the route'
    AGAINST = 'against the direction of the route'
    ARRIVED = 'beyond the end of the route'
    COARSE = 'position too coarse'
    FROZEN = 'position frozen'
    OVERTAKEN = 'position out of order'


class Fix(NamedTuple):
    """A position [deg, WGS 84] at an instant [ns], with the deviation of each of its axes [m]; None: unknown."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    deviation_m: float | None = None


class Match(NamedTuple):
    """
    The place on the line at an instant: distance [m] and standard deviation [m], both None in doubt.

    `sentence` explains the cause.
    """

    cause: Cause
    sentence: str
    stamp_ns: int
    distance_m: float | None = None
    deviation_m: float | None = None
