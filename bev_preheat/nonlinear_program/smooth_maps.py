# SPDX-License-Identifier: Apache-2.0
"""
Maps of a vehicle without corners, for nonlinear programs.

A table is linear between its points. Along a charging session a program meets dozens of its corners, and the
position of each within a step decides a derivative: IPOPT does not converge. Here each corner is rounded: the kink
|x - x_i| becomes sqrt((x - x_i)^2 + w^2). Weights of the points still add up to 1. A drive meets few corners, and
its programs keep them. But during a power deficit of minutes, the smallest deficit may lie at a corner, and IPOPT
finds it only with slightly rounded corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import casadi

from bev_preheat.nonlinear_program.symbols import SYMBOLS
from bev_preheat.vehicle.curves import Table

if TYPE_CHECKING:
    from bev_preheat.numerics import AnyNumber, Arithmetic, Curve, CurveFunction
    from bev_preheat.vehicle import Vehicle

# Half the width of a rounded corner: state of charge, temperature [K], power [W].
SOC_WIDTH, TEMPERATURE_WIDTH_K, POWER_WIDTH_W = 0.005, 0.5, 200.0
# The same on a drive: a limit that bends by 4 kW/K changes by 10 W at most.
DRIVE_SOC_WIDTH, DRIVE_TEMPERATURE_WIDTH_K = 1e-4, 0.005


@dataclass(frozen=True)
class SmoothTable:
    """A Table with corners rounded by half a width each, for symbols."""

    table: Table
    soc_width: float
    temperature_width_k: float

    def function(self, arithmetic: Arithmetic[AnyNumber]) -> CurveFunction[AnyNumber]:
        """`f(soc, temperature_c)`, of CasADi symbols."""
        table = self.table

        def lookup(soc: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
            soc_weights = smooth_weights(table.soc, soc, self.soc_width)
            temperature_weights = smooth_weights(
                table.temperature_c, temperature_c, self.temperature_width_k)
            return sum(soc_weight * sum(value * weight for value, weight in zip(
                row, temperature_weights)) for row, soc_weight in zip(table.values, soc_weights))

        return lookup


def smooth_weights(axis: Sequence[float], x: AnyNumber, width: float) -> list[AnyNumber]:
    """Return the weight of each axis point at x; they add up to 1. Nearly constant beyond the ends."""
    if len(axis) == 1:
        return [1.0]
    # Kinks at the points; the slope between two points is split between them.
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
    widths, battery, charging = (SOC_WIDTH, TEMPERATURE_WIDTH_K), vehicle.battery, vehicle.charging
    return replace(
        vehicle,
        battery=replace(battery, open_circuit_voltage=_smooth(battery.open_circuit_voltage, *widths),
                        resistance=_smooth(battery.resistance, *widths)),
        charging=None if charging is None else replace(
            charging, power_limit=_smooth(charging.power_limit, *widths)))


def smoothed_a_little(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with minimally rounded corners in the maps of its drives."""
    widths, battery = (DRIVE_SOC_WIDTH, DRIVE_TEMPERATURE_WIDTH_K), vehicle.battery
    return replace(vehicle, battery=replace(
        battery, open_circuit_voltage=_smooth(battery.open_circuit_voltage, *widths),
        resistance=_smooth(battery.resistance, *widths),
        discharge_power_limit=_smooth(battery.discharge_power_limit, *widths),
        charge_power_limit=_smooth(battery.charge_power_limit, *widths)))


def _smooth(curve: Curve, soc_width: float, temperature_width_k: float) -> Curve:
    return SmoothTable(curve, soc_width, temperature_width_k) if isinstance(curve, Table) else curve
