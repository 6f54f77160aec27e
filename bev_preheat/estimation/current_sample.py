# SPDX-License-Identifier: Apache-2.0
"""A battery state with voltage and current."""

from __future__ import annotations

from typing import NamedTuple


class CurrentSample(NamedTuple):
    """Instant [s], voltage [V], current [A], state of charge (0 ... 1)."""

    instant_s: float
    voltage_v: float
    current_a: float
    soc: float

    def drawn_since(self, before: CurrentSample, capacity_as: float) -> float:
        """Return the share of a capacity [As] that the current has drawn since a sample before."""
        return 0.5 * (self.current_a + before.current_a) * (self.instant_s - before.instant_s) / capacity_as
