# SPDX-License-Identifier: Apache-2.0
"""The temperature that the battery would have without any heating on this trip, past and planned."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.replay.deviation import Deviation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bev_preheat.dashboard.seen import PlanSeen
    from bev_preheat.vehicle.description import Vehicle

# A charge or temperature that is unknown: the open-circuit voltage at these serves.
USUAL_SOC, USUAL_C = 0.5, 20.0
# A longer gap between two measurements starts the comparison again [s].
UNHEATED_GAP_S = 600.0


class Unheated:
    """
    How much warmer the battery is because of the heater, from its power so far.

    The equation is that of replay.deviation.Deviation: stored heat and leakage of the vehicle file; the change of
    the Joule heat by the few degrees is left out. It takes heat away at once, so it starts from the temperature
    that the battery settles at when the heat under way has arrived, as plans do: a reading shows heat late.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        """Start without heat."""
        self._vehicle = vehicle
        self._deviation = Deviation(vehicle)
        self._latest_s: float | None = None

    def restart(self) -> None:
        """Forget the heat, because another trip begins."""
        self._deviation, self._latest_s = Deviation(self._vehicle), None

    def unheated_c(self, at_s: float, settled_c: float, soc: float, power_w: float) -> float:
        """Return the unheated temperature [deg C] (NaN: unknown), while the heater takes `power_w` [W]."""
        if self._latest_s is not None and not 0.0 <= at_s - self._latest_s < UNHEATED_GAP_S:
            self.restart()
        self._latest_s = at_s
        # The difference of a car without the heater is negative.
        self._deviation.advance(_ns(at_s), -_finite(power_w, 0.0), _finite(soc, USUAL_SOC),
                                _finite(settled_c, USUAL_C))
        return settled_c + self._deviation.temperature_k

    def planned_c(self, plan: PlanSeen) -> tuple[float, ...]:
        """Return the unheated temperatures [deg C] at the instants of a plan; () without one."""
        if not plan.times_s or len(plan.powers_w) != len(plan.times_s) - 1:
            return ()
        ahead = copy.copy(self._deviation)
        temperatures_c: list[float] = []
        powers_w: Sequence[float] = (*plan.powers_w, 0.0)
        for at_s, temperature_c, soc, power_w in zip(plan.times_s, plan.temperatures_c, plan.socs, powers_w):
            ahead.advance(_ns(at_s), -_finite(power_w, 0.0), _finite(soc, USUAL_SOC), temperature_c)
            temperatures_c.append(temperature_c + ahead.temperature_k)
        return tuple(temperatures_c)


def _ns(at_s: float) -> int:
    return round(at_s * NS_PER_S)


def _finite(value: float, otherwise: float) -> float:
    return value if math.isfinite(value) else otherwise
