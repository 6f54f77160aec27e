# SPDX-License-Identifier: Apache-2.0
"""
The car at a fast charger: its charging power, and whether it heats its battery while charging.

The benefit of preheating depends on that heating, and cars differ. It is therefore never assumed: a file
without it serves for plans, but not for charging sessions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle.description import Charging

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

W_PER_KW = 1000.0


def charging_of(vehicle: Vehicle) -> Charging:
    """Return the Charging of a Vehicle; raise InvalidInput if its file is incomplete."""
    charging = vehicle.charging
    if charging is None or charging.battery_heating is None:
        raise InvalidInput(
            f'vehicle {vehicle.name}: charging.battery_heating is missing; say in the vehicle file '
            'whether the car heats its battery while it charges (true or false), because the '
            'benefit of preheating depends on it')
    return charging


def session_charging(vehicle: Vehicle) -> Charging:
    """
    Return the Charging of a Vehicle for sessions that show its charging power.

    A car whose file does not say whether it heats its battery while charging does not heat it here.
    """
    charging = vehicle.charging or Charging(vehicle.battery.charge_power_limit)
    return replace(charging, battery_heating=bool(charging.battery_heating))


def charging_problems(charging: Charging, temperature_range_c: tuple[float, float]) -> Iterator[str]:
    """Yield a sentence for each implausible value of a Charging from a file."""
    limit_c, (lowest_c, highest_c) = charging.heating_limit_c, temperature_range_c
    if limit_c is None and charging.battery_heating:
        yield ('charging: battery_heating needs heating_limit_c, the battery temperature up '
               'to which the car heats')
    if limit_c is not None and not lowest_c <= limit_c <= highest_c:
        yield (f'charging.heating_limit_c: {limit_c:g} is outside battery.temperature_range_c '
               f'{lowest_c:g} ... {highest_c:g}')


def charging_in_words(vehicle: Vehicle) -> str:
    """Return a sentence on the car's behaviour at a charger, or that its file does not state it."""
    charging = vehicle.charging
    if charging is None or charging.battery_heating is None:
        return ('The file does not say whether the car heats its battery while it charges '
                '(charging.battery_heating); only charging sessions need it.')
    if charging.battery_heating:
        left_w = max(0.0, vehicle.hvch.maximum_power_w - vehicle.defaults.cabin_heating_power_w)
        heating = (f'heats its battery up to {charging.heating_limit_c:g} degC with the heater power left by '
                   f'the cabin, {left_w / W_PER_KW:.1f} kW')
    else:
        heating = 'does not heat its battery'
    inlet = ('its inlet is not limited' if charging.maximum_inlet_power_w == inf else
             f'its inlet takes at most {charging.maximum_inlet_power_w / W_PER_KW:.0f} kW')
    limit = 'a map of its own' if charging.has_own_limit else "the battery's charge limit"
    return (f'While it charges the car {heating}; {inlet}; the charging power is limited by {limit}.')
