# SPDX-License-Identifier: Apache-2.0
"""Samples of the battery's power: mean and variance of a step, hidden ripple, excess over the route."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

# The samples' variance is computed over this time [s], about a segment of a route.
VARIATION_S = 40.0
# The comparison with the route's variance reaches back this far [s].
REMEMBERED_S = 600.0
# On a real drive the power of a single second is several times the route's mean, so the excess is averaged over
# this time [s].
AVERAGED_S = 30.0


class PowerSamples:
    """Samples of the battery's power [W]; instants in seconds."""

    def __init__(self) -> None:
        """Start without samples."""
        # Samples of the current step; the first one ended the previous step.
        self._step_w: list[float] = []
        # Instants [s] and powers [W] of the last VARIATION_S.
        self._latest_s: deque[float] = deque()
        self._latest_w: deque[float] = deque()
        # Variance of the samples and of the route, each times its duration [W^2 s].
        self._seen_w2s = self._route_w2s = 0.0
        # Duration of each step [s], and its propulsion energy beyond the route's [J].
        self._excess: deque[tuple[float, float]] = deque()

    def see(self, instant_s: float, power_w: float | None) -> None:
        """Add a sample; None: the power is unknown, and the step has no mean."""
        if power_w is None:
            self._step_w = []
            self._excess.clear()
            return
        self._step_w.append(power_w)
        self._latest_s.append(instant_s)
        self._latest_w.append(power_w)
        while self._latest_s[0] < instant_s - VARIATION_S:
            self._latest_s.popleft()
            self._latest_w.popleft()

    def begin_step(self, power_w: float | None) -> None:
        """Begin a step with the sample of its first instant [W], None: unknown."""
        self._step_w = [] if power_w is None else [power_w]

    def end_step(self) -> None:
        """Begin the next step with the last sample of this one."""
        self._step_w = self._step_w[-1:]

    def forget_latest(self) -> None:
        """Discard the samples; keep the share of the route's variance that they showed."""
        self._step_w = []
        self._latest_s.clear()
        self._latest_w.clear()
        self._excess.clear()

    def step(self) -> tuple[float, float] | None:
        """Return mean [W] and variance [W^2] of the power in the step; None: unknown."""
        return _mean_and_variance(self._step_w) if len(self._step_w) >= 2 else None

    def hidden_w2(self, route_w2: float, duration_s: float) -> float:
        """
        Return the part of a route's power variance [W^2] that the samples do not show in a step.

        Samples once a second may miss a ripple. Single segments vary more or less than the route states, so
        sums over REMEMBERED_S are compared.
        """
        if route_w2 == 0.0:
            return 0.0
        kept = max(0.0, 1.0 - duration_s / REMEMBERED_S)
        self._seen_w2s = kept * self._seen_w2s + duration_s * _mean_and_variance(self._latest_w)[1]
        self._route_w2s = kept * self._route_w2s + duration_s * route_w2
        return route_w2 * max(0.0, 1.0 - self._seen_w2s / self._route_w2s)

    def mean_propulsion_w(self, seen_w: float, route_w: float, duration_s: float) -> float:
        """Return the route's propulsion power [W] plus the mean excess over it in the last AVERAGED_S."""
        self._excess.append((duration_s, duration_s * (seen_w - route_w)))
        total_s = sum([seconds for seconds, _ in self._excess])
        while total_s - self._excess[0][0] >= AVERAGED_S:
            total_s -= self._excess.popleft()[0]
        return route_w + sum([excess_j for _, excess_j in self._excess]) / total_s


def _mean_and_variance(values: Collection[float]) -> tuple[float, float]:
    """Return mean and variance of values."""
    # NumPy is slower for a few dozen values.
    mean = sum(values) / len(values)
    return mean, sum([(value - mean)**2 for value in values]) / len(values)
