# SPDX-License-Identifier: Apache-2.0
"""Inputs of the supervisor, checked and stamped."""

from dataclasses import dataclass
from typing import Optional

from bev_preheat.planning.situation import BatteryState
from bev_preheat.route.segments import Route


@dataclass(frozen=True)
class Measurement:
    """The battery's state at an instant [ns of the node's clock]."""

    state: BatteryState
    stamp_ns: int


@dataclass(frozen=True)
class Mission:
    """
    A route and what is wanted at its end; segment 0 starts at `start_ns` [ns].

    `target_temperature_c` [deg C] is None where the route names none.
    """

    route_id: str
    route: Route
    start_ns: int
    charging_planned: bool
    target_temperature_c: Optional[float]
    minimum_arrival_soc: float
