# SPDX-License-Identifier: Apache-2.0
"""The heat that a run within limits wants."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import FloatArray

# `wanted_w(step, temperature_c)` -> heater power [W].
WantedPower = Callable[[int, float], float]


class WantedHeat(NamedTuple):
    """
    Heat that a run within limits wants in each step, before limits cut it.

    `power_w` (N,) [W], in steps that begin colder than `below_c` [deg C].
    """

    power_w: FloatArray
    below_c: float = math.inf

    def at_temperature(self) -> WantedPower:
        """Return `wanted_w(step, temperature_c)` -> heater power [W]."""
        power_w: list[float] = self.power_w.tolist()
        return lambda k, temperature_c: power_w[k] if temperature_c < self.below_c else 0.0
