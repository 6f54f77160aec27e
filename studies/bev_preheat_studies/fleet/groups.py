# SPDX-License-Identifier: Apache-2.0
"""The ways to heat a fleet, and the groups of its trips by air temperature and driving time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

NONE, ALWAYS, USUAL, BEST = WAYS = ('no_heating', 'always_on', 'usual_target', 'best_target')
AMBIENT_EDGES_C = (-10.0, -5.0, 0.0, 5.0)
LENGTH_EDGES_MIN = (30.0, 60.0, 90.0)


def _intervals(edges: Sequence[float], unit: str) -> list[tuple[str, float, float]]:
    """Return the name and bounds of the intervals between edges."""
    return [(f'below {edges[0]:g} {unit}', -math.inf, edges[0]),
            *((f'{low:g} to {high:g} {unit}', low, high) for low, high in zip(edges, edges[1:])),
            (f'from {edges[-1]:g} {unit}', edges[-1], math.inf)]


AMBIENTS, LENGTHS = _intervals(AMBIENT_EDGES_C, 'degC'), _intervals(LENGTH_EDGES_MIN, 'min')
