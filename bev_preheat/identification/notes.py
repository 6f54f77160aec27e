# SPDX-License-Identifier: Apache-2.0
"""Comments of an identified vehicle file: interval and origin of each value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.errors import figure

if TYPE_CHECKING:
    from bev_preheat.identification.result import Estimated, Identification

DIGITS = 4
UNCERTAINTY_NOTE = 'relative standard deviations of the values above, from which the estimation starts'


def notes_of(result: Identification) -> dict[str, str]:
    """Return the comments of the identified file by dotted key."""
    notes = {item.key: _note(item) for item in result.estimates if item.key}
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


def _note(item: Estimated) -> str:
    if not item.is_identified:
        return "START's value: the logs do not tell it"
    interval = f'{figure(item.low, DIGITS)} ... {figure(item.high, DIGITS)} {item.unit}'
    return f'identified, 90 % interval {interval}'.rstrip()
