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
from bev_preheat.numerics.factors import W_PER_KW
from bev_preheat.vehicle.corrections import ScaledCurve
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Charging
from bev_preheat.vehicle.hot_derating import FALL_K, falls_from_c, with_assumed_fall

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Battery, Vehicle


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
    charging = vehicle.charging or _unstated(vehicle.battery)
    return replace(charging, battery_heating=bool(charging.battery_heating))


def _unstated(battery: Battery) -> Charging:
    """Return the Charging of a car without such a block: its charge limit, with the assumed fall if it is hot."""
    limit = battery.charge_power_limit
    if not isinstance(limit, Table):
        return Charging(limit)
    table, assumed_fall_c = with_assumed_fall(limit, battery.temperature_range_c[1])
    return Charging(table, assumed_fall_c=assumed_fall_c)


def vehicle_at_charger(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with the resistance of its pack after minutes of steady current."""
    charging = vehicle.charging
    if charging is None or charging.polarization_factor == 1.0:
        return vehicle
    return replace(vehicle, battery=replace(vehicle.battery, resistance=ScaledCurve(
        vehicle.battery.resistance, charging.polarization_factor)))


def charging_problems(charging: Charging, temperature_range_c: tuple[float, float]) -> Iterator[str]:
    """Yield a sentence for each implausible value of a Charging from a file."""
    limit_c, (lowest_c, highest_c) = charging.heating_limit_c, temperature_range_c
    if limit_c is None and charging.battery_heating:
        yield ('charging: battery_heating needs heating_limit_c, the battery temperature up '
               'to which the car heats')
    if limit_c is not None and not lowest_c <= limit_c <= highest_c:
        yield (f'charging.heating_limit_c: {limit_c:g} is outside battery.temperature_range_c '
               f'{lowest_c:g} ... {highest_c:g}')
    cooling = charging.cooling
    if cooling is None:
        return
    if not lowest_c <= cooling.set_point_c <= highest_c:
        yield (f'charging.cooling.set_point_c: {cooling.set_point_c:g} is outside battery.temperature_range_c '
               f'{lowest_c:g} ... {highest_c:g}')
    if cooling.set_point_c < charging.heated_below_c:
        yield (f'charging.cooling.set_point_c: {cooling.set_point_c:g} is below heating_limit_c, '
               f'{charging.heated_below_c:g}; the car would heat and cool its battery at once')


def charging_in_words(vehicle: Vehicle) -> str:
    """Return a sentence on the car's behaviour at a charger, or that its file does not state it."""
    charging = vehicle.charging
    if charging is None or charging.battery_heating is None:
        return ('The file does not say whether the car heats its battery while it charges '
                '(charging.battery_heating); only charging sessions need it.')
    if charging.battery_heating:
        left_w = max(0.0, vehicle.hvch.maximum_power_w - vehicle.defaults.cabin_heating_power_w)
        heating = (f'can heat its battery up to {charging.heating_limit_c:g} degC with the heater power left by '
                   f'the cabin, {left_w / W_PER_KW:.1f} kW')
    else:
        heating = 'does not heat its battery'
    inlet = ('its inlet is not limited' if charging.maximum_inlet_power_w == inf else
             f'its inlet takes at most {charging.maximum_inlet_power_w / W_PER_KW:.0f} kW')
    limit = 'a map of its own' if charging.has_own_limit else "the battery's charge limit"
    return (f'While it charges the car {heating}; {inlet}; the charging power is limited by {limit}. '
            f'{_hot_in_words(charging)}')


def _hot_in_words(charging: Charging) -> str:
    """Return sentences on derating, resistance and cooling in a session."""
    sentences = []
    if charging.assumed_fall_c is not None:
        sentences.append(
            f'The power of a hot battery is not stated: it is assumed to fall to 0 over the last {FALL_K:g} K up '
            f'to {charging.assumed_fall_c + FALL_K:g} degC (charging.hot_derating states it).')
    elif isinstance(charging.power_limit, Table) and falls_from_c(charging.power_limit) < inf:
        sentences.append(f'The power of a hot battery falls from {falls_from_c(charging.power_limit):g} degC on.')
    if charging.polarization_factor != 1.0:
        sentences.append(f'In a session its resistance is {charging.polarization_factor:g} times that of '
                         'battery.resistance.')
    cooling = charging.cooling
    if cooling is None:
        sentences.append('Its battery is not cooled there.')
    else:
        radiator = ('' if cooling.radiator_conductance_w_per_k == inf else
                    f', at most {cooling.radiator_conductance_w_per_k:g} W for each kelvin above the air')
        sentences.append(
            f'Above {cooling.set_point_c:g} degC it cools its battery with up to '
            f'{cooling.cooling_power_w / W_PER_KW:.1f} kW{radiator}, for '
            f'{cooling.electrical_power_w / W_PER_KW:.1f} kW from the charger.')
    return ' '.join(sentences)
