# SPDX-License-Identifier: Apache-2.0
"""The temperature up to which a car heats its battery at the charger, over the state of charge."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class HeatingLimit:
    """
    A limit of heating over the state of charge: the car heats its battery while it is colder.

    `soc` (N,) rises (0 ... 1); `temperature_c` (N,) [deg C] is linear between its points and constant beyond them.
    Without points the car's own limit holds. The car never heats above its own limit.
    """

    soc: tuple[float, ...] = ()
    temperature_c: tuple[float, ...] = ()

    def shifted(self, by_k: float) -> HeatingLimit:
        """Return the limit, higher by this [K]."""
        return HeatingLimit(self.soc, tuple(limit_c + by_k for limit_c in self.temperature_c))

    def function(self, highest_c: float) -> Callable[[float], float]:
        """Return `f(soc)` [deg C], at most `highest_c`; -inf if that is the car's way to say never."""
        if not self.soc or highest_c == -inf:
            return lambda soc: highest_c
        socs, limits_c, last = self.soc, self.temperature_c, len(self.soc) - 1
        if min(limits_c) >= highest_c:
            return lambda soc: highest_c
        first_c, last_c = (min(limits_c[place], highest_c) for place in (0, last))

        def limit_c(soc: float) -> float:
            place = bisect_right(socs, soc)
            if place == 0:
                return first_c
            if place > last:
                return last_c
            low_soc, low_c = socs[place - 1], limits_c[place - 1]
            return min(highest_c, low_c + (limits_c[place] - low_c) * (soc - low_soc) / (socs[place] - low_soc))

        return limit_c


ALWAYS = HeatingLimit()
NEVER = HeatingLimit((0.0,), (-inf,))
