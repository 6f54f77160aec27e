# SPDX-License-Identifier: Apache-2.0
"""The model's inputs along a trip: columns by name, in one block of memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# In this order they lie in the block; the first has one value more than there are steps.
TRIP_COLUMNS = ('time_s', 'duration_s', 'idle_power_w', 'power_variance_w2', 'idle_heat_w',
                'leakage_w_per_k', 'heater_limit_w', 'propulsion_power_w', 'drivetrain_heat_w',
                'ambient_temperature_c')


@dataclass(frozen=True, eq=False)
class TripColumns:
    """
    Columns of a trip of so many steps: the first of TRIP_COLUMNS (N + 1,), the others (N,).

    `block` has the columns one after the other.
    """

    steps: int
    block: FloatArray

    @classmethod
    def of_columns(cls, *columns: FloatArray) -> Self:
        """Return the columns of a trip, given in their order."""
        return cls(len(columns[1]), np.concatenate(columns, dtype=float))

    def changed(self, **columns: FloatArray) -> Self:
        """Return the columns of a trip with others, by name."""
        if unknown := columns.keys() - TRIP_COLUMNS:
            raise TypeError(f'{", ".join(sorted(unknown))}: not columns of a trip')
        return self.of_columns(*{**dict(zip(TRIP_COLUMNS, map(self.column, TRIP_COLUMNS))), **columns}.values())

    def column(self, name: str) -> FloatArray:
        """Return a column, as a part of the block."""
        number, steps = TRIP_COLUMNS.index(name), self.steps
        end = 1 + (number + 1) * steps
        return self.block[end - steps if number else 0:end]
