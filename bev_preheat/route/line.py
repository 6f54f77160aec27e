# SPDX-License-Identifier: Apache-2.0
"""The route's line on the map, with the planned instant of each of its points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

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
