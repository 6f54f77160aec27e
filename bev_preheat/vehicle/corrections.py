# SPDX-License-Identifier: Apache-2.0
"""
A car that differs from its vehicle file by factors.

The factors may be plain numbers (a car to plan with, a car to simulate) or arrays (many hypotheses
at once, see `estimation`); the corrected vehicle serves the same arithmetic.
"""

from dataclasses import dataclass, replace

from bev_preheat.numerics.arithmetic import AnyNumber, Arithmetic, Curve, CurveFunction, Number
from bev_preheat.vehicle.description import Leakage, Vehicle


@dataclass(frozen=True)
class Corrections:
    """
    Factors on the vehicle file's heat capacity, leakage, resistance and HVCH efficiency.

    1 is the file's value. Floats, or arrays of one shape.
    """

    heat_capacity: AnyNumber = 1.0
    leakage: AnyNumber = 1.0
    resistance: AnyNumber = 1.0
    heater_efficiency: AnyNumber = 1.0


@dataclass(frozen=True)
class ScaledCurve:
    """A curve of `vehicle.curves` times a factor."""

    curve: Curve
    factor: AnyNumber

    def function(self, arithmetic: Arithmetic[Number]) -> CurveFunction[Number]:
        """`f(soc, temperature_c)`, for the given kind of number."""
        value, factor = self.curve.function(arithmetic), self.factor
        return lambda soc, temperature_c: factor * value(soc, temperature_c)


def corrected_vehicle(vehicle: Vehicle, corrections: Corrections) -> Vehicle:
    """Return `vehicle` with the Corrections applied."""
    battery, leakage = vehicle.battery, vehicle.battery.leakage
    return replace(
        vehicle,
        battery=replace(
            battery,
            heat_capacity_j_per_k=battery.heat_capacity_j_per_k * corrections.heat_capacity,
            resistance=ScaledCurve(battery.resistance, corrections.resistance),
            leakage=Leakage(leakage.gamma_0_w_per_k * corrections.leakage,
                            leakage.gamma_v_w_per_k_per_mps * corrections.leakage)),
        hvch=replace(vehicle.hvch,
                     efficiency=vehicle.hvch.efficiency * corrections.heater_efficiency))
