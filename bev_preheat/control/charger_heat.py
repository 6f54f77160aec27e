# SPDX-License-Identifier: Apache-2.0
"""
Heating while the vehicle charges, if the integrator asks for it and the vehicle supports it.

The charger then feeds the heater, as long as it also charges the battery. This shows in the battery's own
power, so heating at the charger needs voltage and current.
"""

from __future__ import annotations

from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg, Measurement
    from bev_preheat.vehicle.description import Vehicle

# Heating begins this far below the temperature up to which the vehicle heats [K].
BEGINS_BELOW_K = 1.0


class ChargerHeat(NamedTuple):
    """Power to command while the vehicle charges [W], and the reason as a sentence."""

    power_w: float
    reason: str


def charger_heat(vehicle: Vehicle, leg: Leg, measurement: Measurement, temperature_c: float,
                 is_heating: bool) -> ChargerHeat:
    """
    Return the ChargerHeat after a Leg, of a battery at an estimated `temperature_c` [deg C].

    `is_heating`: the heater is on. It gets all the heater power that the cabin leaves, up to the temperature to
    which the vehicle heats while charging. It is switched on if the battery is charged with more power than the
    heater will take, and off once the battery is no longer charged.
    """
    charging, power_w = vehicle.charging, measurement.power_w
    if not leg.charging_planned:
        return ChargerHeat(0.0, 'No heating: no charging is planned here.')
    if charging is None or not charging.battery_heating:
        return ChargerHeat(0.0, 'No heating: the vehicle file does not say that the vehicle heats its battery '
                           'while it charges.')
    limit_c = charging.heated_below_c
    if temperature_c >= limit_c - (0.0 if is_heating else BEGINS_BELOW_K):
        return ChargerHeat(0.0, f'No heating: at {temperature_c:.1f} degC the battery is warm enough.')
    if power_w is None:
        return ChargerHeat(0.0, 'No heating: battery_state does not say whether the battery is being charged.')
    heat_w = max(0.0, vehicle.hvch.maximum_power_w - float(leg.route.cabin_heating_power_w[-1]))
    if heat_w == 0.0:
        return ChargerHeat(0.0, 'No heating: the cabin takes the whole heater power.')
    if -power_w <= (0.0 if is_heating else heat_w):
        return ChargerHeat(0.0, f'No heating: the battery is charged with {max(0.0, -power_w):.0f} W, and the '
                           f'heater takes {heat_w:.0f} W.')
    return ChargerHeat(heat_w, f'Heating with {heat_w:.0f} W up to {limit_c:.1f} degC.')
