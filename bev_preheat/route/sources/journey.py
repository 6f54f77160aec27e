# SPDX-License-Identifier: Apache-2.0
"""The contents of a route's source before a car drives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray
    from bev_preheat.route.line import RouteLine
    from bev_preheat.route.road_load import Motion

# Duration [s] of the segments that samples are joined to.
SEGMENT_S = 30.0
# Slopes of roads for cars, rise over run.
SLOPE_RANGE = (-0.4, 0.4)


@dataclass(frozen=True)
class ChargingStop:
    """A charging stop after a segment (index), with its duration [s]."""

    after_segment: int
    duration_s: float


@dataclass(frozen=True)
class Journey:
    """
    The Motion along a route, and further figures of its source, each of shape (N,) or None if unknown.

    `consumption_wh` is the electrical energy of each segment; it replaces the road load. `remarks` are
    sentences on assumptions and repairs; `line` is the route on the map; `sampled`: the speeds are
    samples, so their segments are joined to longer ones. `stops` are the charging stops.
    """

    kind: str
    motion: Motion
    ambient_temperature_c: FloatArray | None = None
    consumption_wh: FloatArray | None = None
    cabin_heating_power_w: FloatArray | None = None
    auxiliary_power_w: FloatArray | None = None
    line: RouteLine | None = None
    stops: tuple[ChargingStop, ...] = ()
    remarks: tuple[str, ...] = ()
    sampled: bool = False


@dataclass(frozen=True)
class RouteOptions:
    """
    Figures that may be missing in a source.

    `ambient_temperature_c` [degC] applies if the file has none. `with_auxiliaries`: the consumption in the file
    includes heating and auxiliaries (None: not given). `free_speed_kmh` [km/h]: speed on free road, for a line
    without times. `stop_duration_s` [s]: duration of a charging stop at each waypoint (None: waypoints are
    passed). `vehicle_id`: the vehicle in a file with several.
    """

    ambient_temperature_c: float | None = None
    with_auxiliaries: bool | None = None
    free_speed_kmh: float | None = None
    stop_duration_s: float | None = None
    vehicle_id: str | None = None
