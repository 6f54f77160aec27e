# SPDX-License-Identifier: Apache-2.0
"""
Maps of a vehicle without corners, for programs that run along them.

A table is linear between its points. Along a charging session a program meets dozens of its corners, and
where each lies within a step decides a derivative: IPOPT comes to rest at none. Here each corner is
rounded: the kink |x - x_i| becomes sqrt((x - x_i)^2 + w^2). Weights of the points still add up to 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi

from bev_preheat.optimum.symbols import SYMBOLS
from bev_preheat.vehicle.curves import Table

if TYPE_CHECKING:
    from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, Curve, CurveFunction
    from bev_preheat.vehicle import Vehicle

# Half the width of a rounded corner: state of charge, temperature [K], power [W].
SOC_WIDTH, TEMPERATURE_WIDTH_K, POWER_WIDTH_W = 0.005, 0.5, 200.0


@dataclass(frozen=True)
class SmoothTable:
    """A Table with rounded corners, for symbols."""

    table: Table

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)`, of CasADi symbols."""
        table = self.table

        def lookup(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            soc_weights = smooth_weights(table.soc, soc, SOC_WIDTH)
            temperature_weights = smooth_weights(
                table.temperature_c, temperature_c, TEMPERATURE_WIDTH_K)
            return sum(soc_weight * sum(value * weight for value, weight in zip(
                row, temperature_weights)) for row, soc_weight in zip(table.values, soc_weights))

        return lookup


def smooth_weights(axis: Sequence[float], x: AnyNumber, width: float) -> list[AnyNumber]:
    """Return the weight of each axis point at x; they add up to 1. Level beyond the ends, nearly."""
    if len(axis) == 1:
        return [1.0]
    # Kinks at the points, the slope between two of them shared out.
    rising = [0.5 * (casadi.sqrt((x - low)**2 + width**2) - casadi.sqrt((x - high)**2 + width**2)
                     + (high - low)) / (high - low) for low, high in zip(axis, axis[1:])]
    return [before - after for before, after in zip([1.0, *rising], [*rising, 0.0])]


def smooth_minimum(one: AnyNumber, other: AnyNumber) -> AnyNumber:
    """Return the lesser of two powers [W], at most POWER_WIDTH_W / 2 below it."""
    return 0.5 * (one + other - casadi.sqrt((one - other)**2 + POWER_WIDTH_W**2))


# For powers [W] only.
SMOOTH: Arithmetic[AnyNumber] = replace(
    SYMBOLS, minimum=smooth_minimum, maximum=lambda one, other: -smooth_minimum(-one, -other))


def smoothed(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with rounded corners in the maps of its charging sessions."""
    battery, charging = vehicle.battery, vehicle.charging
    return replace(
        vehicle,
        battery=replace(battery, open_circuit_voltage=_smooth(battery.open_circuit_voltage),
                        resistance=_smooth(battery.resistance)),
        charging=None if charging is None else replace(
            charging, power_limit=_smooth(charging.power_limit)))


def _smooth(curve: Curve) -> Curve:
    return SmoothTable(curve) if isinstance(curve, Table) else curve
