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

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.files.checked_yaml import FileData
from bev_preheat.numerics import FloatArray, W_PER_KW
from bev_preheat.vehicle.curves import Table
from bev_preheat.vehicle.description import Ageing, Charging, Cooling, HeatSource, Vehicle
from bev_preheat.vehicle.heat_sources import arguments_of, read_table
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


def _derating_problems(temperature_c: Sequence[float], share: Sequence[float], highest_c: float) -> Iterator[str]:
    """Yield a sentence for each implausible point of a stated derating; `highest_c` is the vehicle's highest."""
    key = 'charging.hot_derating'
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


def read_charging(contents: dict[str, FileData], charge: Table, heat_sources: dict[str, HeatSource],
                  problems: list[str]) -> Charging | None:
    """Return the Charging of a checked file, None without the block; add problems to `problems`."""
    if 'charging' not in contents:
        return None
    node, table = dict(contents['charging']), contents['battery']['power_limits']['charge']
    key, has_own_limit = 'battery.power_limits.charge (there is no charging.power_limit)', 'power_limit' in node
    if has_own_limit:
        key, table = 'charging.power_limit', node.pop('power_limit')
    if 'temperature_c' not in table:
        problems.append(f'{key}: has no temperature_c, so a cold battery would charge like a warm one and '
                        'preheating would gain nothing; add the axis, or let preheat vehicle new --charging-curve '
                        'combine the curve with the cold')
    limit = read_table(key, table, problems) if has_own_limit else charge
    lowest_c, highest_c = map(float, contents['battery']['temperature_range_c'])
    cooling = _cooling(node.pop('cooling', None), heat_sources, contents['hvch']['efficiency'], problems)
    ageing = Ageing(**node.pop('ageing')) if 'ageing' in node else None
    limit, assumed_fall_c = _derated(limit, node.pop('hot_derating', None), highest_c, problems)
    charging = Charging(limit, has_own_limit=has_own_limit, assumed_fall_c=assumed_fall_c, cooling=cooling,
                        ageing=ageing, **arguments_of(node))
    problems += _problems(charging, lowest_c, highest_c)
    return charging


def _derated(limit: Table, node: dict[str, FileData] | None, highest_c: float,
             problems: list[str]) -> tuple[Table, float | None]:
    """Return a charging map with the fall for a hot battery, and where an assumed one begins [deg C]."""
    if node is None:
        return with_assumed_fall(limit, highest_c)
    points = arguments_of(node)
    found = list(_derating_problems(**points, highest_c=highest_c))
    problems += found
    return (limit if found else derated(limit, **points)), None


def _cooling(node: dict[str, FileData] | None, heat_sources: dict[str, HeatSource], efficiency: float,
             problems: list[str]) -> Cooling | None:
    """Return the Cooling of a checked node, None without one; add problems to `problems`."""
    if node is None:
        return None
    if 'heat_source' in node:
        return _cooling_by_source(node, heat_sources, efficiency, problems)
    values = arguments_of(node)
    ratio, power_w = values.pop('coefficient_of_performance', None), values.pop('cooling_power_w', None)
    if 'electrical_power_w' not in values or (ratio is None) == (power_w is None):
        problems.append('charging.cooling: needs electrical_power_w with either cooling_power_w, the heat flow '
                        'out of the battery, or coefficient_of_performance, its ratio to electrical_power_w; or '
                        'heat_source without these')
        return None
    if power_w is None:
        power_w = ratio * values['electrical_power_w']
    return Cooling(cooling_power_w=power_w, **values)


def _cooling_by_source(node: dict[str, FileData], heat_sources: dict[str, HeatSource], efficiency: float,
                       problems: list[str]) -> Cooling | None:
    """Return the Cooling by a heat source, beside an HVCH of an efficiency; add problems to `problems`."""
    values = dict(node)
    name = values.pop('heat_source')
    coolers = [source.name for source in heat_sources.values() if source.cools and source.only_while != 'driving']
    if name not in coolers:
        problems.append(f'charging.cooling.heat_source: {quoted(name)} is not allowed; it must be a source of '
                        f'heat_sources that cools a standing car: {", ".join(coolers) or "the file has none"}')
        return None
    if not values.keys() <= {'set_point_c', 'proportional_band_k'}:
        problems.append('charging.cooling: heat_source states the powers; set_point_c and proportional_band_k are '
                        'allowed beside it')
        return None
    source = heat_sources[name]
    power = source.maximum_power_w
    assert isinstance(source.hvch_watts, Table) and isinstance(power, Table)
    # A compressor with steps delivers lower powers in the mean of its steps.
    most_w = (source.power_steps_w or (source.most_w,))[-1]
    power = power.changed(lambda value: min(value, most_w))
    ratio = source.hvch_watts.changed(lambda value: -efficiency * value)
    return Cooling(electrical_power_w=most_w, cooling_power_w=most_w * max(map(max, ratio.values)),
                   curves=(power, ratio), **arguments_of(values))


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


def _problems(charging: Charging, lowest_c: float, highest_c: float) -> Iterator[str]:
    """Yield a sentence for each implausible value of a Charging from a file."""
    limit_c, cooling = charging.heating_limit_c, charging.cooling
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
