# SPDX-License-Identifier: Apache-2.0
"""Where the named variables or constraints of a nonlinear program lie in its one long vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# What each block takes: one number for all its elements, or one for each, in SI units.
Values = Mapping[str, 'FloatArray | float']


@dataclass(frozen=True)
class Block:
    """`count` variables or constraints of one kind; `scale` is the SI value that is 1 in the program."""

    name: str
    count: int
    scale: float = 1.0


@dataclass(frozen=True)
class Layout:
    """Blocks in the order in which they lie in the vector."""

    blocks: tuple[Block, ...]

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(block.count for block in self.blocks)

    def pack(self, values: Values) -> FloatArray:
        """
        Return the vector of values in SI units, scaled.

        Names that are not in the layout are left out. Raises KeyError where one of it is missing,
        ValueError where a block has another number of values.
        """
        return np.concatenate([
            np.broadcast_to(np.asarray(values[block.name], dtype=float) / block.scale, block.count)
            for block in self.blocks])

    def unpack(self, vector: FloatArray) -> dict[str, FloatArray]:
        """Return the blocks of a vector by name, in SI units."""
        ends = np.cumsum([block.count for block in self.blocks])
        return {block.name: block.scale * part
                for block, part in zip(self.blocks, np.split(np.asarray(vector), ends[:-1]))}
