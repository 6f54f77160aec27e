# SPDX-License-Identifier: Apache-2.0
"""What of a vehicle file is assumed, in words: the warning that goes with plans."""

from __future__ import annotations

from pathlib import Path
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.vehicle.description import Vehicle

# Units at the end of a key, which a reader of a sentence does not need.
_UNIT = re.compile(r'_(ah|j_per_k|w|c|kg|m2)$')
_WORDS = {'hvch': 'HVCH', 'soc': 'state-of-charge', 'defaults': 'default'}


def key_in_words(key: str) -> str:
    """Return a key of a vehicle file as words: battery.heat_capacity_j_per_k, battery heat capacity."""
    words = ' '.join(_UNIT.sub('', part) for part in key.split('.')).replace('_', ' ')
    return ' '.join(_WORDS.get(word, word) for word in words.split(' '))


def assumed_in_words(vehicle: Vehicle) -> str:
    """Return what is assumed of a Vehicle as one text, empty where nothing is."""
    return ', '.join(map(key_in_words, vehicle.assumed))


def assumption_warning(vehicle: Vehicle, file: str | Path) -> str | None:
    """Return the sentence that warns of plans with assumed values; None where none is assumed."""
    if not vehicle.assumed:
        return None
    return (f'vehicle {vehicle.name}: assumed, not measured: {assumed_in_words(vehicle)}; '
            f'see {file}')
