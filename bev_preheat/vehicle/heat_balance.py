# SPDX-License-Identifier: Apache-2.0
"""
The terms of the battery's heat balance and of its terminal power, for every kind of number.

The core's C is generated from these lines (`bev_preheat.code_generation.c_source`), as from those of `model`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arithmetic import AnyNumber
    from bev_preheat.vehicle.description import Vehicle


def heat_with_heater_w(vehicle: Vehicle, heat_w: AnyNumber, heater_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] with that of an HVCH power [W]; shape of the inputs together."""
    return heat_w + vehicle.hvch.efficiency * heater_w


def heat_with_brake_w(vehicle: Vehicle, heat_w: AnyNumber, brake_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] without that of regeneration which the friction brake takes [W]."""
    return heat_w - vehicle.drivetrain.heat_share * brake_w


def heat_under_w(vehicle: Vehicle, heat_w: AnyNumber, heater_w: AnyNumber, brake_w: AnyNumber) -> AnyNumber:
    """Return the heat into the battery [W] under an HVCH and a friction brake power [W]."""
    return heat_with_brake_w(vehicle, heat_with_heater_w(vehicle, heat_w, heater_w), brake_w)


def leaked_w(leakage_w_per_k: AnyNumber, ambient_c: AnyNumber, temperature_c: AnyNumber) -> AnyNumber:
    """Return the heat from the ambient air [W], gamma (T_amb - T_b) of eq. (3); negative: heat is lost."""
    return leakage_w_per_k * (ambient_c - temperature_c)


def deliverable_w(voltage_v: AnyNumber, resistance_ohm: AnyNumber) -> AnyNumber:
    """Return the most terminal power [W] that the circuit can give, U_oc^2/(4 R)."""
    return voltage_v * voltage_v / (4.0 * resistance_ohm)


def idle_power_w(propulsion_w: AnyNumber, cabin_w: AnyNumber, auxiliary_w: AnyNumber) -> AnyNumber:
    """Return the terminal power without battery heating [W]."""
    return propulsion_w + cabin_w + auxiliary_w


def idle_heat_w(leakage_w_per_k: AnyNumber, ambient_c: AnyNumber, drivetrain_heat_w: AnyNumber) -> AnyNumber:
    """Return gamma T_amb + Q_ed [W]: what without battery heating does not depend on the battery's state."""
    return leakage_w_per_k * ambient_c + drivetrain_heat_w
