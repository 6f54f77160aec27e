# SPDX-License-Identifier: Apache-2.0
"""The heat that a run within limits wants, and the steps in which a limit may cut it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from bev_preheat.numerics.arrays import BoolArray, FloatArray

# `wanted_w(step, temperature_c)` -> heater power [W].
WantedPower = Callable[[int, float], float]


class WantedHeat(NamedTuple):
    """
    Heat that a run within limits wants in each step, before limits cut it.

    `power_w` (N,) [W]; with `bands`, only below temperatures: in each band of Thresholds
    (`floor_c`, `low_c`, `high_c`, each (N, BANDS)) at that power from the floor to low, off from high,
    in proportion in between.
    """

    power_w: FloatArray
    bands: tuple[FloatArray, FloatArray, FloatArray] | None = None

    def at_temperature(self) -> WantedPower:
        """Return `wanted_w(step, temperature_c)` -> heater power [W]."""
        power_w: list[float] = self.power_w.tolist()
        if self.bands is None:
            return lambda k, temperature_c: power_w[k]
        bands: list[list[tuple[float, float, float]]] = [
            list(zip(*band)) for band in zip(*(column.tolist() for column in self.bands))]

        def wanted_w(k: int, temperature_c: float) -> float:
            for floor_c, low_c, high_c in bands[k]:
                if floor_c <= temperature_c < high_c:
                    if temperature_c <= low_c:
                        return power_w[k]
                    return power_w[k] * (high_c - temperature_c) / (high_c - low_c)
            return 0.0

        return wanted_w


class LimitedSteps(NamedTuple):
    """Steps in which a limit may matter, shape (N,): for regeneration, or for drive and heater."""

    charge: BoolArray
    discharge: BoolArray

    @property
    def any(self) -> bool:
        """Whether there is any such step."""
        return bool(self.charge.any() or self.discharge.any())
