# SPDX-License-Identifier: Apache-2.0
"""
The battery's measured power: its samples, and its response to the heater's command.

The samples give mean and variance of a step, the hidden ripple, and the excess over the route.

The response is evidence on the heater. The power beyond the route plan, its cabin and its auxiliaries is the
heater's power plus an excess: traffic, a wrong consumption, an unplanned consumer. The excess lasts for minutes,
and the heater's power follows its command with a lag. Each kind of heater, with each of three lags, therefore has
a scalar Kalman filter for the excess, and is weighted by how well it predicts the mean power of the next block.
A power that does not step with the command only moves the excess.
"""

from __future__ import annotations

from collections import deque
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.hypotheses import HEALTHY, HEATERS, prior_weights, SHARES, STUCK, transitions
from bev_preheat.numerics.arithmetic import array_exp, array_log

if TYPE_CHECKING:
    from collections.abc import Collection

    from bev_preheat.estimation.hypotheses import Heater
    from bev_preheat.numerics.arrays import FloatArray

# The samples' variance is computed over this time [s], about a segment of a route.
VARIATION_S = 40.0
# The comparison with the route's variance reaches back this far [s].
REMEMBERED_S = 600.0
# On a real drive the power of a single second is several times the route's mean, so the excess is averaged over
# this time [s].
AVERAGED_S = 30.0
# Power is averaged over blocks of this length [s]: longer than most heater ramps, shorter than a heating interval.
BLOCK_S = 30.0
# Lags of the heater behind its command [s]; heaters lag by up to 90 s.
HEATER_LAGS_S = np.array([3.0, 30.0, 90.0])
# Standard deviation of the excess [W], and its correlation time: 10 % of 20 kW, until the road changes.
EXCESS_W = 2000.0
EXCESS_LASTS_S = 600.0
# Prior of the scatter from block to block [W], and the number of blocks that it counts for.
SCATTER_W = 2500.0
SCATTER_BLOCKS = 2.0
# Neighbouring blocks are correlated, so their differences show less than the scatter.
CORRELATED = 1.5
# Lower limit [W]: other consumers and sensors.
LEAST_SCATTER_W = 300.0
# Forgetting rate of the scatter per block.
FORGETTING = 0.05
# Largest evidence of one block [nats], so that a single outlier does not decide.
MOST_EVIDENCE = 3.0
# Degrees of freedom of Student's t: traffic makes large errors likely.
FREEDOM = 4.0
LEAST_WEIGHT = 1e-9


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


class PowerResponse:
    """Watches the battery's power beyond the route plan and the heater's command."""

    def __init__(self) -> None:
        """Start without evidence."""
        shape = len(SHARES), len(HEATER_LAGS_S)
        # Log-likelihood of each heater without evidence, and with that of the power, for each lag.
        self._prior = prior_weights().sum(axis=1)
        self._weights = self._prior[:, np.newaxis] * np.full(shape[1], 1.0 / shape[1])
        self.excess_w, self._variance_w2 = np.zeros(shape), np.full(shape, EXCESS_W**2)
        self._scatter_w2, self._blocks = SCATTER_W**2, SCATTER_BLOCKS
        # Current power of a heater with each lag [W]; None: no command yet.
        self._followed_w: FloatArray | None = None
        self._before_w: float | None = None
        self._begin_block()

    def _begin_block(self) -> None:
        self._lasted_s, self._beyond_ws, self._limit_ws = 0.0, 0.0, 0.0
        self._taken_ws = np.zeros(len(HEATER_LAGS_S))

    def pause(self) -> None:
        """Note that power or plan is unknown; earlier evidence stays."""
        self._begin_block()
        self._before_w, self._followed_w = None, None

    def see(self, duration_s: float, beyond_plan_w: float, command_w: float,
            limit_w: float) -> FloatArray | None:
        """
        Update with the battery's power beyond the plan [W] over `duration_s` [s], under a mean command [W].

        Returns the log-likelihoods (heaters,) of a completed block; else None.
        """
        if self._followed_w is None:
            self._followed_w = np.full(len(HEATER_LAGS_S), command_w)
        left = array_exp(-duration_s / HEATER_LAGS_S)
        mean_share = (1.0 - left) * HEATER_LAGS_S / duration_s
        self._taken_ws += duration_s * (command_w + (self._followed_w - command_w) * mean_share)
        self._followed_w = command_w + (self._followed_w - command_w) * left
        self._lasted_s += duration_s
        self._beyond_ws += duration_s * beyond_plan_w
        self._limit_ws += duration_s * limit_w
        return None if self._lasted_s < BLOCK_S - 0.5 else self._end_block()

    def _end_block(self) -> FloatArray:
        lasted_s = self._lasted_s
        beyond_w, limit_w = self._beyond_ws / lasted_s, self._limit_ws / lasted_s
        heater_w = np.minimum(np.multiply.outer(SHARES, self._taken_ws / lasted_s), limit_w)
        heater_w[STUCK] = limit_w
        self._mix(lasted_s)
        left = math.exp(-lasted_s / EXCESS_LASTS_S)
        excess_w = left * self.excess_w
        variance_w2 = left**2 * self._variance_w2 + (1.0 - left**2) * EXCESS_W**2
        total_w2 = variance_w2 + self._scatter_w2
        error_w = beyond_w - heater_w - excess_w
        logs = (-0.5 * array_log(total_w2)
                - 0.5 * (FREEDOM + 1.0) * array_log(1.0 + error_w**2 / (FREEDOM * total_w2)))
        logs = np.maximum(logs - logs.max(), -MOST_EVIDENCE)
        gain = variance_w2 / total_w2
        self.excess_w = excess_w + gain * error_w
        self._variance_w2 = (1.0 - gain) * variance_w2
        before = self._weights.sum(axis=1)
        weights = self._weights * array_exp(logs)
        self._learn_scatter(beyond_w - float((weights * heater_w).sum() / weights.sum()))
        self._weights = np.maximum(weights / weights.sum(), LEAST_WEIGHT)
        self._begin_block()
        seen: FloatArray = array_log(weights.sum(axis=1) / before)
        return seen

    def _mix(self, duration_s: float) -> None:
        """Mix the heaters' filters, because a heater may have changed from one kind to another."""
        # share[from, to, lag]: how much of `to` was `from` before.
        matrix = transitions(duration_s)
        self._prior = self._prior @ matrix
        share = matrix[:, :, np.newaxis] * self._weights[:, np.newaxis, :]
        self._weights = share.sum(axis=0)
        share /= self._weights
        excess_w = (share * self.excess_w[:, np.newaxis]).sum(axis=0)
        off_w = self.excess_w[:, np.newaxis] - excess_w
        self._variance_w2 = (share * (self._variance_w2[:, np.newaxis] + off_w**2)).sum(axis=0)
        self.excess_w = excess_w

    def _learn_scatter(self, rest_w: float) -> None:
        """Update the scatter of blocks with the power that the heater does not explain [W]."""
        before_w, self._before_w = self._before_w, rest_w
        if before_w is None:
            return
        self._blocks += 1.0
        seen_w2 = 0.5 * CORRELATED * (rest_w - before_w)**2
        self._scatter_w2 += max(FORGETTING, 1.0 / self._blocks) * (seen_w2 - self._scatter_w2)
        self._scatter_w2 = max(self._scatter_w2, LEAST_SCATTER_W**2)

    def support(self, kind: Heater) -> float:
        """Return the log-likelihood ratio of a kind of heater over a healthy one, from the power [nats]."""
        weights = self._weights.sum(axis=1)
        of_kind = [number for number, own in enumerate(HEATERS) if own is kind]
        return math.log(float(weights[of_kind].sum() / weights[HEALTHY])
                        / float(self._prior[of_kind].sum() / self._prior[HEALTHY]))
