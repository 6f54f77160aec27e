# SPDX-License-Identifier: Apache-2.0
"""Comments of an identified vehicle file: interval and origin of each value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.errors import figure
from bev_preheat.identification.vehicle_file import LEAST_LAG_S

if TYPE_CHECKING:
    from bev_preheat.identification.result import Estimated, Identification
    from bev_preheat.vehicle.description import Vehicle

UNCERTAINTY_NOTE = 'relative standard deviations of the values above, from which the estimation starts'


def notes_of(result: Identification) -> dict[str, str]:
    """Return the comments of the identified file by dotted key."""
    notes = {item.key: _note(item, *_in_the_file(item, result.vehicle)) for item in result.estimates if item.key}
    low_c, high_c = result.coverage.resistance_from_c, result.coverage.resistance_to_c
    if result.electrical.used:
        notes['battery.open_circuit_voltage'] = (
            f'identified between soc {result.coverage.soc[0]:.2f} and {result.coverage.soc[1]:.2f}; '
            f'extrapolated beyond')
        notes['battery.resistance'] = ('identified on one log' if low_c is None or high_c is None else
                                       f'identified between {low_c:g} and {high_c:g} degC; extrapolated beyond')
    leakage = [notes.pop(key) for key in (
        'battery.leakage.gamma_0_w_per_k', 'battery.leakage.gamma_v_w_per_k_per_mps') if key in notes]
    notes['battery.leakage'] = '; with speed: '.join(leakage)
    notes['uncertainty'] = UNCERTAINTY_NOTE
    return notes


def identified_keys(result: Identification) -> frozenset[str]:
    """Return the dotted keys of the file whose values were identified."""
    keys = {item.key for item in result.estimates if item.is_identified and item.key}
    if result.electrical.used:
        keys |= {'battery.open_circuit_voltage', 'battery.resistance'}
    if 'battery.leakage.gamma_0_w_per_k' in keys:
        keys.add('battery.leakage')
    return frozenset(keys)


def _in_the_file(item: Estimated, vehicle: Vehicle) -> tuple[float, float, str]:
    """Return the interval of an estimate as that of the file's value at its key, and the unit."""
    coolant_j_per_k = vehicle.heat_path.coolant_heat_capacity_j_per_k
    losses = 1.0 - vehicle.drivetrain.efficiency
    if item.name == 'heat_capacity':
        return item.low - coolant_j_per_k, item.high - coolant_j_per_k, item.unit
    if item.name == 'drivetrain_heat' and losses > 0.0:
        return min(item.low / losses, 1.0), min(item.high / losses, 1.0), ''
    if item.name == 'heat_lag':
        low, high = (coolant_j_per_k / max(lag_s, LEAST_LAG_S) for lag_s in (item.high, item.low))
        return low, high, 'W/K'
    return item.low, item.high, item.unit


def _note(item: Estimated, low: float, high: float, unit: str) -> str:
    if not item.is_identified:
        return "START's value: the logs do not tell it"
    return f'identified, 90 % interval {figure(low, 4)} ... {figure(high, 4)} {unit}'.rstrip()
