# SPDX-License-Identifier: Apache-2.0
"""
The model's equations as CasADi expressions, and maps of a vehicle without corners.

A table is linear between its points. A drive meets few of its corners, and its programs keep them. But during a
power deficit of minutes, the smallest deficit may lie at a corner, and IPOPT finds it only with slightly rounded
corners: the kink |x - x_i| becomes sqrt((x - x_i)^2 + w^2). Weights of the points still add up to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi

from bev_preheat.numerics import AnyNumber, Arithmetic, Curve, CurveFunction
from bev_preheat.vehicle import Vehicle
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.heat_path import make_heated_step
from bev_preheat.vehicle.model import make_rates
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections, hvch_alone

# Below this discriminant [V^2] the power cannot be delivered; the floor keeps derivatives finite.
LEAST_DISCRIMINANT_V2 = 1e-6

SYMBOLS: Arithmetic[AnyNumber] = Arithmetic(
    root=lambda value: casadi.sqrt(casadi.fmax(value, LEAST_DISCRIMINANT_V2)),
    log=casadi.log, exp=casadi.exp, maximum=casadi.fmax, minimum=casadi.fmin)

# Corrections of the vehicle that are inputs, so that a car whose factors are being learned needs no new program;
# leakage and heat are inputs anyway.
FACTORS = ('heat_capacity', 'resistance', 'heater_efficiency', 'source_heat')


def symbolic_step(vehicle: Vehicle) -> casadi.Function:
    """
    Return the step of `vehicle.heat_path` as a CasADi Function.

    Inputs: soc, temperature [deg C], heater power [W], coolant excess [K], duration [s], terminal
    power [W] and heat [W] without the heater's, with the variance [W^2] between them, leakage [W/K],
    command [W], then FACTORS. Outputs: the four states at the end, mean temperature, mean Joule heat [W],
    means of heater power and of heat into the battery [W].
    """
    return _of_equations('step', vehicle, lambda car: make_heated_step(car, SYMBOLS), (
        'soc', 'temperature_c', 'heater_w', 'excess_k', 'duration_s', 'power_w', 'variance_w2', 'heat_w',
        'leakage_w_per_k', 'command_w'))


def symbolic_rates(vehicle: Vehicle) -> casadi.Function:
    """
    Return the right-hand side of `model` as a CasADi Function.

    Inputs: soc, temperature [deg C], terminal power [W], variance [W^2], heat [W], leakage [W/K],
    then FACTORS. Outputs: soc/s, K/s, Joule heat [W].
    """
    return _of_equations('rates', vehicle, lambda car: make_rates(car, SYMBOLS), (
        'soc', 'temperature_c', 'power_w', 'variance_w2', 'heat_w', 'leakage_w_per_k'))


def symbolic_curve(curve: Curve) -> casadi.Function:
    """Return a curve of the vehicle as a CasADi Function of soc and temperature [deg C]."""
    soc, temperature_c = casadi.SX.sym('soc'), casadi.SX.sym('temperature_c')
    return casadi.Function('curve', [soc, temperature_c],
                           [curve.function(SYMBOLS)(soc, temperature_c)])


def _of_equations(name: str, vehicle: Vehicle, equations: Callable[[Vehicle], Callable[..., Sequence[AnyNumber]]],
                  inputs: Sequence[str]) -> casadi.Function:
    """Return equations of a vehicle that is corrected by FACTORS as a CasADi Function."""
    arguments, factors = ([casadi.SX.sym(each) for each in names] for names in (inputs, FACTORS))
    corrected = corrected_vehicle(hvch_alone(vehicle), Corrections(**dict(zip(FACTORS, factors))))
    return casadi.Function(name, [*arguments, *factors], list(equations(corrected)(*arguments)))


# Half the width of a rounded corner: state of charge, temperature [K]; a limit that bends by 4 kW/K changes by at
# most 10 W.
SOC_WIDTH, TEMPERATURE_WIDTH_K = 1e-4, 0.005


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


def smoothed_a_little(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with minimally rounded corners in the maps of its drives."""
    over_weather = TEMPERATURE_WIDTH_K, TEMPERATURE_WIDTH_K
    return replace(
        vehicle, heat_sources=tuple(smooth_tables(source, ('maximum_power_w', 'hvch_watts'), *over_weather)
                                    for source in vehicle.heat_sources),
        battery=smooth_tables(vehicle.battery, (
            'open_circuit_voltage', 'resistance', 'discharge_power_limit', 'charge_power_limit'),
            SOC_WIDTH, TEMPERATURE_WIDTH_K))


def smooth_tables(part: Any, names: Sequence[str], first_width: float, second_width: float) -> Any:
    """Return a part of a vehicle whose tables of these names have corners rounded by half a width each."""
    return replace(part, **{name: SmoothTable(table, first_width, second_width) for name in names
                            if isinstance(table := getattr(part, name), Table)})
