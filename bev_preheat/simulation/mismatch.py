# SPDX-License-Identifier: Apache-2.0
"""A car and a drive that differ from their vehicle and route files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bev_preheat.route.variation import vary, with_cycles
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    import numpy as np

    from bev_preheat.route.segments import Route
    from bev_preheat.vehicle.description import Vehicle
    from bev_preheat.vehicle.heat_path import HeatPath


@dataclass(frozen=True)
class Mismatch:
    """
    The true car and drive, as multiples of the values in vehicle and route file.

    `heater` is a factor on the efficiency of the HVCH, `propulsion_power_variability` the standard
    deviation of the logarithm of a factor that varies about 1 from segment to segment. With
    `visible_variation` the power variation within a segment takes place over seconds,
    so that the sensors see it; without, it is a ripple too fast for them.
    """

    heat_capacity: float = 1.0
    leakage: float = 1.0
    resistance: float = 1.0
    heater: float = 1.0
    propulsion_power: float = 1.0
    propulsion_power_variability: float = 0.0
    visible_variation: bool = False


def true_vehicle(vehicle: Vehicle, mismatch: Mismatch, heat_path: HeatPath | None) -> Vehicle:
    """Return the true Vehicle, with a HeatPath; None: its own."""
    factors = (mismatch.heat_capacity, mismatch.leakage, mismatch.resistance, mismatch.heater)
    if factors != (1.0,) * 4:
        vehicle = corrected_vehicle(vehicle, Corrections(*factors))
    if heat_path is None or heat_path == vehicle.heat_path:
        return vehicle
    return replace(vehicle, heat_path=heat_path)


def true_route(route: Route, mismatch: Mismatch, random: np.random.Generator) -> Route:
    """Return the Route as driven: other propulsion power, same speed and times."""
    factor = vary(random, len(route), mismatch.propulsion_power,
                  mismatch.propulsion_power_variability)
    route = route.with_propulsion(factor)
    return with_cycles(route) if mismatch.visible_variation else route
