# SPDX-License-Identifier: Apache-2.0
"""Positions of the named variables or constraints of a nonlinear program in its vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray, IntArray

# Values of each block: one number for all its elements, or one for each, in SI units.
Values = Mapping[str, 'FloatArray | float']


@dataclass(frozen=True)
class ProgramQuantity:
    """A variable or a constraint of one stage; `scale` is the SI value that is 1 in the program."""

    name: str
    scale: float = 1.0


@dataclass(frozen=True)
class VariableBlock:
    """
    `count` variables or constraints of one kind; `scale` is the SI value that is 1 in the program.

    `stages` are the numbers of their stages in a program with stages; () otherwise.
    """

    name: str
    count: int
    scale: float = 1.0
    stages: tuple[int, ...] = ()


@dataclass(frozen=True)
class Layout:
    """
    Blocks, and the order of their elements in the vector.

    Elements of blocks with stages are ordered by stage, and within a stage by block;
    those of other blocks follow block by block.
    """

    blocks: tuple[VariableBlock, ...]

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(block.count for block in self.blocks)

    @cached_property
    def places(self) -> dict[str, IntArray]:
        """Positions of the elements of each block, by name; arrays of shape (count,)."""
        stages = np.concatenate([
            block.stages or np.zeros(block.count, int) for block in self.blocks])
        # A stable sort keeps the order of the blocks within each stage.
        places = np.empty(self.size, int)
        places[np.argsort(stages, kind='stable')] = np.arange(self.size)
        ends = np.cumsum([block.count for block in self.blocks])
        return {block.name: part for block, part in zip(self.blocks, np.split(places, ends[:-1]))}

    def pack(self, values: Values) -> FloatArray:
        """
        Return the vector of values in SI units, scaled.

        Names that are not in the layout are ignored. Raises KeyError if a name of the layout is missing,
        ValueError if a block has another number of values.
        """
        vector = np.empty(self.size)
        for block in self.blocks:
            vector[self.places[block.name]] = np.broadcast_to(
                np.asarray(values[block.name], dtype=float) / block.scale, block.count)
        return vector

    def unpack(self, vector: FloatArray) -> dict[str, FloatArray]:
        """Return the blocks of a vector by name, in SI units."""
        vector = np.asarray(vector)
        return {block.name: block.scale * vector[self.places[block.name]]
                for block in self.blocks}
