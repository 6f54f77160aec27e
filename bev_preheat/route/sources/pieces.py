# SPDX-License-Identifier: Apache-2.0
"""A Journey from pieces of road with lengths and durations, as navigation gives them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.route.sources.timeline import check_coordinates, distances_m, interpolated, journey_of, Timeline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.numerics.arrays import FloatArray
    from bev_preheat.route.sources.journey import Journey, RouteOptions

# Lengths of a line and of its pieces may differ by this share, because they are rounded.
MOST_MISFIT = 0.2


@dataclass(frozen=True)
class Pieces:
    """
    A leg between two waypoints: lengths [m] and durations [s] of its N pieces, shapes (N,).

    `stop_s` is the time of charging at its end [s]; 0: none, or not known.
    """

    length_m: FloatArray
    duration_s: FloatArray
    stop_s: float = field(default=0.0, kw_only=True)

    def scaled_to(self, total_s: float) -> Pieces:
        """Return the leg with the durations scaled to a total [s]."""
        sum_s = float(self.duration_s.sum())
        return self if sum_s <= 0.0 else replace(self, duration_s=self.duration_s * (total_s / sum_s))


def journey_of_pieces(kind: str, legs: Sequence[Pieces], options: RouteOptions, remarks: Sequence[str] = (),
                      line: tuple[FloatArray, FloatArray] | None = None,
                      elevation: tuple[FloatArray, FloatArray] | None = None) -> Journey:
    """
    Return the Journey of legs in driving order.

    `line`: latitudes and longitudes [deg] of the whole way; `elevation`: distances [m] and elevations [m] of
    points along it. Waypoints between legs are charging stops if the leg or the options give a duration.
    """
    remarks = list(remarks)
    legs = [leg for leg in legs if leg.length_m.sum() > 0.0 or leg.duration_s.sum() > 0.0]
    if not legs:
        raise InvalidInput(f'the {kind} has no length')
    distance_m = np.concatenate(([0.0], np.cumsum(np.concatenate([leg.length_m for leg in legs]))))
    elapsed_s = np.concatenate(([0.0], np.cumsum(np.concatenate([leg.duration_s for leg in legs]))))
    ends = np.cumsum([len(leg.length_m) for leg in legs])[:-1]
    stops = tuple((float(elapsed_s[end]), duration_s) for end, duration_s in zip(
        ends, (leg.stop_s or options.stop_duration_s or 0.0 for leg in legs)) if duration_s > 0.0)
    passed = len(ends) - len(stops)
    if passed:
        remarks.append(f'{passed} waypoint{" is" if passed == 1 else "s are"} passed without a stop; for charging '
                       'stops give their duration [min], such as: --stop-duration 20')
    latitude_deg = longitude_deg = elevation_m = None
    if line is not None:
        latitude_deg, longitude_deg = line
        check_coordinates(latitude_deg, longitude_deg)
        along_m = np.concatenate(([0.0], np.cumsum(distances_m(latitude_deg, longitude_deg))))
        if abs(along_m[-1] - distance_m[-1]) > MOST_MISFIT * distance_m[-1] + 50.0:
            remarks.append(f'the line on the map, {along_m[-1] / 1e3:.1f} km, does not fit the length of the way, '
                           f'{distance_m[-1] / 1e3:.1f} km; it is left out')
            line = latitude_deg = longitude_deg = None
    if line is not None and latitude_deg is not None and longitude_deg is not None:
        along_m = along_m * (distance_m[-1] / max(along_m[-1], 1e-9))
        # All points of both: the pieces keep their durations, the line its shape.
        every_m = np.union1d(along_m, distance_m)
        every_s = np.interp(every_m, distance_m, elapsed_s)
        latitude_deg, longitude_deg = (interpolated(every_m, along_m, values)
                                       for values in (latitude_deg, longitude_deg))
        distance_m, elapsed_s = every_m, every_s
    if elevation is not None:
        at_m, values_m = elevation
        elevation_m = np.interp(distance_m, at_m, values_m)
    return journey_of(
        kind, Timeline(distance_m, elapsed_s, latitude_deg, longitude_deg, elevation_m, stops), remarks)
