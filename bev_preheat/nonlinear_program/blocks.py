# SPDX-License-Identifier: Apache-2.0
"""Collects the named expressions of a nonlinear program."""

from __future__ import annotations

import casadi

from bev_preheat.nonlinear_program.layout import Layout, VariableBlock

# The scale that brings powers near 1.
POWER_SCALE_W = 1e3


class Blocks:
    """Expressions of a program, or its variables, in the order of its vector."""

    def __init__(self) -> None:
        """Begin empty."""
        self._blocks: list[VariableBlock] = []
        self._expressions: list[casadi.MX] = []

    def add(self, name: str, row: casadi.MX, scale: float = 1.0) -> None:
        """Add a row vector, scaled."""
        self._blocks.append(VariableBlock(name, row.shape[1], scale))
        self._expressions.append(row.T)

    def variable(self, name: str, count: int, scale: float = 1.0) -> casadi.MX:
        """Add and return a row of variables, scaled."""
        row = casadi.MX.sym(name, 1, count)
        self.add(name, row, scale)
        return row

    def row(self, name: str) -> casadi.MX:
        """Return the row that was added under a name; raises KeyError for an unknown name."""
        for block, column in zip(self._blocks, self._expressions):
            if block.name == name:
                return column.T
        raise KeyError(name)

    def layout(self) -> Layout:
        """Return the Layout of the blocks."""
        return Layout(tuple(self._blocks))

    def vector(self) -> casadi.MX:
        """Return all blocks as one column."""
        return casadi.vertcat(*self._expressions)
