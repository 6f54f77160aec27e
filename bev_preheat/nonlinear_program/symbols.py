# SPDX-License-Identifier: Apache-2.0
"""The model's equations as CasADi expressions."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import casadi

from bev_preheat.numerics import AnyNumber, Arithmetic
from bev_preheat.vehicle.heated_step import make_heated_step
from bev_preheat.vehicle.model import make_rates, make_runge_kutta_4
from bev_preheat.vehicle.variants import corrected_vehicle, Corrections

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bev_preheat.numerics import Curve
    from bev_preheat.vehicle import Vehicle

# Below this discriminant [V^2] the power cannot be delivered; the floor keeps derivatives finite.
LEAST_DISCRIMINANT_V2 = 1e-6

SYMBOLS: Arithmetic[AnyNumber] = Arithmetic(
    root=lambda value: casadi.sqrt(casadi.fmax(value, LEAST_DISCRIMINANT_V2)),
    log=casadi.log, exp=casadi.exp, maximum=casadi.fmax, minimum=casadi.fmin)

# Corrections of the vehicle that are inputs, so that they may differ from call to call; leakage and heat are
# inputs anyway.
FACTORS = ('heat_capacity', 'resistance')


def symbolic_step(vehicle: Vehicle) -> casadi.Function:
    """
    Return the Runge-Kutta step of `model` as a CasADi Function.

    Inputs: soc, temperature [deg C], duration [s], terminal power [W], variance [W^2], heat [W],
    leakage [W/K], then FACTORS. Outputs: soc, temperature at the end, mean temperature, mean Joule
    heat [W].
    """
    names = ('soc', 'temperature_c', 'duration_s', 'power_w', 'variance_w2', 'heat_w',
             'leakage_w_per_k')
    inputs, factors = _symbols(names), _symbols(FACTORS)
    step = make_runge_kutta_4(make_rates(_corrected(vehicle, factors), SYMBOLS))
    return _function('step', inputs + factors, step(*inputs), (*names, *FACTORS), (
        'soc_end', 'temperature_end_c', 'mean_temperature_c', 'mean_joule_w'))


def symbolic_heated_step(vehicle: Vehicle) -> casadi.Function:
    """
    Return the step of `heat_path`, for a vehicle that has one, as a CasADi Function.

    Inputs: soc, temperature [deg C], heater power [W], coolant excess [K], duration [s], terminal
    power [W] and heat [W] without the heater's, with the variance [W^2] between them, leakage [W/K],
    command [W], then FACTORS and the heater's efficiency. Outputs: the four states at the end, mean
    temperature, mean Joule heat [W], means of heater power and of heat into the battery [W].
    """
    names = ('soc', 'temperature_c', 'heater_w', 'excess_k', 'duration_s', 'power_w', 'variance_w2',
             'heat_w', 'leakage_w_per_k', 'command_w')
    inputs, factors = _symbols(names), _symbols(FACTORS)
    efficiency: AnyNumber = casadi.SX.sym('efficiency')
    corrected = _corrected(vehicle, factors)
    step = make_heated_step(
        replace(corrected, hvch=replace(corrected.hvch, efficiency=efficiency)), SYMBOLS)
    return _function(
        'heated_step', [*inputs, *factors, efficiency], step(*inputs),
        (*names, *FACTORS, 'efficiency'),
        ('soc_end', 'temperature_end_c', 'heater_end_w', 'excess_end_k', 'mean_temperature_c',
         'mean_joule_w', 'drawn_w', 'arriving_w'))


def symbolic_rates(vehicle: Vehicle) -> casadi.Function:
    """
    Return the right-hand side of `model` as a CasADi Function.

    Inputs: soc, temperature [deg C], terminal power [W], variance [W^2], heat [W], leakage [W/K],
    then FACTORS. Outputs: soc/s, K/s, Joule heat [W].
    """
    names = ('soc', 'temperature_c', 'power_w', 'variance_w2', 'heat_w', 'leakage_w_per_k')
    inputs, factors = _symbols(names), _symbols(FACTORS)
    rates = make_rates(_corrected(vehicle, factors), SYMBOLS)
    return _function('rates', inputs + factors, rates(*inputs), (*names, *FACTORS),
                     ('soc_rate', 'temperature_rate', 'joule_w'))


def symbolic_curve(curve: Curve) -> casadi.Function:
    """Return a curve of the vehicle as a CasADi Function of soc and temperature [deg C]."""
    soc, temperature_c = casadi.SX.sym('soc'), casadi.SX.sym('temperature_c')
    return casadi.Function('curve', [soc, temperature_c],
                           [curve.function(SYMBOLS)(soc, temperature_c)])


def _function(name: str, inputs: Sequence[casadi.SX], outputs: Iterable[casadi.SX],
              input_names: Iterable[str], output_names: Iterable[str]) -> casadi.Function:
    return casadi.Function(name, inputs, list(outputs), list(input_names), list(output_names))


def _symbols(names: Iterable[str]) -> list[casadi.SX]:
    return [casadi.SX.sym(name) for name in names]


def _corrected(vehicle: Vehicle, factors: Iterable[casadi.SX]) -> Vehicle:
    return corrected_vehicle(vehicle, Corrections(**dict(zip(FACTORS, factors))))
