# SPDX-License-Identifier: Apache-2.0
"""
Response of the battery's power to the heater's command: evidence on the heater if power is measured.

The power beyond the route plan, its cabin and its auxiliaries is the heater's power plus an excess: traffic, a
wrong consumption, an unplanned consumer. The excess lasts for minutes, and the heater's power follows
its command with a lag. Each kind of heater, with each of three lags, therefore has a scalar Kalman filter for the
excess, and is weighted by how well it predicts the mean power of the next block. A power that does not step with
the command only moves the excess.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.estimation.hypotheses import HEALTHY, HEATERS, prior_weights, SHARES, STUCK, transitions
from bev_preheat.numerics.arithmetic import array_exp, array_log

if TYPE_CHECKING:
    from bev_preheat.estimation.hypotheses import Heater
    from bev_preheat.numerics.arrays import FloatArray

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


class PowerResponse:
    """Watches the battery's power beyond the route plan and the heater's command."""

    def __init__(self) -> None:
        """Start without evidence."""
        shape = len(SHARES), len(HEATER_LAGS_S)
        # Log-likelihood of each heater without evidence, and with that of the power, for each lag.
        self._prior = prior_weights().sum(axis=1)
        self._weights = self._prior[:, np.newaxis] * np.full(shape[1], 1.0 / shape[1])
        self._excess_w, self._variance_w2 = np.zeros(shape), np.full(shape, EXCESS_W**2)
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
        excess_w = left * self._excess_w
        variance_w2 = left**2 * self._variance_w2 + (1.0 - left**2) * EXCESS_W**2
        total_w2 = variance_w2 + self._scatter_w2
        error_w = beyond_w - heater_w - excess_w
        logs = (-0.5 * array_log(total_w2)
                - 0.5 * (FREEDOM + 1.0) * array_log(1.0 + error_w**2 / (FREEDOM * total_w2)))
        logs = np.maximum(logs - logs.max(), -MOST_EVIDENCE)
        gain = variance_w2 / total_w2
        self._excess_w = excess_w + gain * error_w
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
        excess_w = (share * self._excess_w[:, np.newaxis]).sum(axis=0)
        off_w = self._excess_w[:, np.newaxis] - excess_w
        self._variance_w2 = (share * (self._variance_w2[:, np.newaxis] + off_w**2)).sum(axis=0)
        self._excess_w = excess_w

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
