# SPDX-License-Identifier: Apache-2.0
"""Commands of a heater with lag that take the steps ahead into account."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bev_preheat.planning.heat_run import mean_share_left

if TYPE_CHECKING:
    from bev_preheat.planning.heat_run import States
    from bev_preheat.planning.limits import LimitedSteps
    from bev_preheat.planning.trip import Trip
    from bev_preheat.vehicle.terminal_limits import TerminalLimits

# This many lags after it was switched off, a heater draws no significant power.
LAGS_AHEAD = 5.0
# Surplus is used if it lasts for this many more lags: after that the heater goes on, with paid power. This is
# optimal if heat is worth half of its cost (the logarithm of 2).
LASTING_LAGS = 0.7


class Foresight:
    """Looks ahead along one trip, with the limits of the battery's state now."""

    def __init__(self, trip: Trip, watch: LimitedSteps, limits: TerminalLimits[float]) -> None:
        """Take a trip, its LimitedSteps, and the terminal limits for floats."""
        self._limits, self._lag_s = limits, trip.vehicle.heat_path.heater_lag_s
        self._duration_s: list[float] = trip.route.duration_s.tolist()
        self._idle_power_w: list[float] = trip.idle_power_w.tolist()
        self._variance_w2: list[float] = trip.power_variance_w2.tolist()
        self._may_overdraw: list[bool] = watch.discharge.tolist()
        self._decay = [math.exp(-each_s / self._lag_s) for each_s in self._duration_s]
        self._mean_left: list[float] = mean_share_left(
            trip.vehicle.heat_path, trip.route.duration_s).tolist()
        ahead_s, starts_s = LAGS_AHEAD * self._lag_s, trip.time_s[:-1][watch.discharge]
        self._before_climbs = frozenset(
            k for k in range(len(trip.route))
            if ((starts_s > trip.time_s[k]) & (starts_s < trip.time_s[k + 1] + ahead_s)).any())

    def _steps_after(self, k: int, duration_s: float) -> range:
        """Return the steps that begin within this duration after the end of step k."""
        last = k
        while last + 1 < len(self._duration_s) and duration_s > 0.0:
            last += 1
            duration_s -= self._duration_s[last]
        return range(k + 1, last + 1)

    def off_in_time_w(self, k: int, states: States) -> float:
        """Return the highest command [W] with which the heater, once switched off, leaves a climb its power."""
        if k not in self._before_climbs:
            return math.inf
        soc, temperature_c, heater_w, _ = states
        allowed_w = math.inf
        for j in reversed(self._steps_after(k, LAGS_AHEAD * self._lag_s)):
            # With a lag that is short compared with the step, nothing is left at its end.
            allowed_w = allowed_w / self._decay[j] if self._decay[j] > 0.0 else math.inf
            if self._may_overdraw[j]:
                _, most_w = self._limits(soc, temperature_c, self._variance_w2[j])
                # A deficit that exists without any heating is not the heater's to fix.
                allowed_w = min(allowed_w, max(
                    most_w - self._idle_power_w[j], 0.0) / self._mean_left[j])
        return (allowed_w - self._decay[k] * heater_w) / (1.0 - self._decay[k])

    def lasting_surplus_w(self, k: int, states: States) -> float:
        """Return the part of the surplus [W] that lasts: the heater's power after it is paid for."""
        soc, temperature_c, _, _ = states
        # Counted from the middle of the step: in a step that is long compared with the lag, its own surplus is
        # worth using whatever follows.
        ahead_s = LASTING_LAGS * self._lag_s - 0.5 * self._duration_s[k]
        steps = self._steps_after(k, ahead_s)
        if not steps:
            return math.inf
        if sum(self._duration_s[j] for j in steps) < ahead_s:
            # The rest would be drawn after arrival.
            return 0.0
        return max(0.0, min(self._limits(soc, temperature_c, self._variance_w2[j])[0]
                            - self._idle_power_w[j] for j in steps))
