# SPDX-License-Identifier: Apache-2.0
"""Assumed values of a vehicle file, in words, for the warning that goes with plans."""

from __future__ import annotations

from pathlib import Path
import re
import shlex
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# Unit suffixes of keys, left out in sentences.
_UNIT = re.compile(r'_(ah|j_per_k|ohm|w|c|kg|m2)$')
_WORDS = {'hvch': 'HVCH', 'soc': 'state-of-charge', 'defaults': 'default'}


def key_in_words(key: str) -> str:
    """Return a vehicle file's key in words: battery.heat_capacity_j_per_k becomes battery heat capacity."""
    words = ' '.join(_UNIT.sub('', part) for part in key.split('.')).replace('_', ' ')
    return ' '.join(_WORDS.get(word, word) for word in words.split(' '))


def assumed_in_words(vehicle: Vehicle) -> str:
    """Return the assumed keys of a Vehicle as one text, '' without any."""
    return ', '.join(map(key_in_words, vehicle.assumed))


def assumption_warning(vehicle: Vehicle, file: str | Path) -> str | None:
    """Return the warning about plans with assumed values, None without any."""
    count = len(vehicle.assumed)
    if not count:
        return None
    values = 'value is' if count == 1 else 'values are'
    return (f'vehicle {vehicle.name}: {count} {values} assumed, not measured; preheat vehicle check '
            f'{shlex.quote(str(file))} lists them')
