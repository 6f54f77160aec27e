# SPDX-License-Identifier: Apache-2.0
"""Named rows of variables or constraints of a nonlinear program, and their places in its vector."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import casadi
import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics import FloatArray

# Values of each row: one number for all its elements, or one for each, in SI units.
Values = Mapping[str, 'FloatArray | float']

# The scale that brings powers near 1.
POWER_SCALE_W = 1e3


class Blocks:
    """Rows of a program, in the order of its vector; `scale` is the SI value that is 1 in the program."""

    def __init__(self) -> None:
        """Begin empty."""
        self._rows: dict[str, casadi.MX] = {}
        self._scales: dict[str, float] = {}

    def add(self, name: str, row: casadi.MX, scale: float = 1.0) -> None:
        """Add a row vector, scaled."""
        self._rows[name], self._scales[name] = row, scale

    def variable(self, name: str, count: int, scale: float = 1.0) -> casadi.MX:
        """Add and return a row of variables, scaled."""
        self.add(name, casadi.MX.sym(name, 1, count), scale)
        return self._rows[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rows."""
        return tuple(self._rows)

    def row(self, name: str) -> casadi.MX:
        """Return the row that was added under a name; raises KeyError for an unknown name."""
        return self._rows[name]

    def vector(self) -> casadi.MX:
        """Return all rows as one column."""
        return casadi.vertcat(*(row.T for row in self._rows.values()))

    def pack(self, values: Values, otherwise: float | None = None) -> FloatArray:
        """
        Return the vector of values in SI units, scaled.

        Names that are not in the program are ignored; missing ones have the value `otherwise`. Raises KeyError if
        that is None, ValueError if a row has another number of values.
        """
        return np.concatenate([
            np.broadcast_to(np.asarray(values[name] if otherwise is None else values.get(name, otherwise),
                                       dtype=float) / self._scales[name], row.shape[1])
            for name, row in self._rows.items()])

    def unpack(self, vector: FloatArray) -> dict[str, FloatArray]:
        """Return the rows of a vector by name, in SI units."""
        ends = np.cumsum([row.shape[1] for row in self._rows.values()])
        return {name: scale * part for (name, scale), part in zip(
            self._scales.items(), np.split(np.asarray(vector), ends[:-1]))}
