# SPDX-License-Identifier: Apache-2.0
"""The route's line on the map, position fixes, and their places on it or the reason for none."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray


@dataclass(frozen=True)
class RouteLine:
    """
    M points of a route on the map (WGS 84), each array of shape (M,), M >= 2.

    `distance_m` counts along the line and never falls. `elapsed_s` is the planned time since the start of
    segment 0 and never falls; at a stop it rises while `distance_m` stays.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    distance_m: FloatArray
    elapsed_s: FloatArray


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
