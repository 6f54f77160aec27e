# SPDX-License-Identifier: Apache-2.0
"""
The charging power of a hot battery.

A map that ends at a warm battery says nothing about a hot one, and a table is constant beyond its ends. So each
map gets a fall to 0: the stated one or, unless the map itself ends at 0, one over the last FALL_K below the
vehicle's highest battery temperature.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.vehicle.curves import Table

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

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
    """
    Return a charging map that falls to 0 at the highest battery temperature [deg C], and where the fall begins.

    A map that itself ends at 0 is returned as it is, with None.
    """
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
    """
    Return the temperature [deg C] above which heat lowers the power of a charging map; infinite without a fall.

    That is the hottest point of the map with which no state of charge has less power than at any colder point.
    """
    power_w = -np.array(table.values)
    most_w = np.maximum.accumulate(power_w, axis=1)
    full = np.flatnonzero((power_w >= most_w * (1.0 - 1e-9)).all(axis=0))
    last = int(full[-1])
    return table.temperature_c[last] if last + 1 < len(table.temperature_c) else float('inf')


def _axis(table: Table) -> tuple[float, ...]:
    """Return the temperatures of a table [deg C]; none if it does not depend on the temperature."""
    return table.temperature_c if len(table.temperature_c) > 1 else ()
