# SPDX-License-Identifier: Apache-2.0
"""
The car at a fast charger: its charging power, also of a hot battery, and whether it heats its battery there.

The benefit of preheating depends on that heating, and cars differ. It is therefore never assumed: a file
without it serves for plans, but not for charging sessions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.numerics import FloatArray, W_PER_KW
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Charging, Vehicle
from bev_preheat.vehicle.variants import ScaledCurve

# The assumed fall [K]: wide enough for steps of a session, and above all batteries that are merely warm.
FALL_K = 5.0


def derated(table: Table, temperature_c: Sequence[float], share: Sequence[float]) -> Table:
    """
    Return a charging map times a share over the battery temperature, as a Table.

    `temperature_c` [deg C] and `share` (K,) are the points of the share, constant beyond them. The result has the
    temperatures of both, and is linear in between.
    """
    temperatures_c = np.array(sorted({*temperature_c, *_axis(table)}))
    shares: FloatArray = np.interp(temperatures_c, temperature_c, share)
    rows = [np.interp(temperatures_c, _axis(table), row) if len(row) > 1 else np.full(len(shares), row[0])
            for row in table.values]
    # + 0.0 avoids -0.
    return Table(table.soc, tuple(temperatures_c.tolist()), tuple(
        tuple((row * shares + 0.0).tolist()) for row in rows))


def with_assumed_fall(table: Table, highest_c: float) -> tuple[Table, float | None]:
    """Return a map that falls to 0 at the highest temperature [deg C], and where by assumption, else None."""
    if len(table.temperature_c) > 1 and not any(row[-1] for row in table.values):
        return table, None
    begins_c = highest_c - FALL_K
    return derated(table, (begins_c, highest_c), (1.0, 0.0)), begins_c


def derating_problems(key: str, temperature_c: Sequence[float], share: Sequence[float],
                      highest_c: float) -> Iterator[str]:
    """Yield a sentence for each implausible point of a stated derating; `highest_c` is the vehicle's highest."""
    if len(temperature_c) != len(share):
        yield f'{key}: has {len(temperature_c)} temperatures and {len(share)} shares; it must have as many of each'
        return
    if any(not low < high for low, high in pairwise(temperature_c)):
        yield f'{key}.temperature_c: {list(temperature_c)} must rise from point to point'
    if share[0] != 1.0 or share[-1] != 0.0 or any(not before >= after for before, after in pairwise(share)):
        yield f'{key}.share: {list(share)} must fall from 1 at its first temperature to 0 at its last'
    elif temperature_c[0] >= highest_c:
        yield (f'{key}.temperature_c: begins at {temperature_c[0]:g} degC, which must be below the highest '
               f'battery temperature, {highest_c:g} degC')


def falls_from_c(table: Table) -> float:
    """Return the temperature [deg C] from which heat lowers the power of a charging map; inf without a fall."""
    power_w = -np.array(table.values)
    most_w = np.maximum.accumulate(power_w, axis=1)
    full = np.flatnonzero((power_w >= most_w * (1.0 - 1e-9)).all(axis=0))
    last = int(full[-1])
    return table.temperature_c[last] if last + 1 < len(table.temperature_c) else float('inf')


def _axis(table: Table) -> tuple[float, ...]:
    """Return the temperatures of a table [deg C]; none if it does not depend on the temperature."""
    return table.temperature_c if len(table.temperature_c) > 1 else ()


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
    """Return a Vehicle's Charging for sessions; a car whose file does not say that it heats there does not."""
    charging, battery = vehicle.charging, vehicle.battery
    if charging is None:
        limit, assumed_fall_c = battery.charge_power_limit, None
        if isinstance(limit, Table):
            limit, assumed_fall_c = with_assumed_fall(limit, battery.temperature_range_c[1])
        charging = Charging(limit, assumed_fall_c=assumed_fall_c)
    return replace(charging, battery_heating=bool(charging.battery_heating))


def vehicle_at_charger(vehicle: Vehicle) -> Vehicle:
    """Return the Vehicle with the resistance of its pack after minutes of steady current."""
    charging = vehicle.charging
    if charging is None or charging.polarization_factor == 1.0:
        return vehicle
    return replace(vehicle, battery=replace(vehicle.battery, resistance=ScaledCurve(
        vehicle.battery.resistance, charging.polarization_factor)))


def charging_problems(charging: Charging, temperature_range_c: tuple[float, float]) -> Iterator[str]:
    """Yield a sentence for each implausible value of a Charging from a file."""
    limit_c, cooling, (lowest_c, highest_c) = charging.heating_limit_c, charging.cooling, temperature_range_c
    if limit_c is None and charging.battery_heating:
        yield ('charging: battery_heating needs heating_limit_c, the battery temperature up '
               'to which the car heats')
    for key, value_c in (('heating_limit_c', limit_c),
                         ('cooling.set_point_c', None if cooling is None else cooling.set_point_c)):
        if value_c is not None and not lowest_c <= value_c <= highest_c:
            yield (f'charging.{key}: {value_c:g} is outside battery.temperature_range_c {lowest_c:g} ... '
                   f'{highest_c:g}')
    if cooling is not None and cooling.set_point_c < charging.heated_below_c:
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
