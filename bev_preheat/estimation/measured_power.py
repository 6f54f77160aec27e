# SPDX-License-Identifier: Apache-2.0
"""
The battery's measured power: its samples, and its response to the heater's command.

The samples give mean and variance of a step, the hidden ripple, and the excess over the route.

The response is evidence on the heater. The power beyond the route plan, its cabin and its auxiliaries is the
heater's power plus an excess: traffic and unplanned consumers last for minutes, a wrong consumption is a share
of the propulsion and stays. The heater's power follows its command with a lag. Each kind of heater, with each of
three lags, therefore has a Kalman filter for the two excesses, and is weighted by how well it predicts the mean
power of the next block. A power that does not step with the command only moves the excess.
"""

from __future__ import annotations

from collections.abc import Collection
import math
from typing import NamedTuple

import numpy as np

from bev_preheat.estimation.hypotheses import HEALTHY, Heater, HEATERS, prior_weights, SHARES, STUCK, transitions
from bev_preheat.numerics import array_exp, array_log, FloatArray, frozen
from bev_preheat.tunables import (
    CONSUMPTION,
    CORRELATED,
    EXCESS_W,
    FREEDOM,
    LEAST_SCATTER_W,
    LEAST_WEIGHT,
    MOST_BLOCK_EVIDENCE,
    POWER_BLOCK_S,
    ROAD_LASTS_S,
    SCATTER_BLOCKS,
    SCATTER_W,
    VARIATION_S,
)

# Lags of the heater behind its command [s]; heaters lag by up to 90 s.
HEATER_LAGS_S = np.array([3.0, 30.0, 90.0])


class PowerSamples(NamedTuple):
    """
    Samples of the battery's power [W]; instants in seconds.

    `step_w` are those of the current step; the first one ended the previous step. `latest_s` and `latest_w`
    are instants and powers of the last VARIATION_S. `seen_w2s` and `route_w2s` are the variance of the samples and
    of the route, each times its duration [W^2 s]. `excess` are the duration of each step [s], and its propulsion
    energy beyond the route's [J].
    """

    step_w: tuple[float, ...] = ()
    latest_s: tuple[float, ...] = ()
    latest_w: tuple[float, ...] = ()
    seen_w2s: float = 0.0
    route_w2s: float = 0.0
    excess: tuple[tuple[float, float], ...] = ()

    def seen(self, instant_s: float, power_w: float | None) -> PowerSamples:
        """Return the samples and another one; None: the power is unknown, and the step has no mean."""
        if power_w is None:
            return self._replace(step_w=(), excess=())
        latest_s, first = (*self.latest_s, instant_s), 0
        while latest_s[first] < instant_s - VARIATION_S:
            first += 1
        return self._replace(step_w=(*self.step_w, power_w), latest_s=latest_s[first:],
                             latest_w=(*self.latest_w, power_w)[first:])

    def of_next_step(self) -> PowerSamples:
        """Return the samples whose next step begins with the last sample of this one."""
        return self._replace(step_w=self.step_w[-1:])

    def of_step(self, power_w: float | None) -> PowerSamples:
        """Return the samples of a step that begins with a sample [W]; None: unknown."""
        return self._replace(step_w=() if power_w is None else (power_w,))

    def without_latest(self) -> PowerSamples:
        """Return the samples without the latest ones; the share of the route's variance that they showed stays."""
        return PowerSamples(seen_w2s=self.seen_w2s, route_w2s=self.route_w2s)

    def step(self) -> tuple[float, float] | None:
        """Return mean [W] and variance [W^2] of the power in the step; None: unknown."""
        return _mean_and_variance(self.step_w) if len(self.step_w) >= 2 else None

    def hidden_w2(self, route_w2: float, duration_s: float) -> tuple[PowerSamples, float]:
        """
        Return the samples, and the part of a route's power variance [W^2] that they do not show in a step.

        Samples once a second may miss a ripple. Single segments vary more or less than the route states, so
        sums over ROAD_LASTS_S are compared.
        """
        if route_w2 == 0.0:
            return self, 0.0
        kept = max(0.0, 1.0 - duration_s / ROAD_LASTS_S)
        seen_w2s = kept * self.seen_w2s + duration_s * _mean_and_variance(self.latest_w)[1]
        route_w2s = kept * self.route_w2s + duration_s * route_w2
        return (self._replace(seen_w2s=seen_w2s, route_w2s=route_w2s),
                route_w2 * max(0.0, 1.0 - seen_w2s / route_w2s))

    def mean_propulsion_w(self, seen_w: float, route_w: float, duration_s: float) -> tuple[PowerSamples, float]:
        """Return the samples, and the route's propulsion power plus the mean excess over POWER_BLOCK_S [W]."""
        excess = (*self.excess, (duration_s, duration_s * (seen_w - route_w)))
        total_s = sum([seconds for seconds, _ in excess])
        while total_s - excess[0][0] >= POWER_BLOCK_S:
            total_s -= excess[0][0]
            excess = excess[1:]
        return self._replace(excess=excess), route_w + sum([excess_j for _, excess_j in excess]) / total_s


def _mean_and_variance(values: Collection[float]) -> tuple[float, float]:
    """Return mean and variance of values."""
    # NumPy is slower for a few dozen values.
    mean = sum(values) / len(values)
    return mean, sum([(value - mean)**2 for value in values]) / len(values)


class _Block(NamedTuple):
    """
    A block until now: duration [s] and energies [J].

    `beyond_ws` is the battery's energy beyond the plan, `propulsion_ws` that of the planned propulsion, `limit_ws`
    that of the limit, `taken_ws` (lags,) that of heaters which follow the command with each lag.
    """

    lasted_s: float = 0.0
    beyond_ws: float = 0.0
    propulsion_ws: float = 0.0
    limit_ws: float = 0.0
    taken_ws: FloatArray = frozen(np.zeros(len(HEATER_LAGS_S)))


# Before any evidence: prior of each heater, weights, excess and covariance of each with each lag.
PRIOR = frozen(prior_weights().sum(axis=1))
SHAPE = len(SHARES), len(HEATER_LAGS_S)
WEIGHTS = frozen(PRIOR[:, np.newaxis] * np.full(SHAPE[1], 1.0 / SHAPE[1]))
EXCESSES = frozen(np.zeros((*SHAPE, 2)))
COVARIANCES = frozen(np.tile(np.diag((EXCESS_W**2, CONSUMPTION**2)), (*SHAPE, 1, 1)))


class PowerResponse(NamedTuple):
    """
    The battery's power beyond the route plan, as evidence on the heater.

    `prior` (heaters,) is the probability of each heater without evidence, `weights` (heaters, lags) that with the
    evidence of the power. `excess` (heaters, lags, 2) is the rest beyond plan and heater, a power [W] and a share
    of the propulsion; `covariance` is its own. The scatter of blocks is `scatter_w2` [W^2], from `blocks`, and
    `before_w` [W] is the latest one's power that the heater does not explain. `followed_w` (lags,) is the current
    power of a heater with each lag [W]; None: no command yet.
    """

    prior: FloatArray = PRIOR
    weights: FloatArray = WEIGHTS
    excess: FloatArray = EXCESSES
    covariance: FloatArray = COVARIANCES
    scatter_w2: float = SCATTER_W**2
    blocks: float = SCATTER_BLOCKS
    before_w: float | None = None
    followed_w: FloatArray | None = None
    block: _Block = _Block()

    def paused(self) -> PowerResponse:
        """Return the response while power or plan is unknown; earlier evidence stays."""
        return self._replace(before_w=None, followed_w=None, block=_Block())

    def of_another_route(self) -> PowerResponse:
        """Return the response whose consumption is as uncertain as that of a new route."""
        excess, covariance = self.excess.copy(), self.covariance.copy()
        excess[..., 1], covariance[..., 1, :], covariance[..., 1] = 0.0, 0.0, 0.0
        covariance[..., 1, 1] = CONSUMPTION**2
        return self._replace(excess=frozen(excess), covariance=frozen(covariance))

    def seen(self, duration_s: float, beyond_plan_w: float, propulsion_w: float, command_w: float, limit_w: float,
             heaters: FloatArray) -> tuple[PowerResponse, FloatArray | None]:
        """
        Return the response to the battery's power beyond the plan [W] over `duration_s` [s], under a command [W].

        `propulsion_w` is the planned power of propulsion [W], `limit_w` the heater's maximum power [W], and
        `heaters` the probability of each kind by all evidence. With it the log-likelihoods (heaters,) of a
        completed block; else None.
        """
        behind_w = 0.0 if self.followed_w is None else self.followed_w - command_w
        left = array_exp(-duration_s / HEATER_LAGS_S)
        mean_share = (1.0 - left) * HEATER_LAGS_S / duration_s
        block = _Block(
            self.block.lasted_s + duration_s, self.block.beyond_ws + duration_s * beyond_plan_w,
            self.block.propulsion_ws + duration_s * propulsion_w,
            self.block.limit_ws + duration_s * limit_w,
            frozen(self.block.taken_ws + duration_s * (command_w + behind_w * mean_share)))
        response = self._replace(followed_w=frozen(command_w + behind_w * left), block=block)
        return (response, None) if block.lasted_s < POWER_BLOCK_S - 0.5 else response._of_next_block(heaters)

    def _of_next_block(self, heaters: FloatArray) -> tuple[PowerResponse, FloatArray]:
        """Return the response after its block, and the log-likelihoods (heaters,)."""
        lasted_s, beyond_ws, propulsion_ws, limit_ws, taken_ws = self.block
        beyond_w, limit_w = beyond_ws / lasted_s, limit_ws / lasted_s
        heater_w = np.minimum(np.multiply.outer(SHARES, taken_ws / lasted_s), limit_w)
        heater_w[STUCK] = limit_w
        # The heaters' filters are mixed, because a heater may have changed from one kind to another. Evidence of
        # the temperature counts for that of a fault: power that a healthy heater left unexplained does not tell a
        # later fault. It does not for a healthy heater's: a sensor that is stuck looks like a fault, too.
        # share[from, to, lag]: how much of `to` was `from` before.
        matrix = transitions(lasted_s)
        before = matrix.T @ self.weights
        share = matrix[:, :, np.newaxis] * (
            self.weights * (heaters / self.weights.sum(axis=1))[:, np.newaxis])[:, np.newaxis]
        share[:, HEALTHY] = matrix[:, HEALTHY, np.newaxis] * self.weights
        share /= share.sum(axis=0)
        mean = (share[..., np.newaxis] * self.excess[:, np.newaxis]).sum(axis=0)
        off = self.excess[:, np.newaxis] - mean
        covariance = (share[..., np.newaxis, np.newaxis] * (
            self.covariance[:, np.newaxis] + off[..., np.newaxis, :] * off[..., np.newaxis])).sum(axis=0)
        left = np.array([math.exp(-lasted_s / ROAD_LASTS_S), 1.0])
        mean, covariance = left * mean, np.multiply.outer(left, left) * covariance
        covariance[..., 0, 0] += (1.0 - left[0]**2) * EXCESS_W**2
        weighed = np.array([1.0, propulsion_ws / lasted_s])
        shown = covariance @ weighed
        total_w2 = shown @ weighed + self.scatter_w2
        error_w = beyond_w - heater_w - mean @ weighed
        logs = (-0.5 * array_log(total_w2)
                - 0.5 * (FREEDOM + 1.0) * array_log(1.0 + error_w**2 / (FREEDOM * total_w2)))
        most = logs.max()
        logs = np.maximum(logs - most, -MOST_BLOCK_EVIDENCE)
        gain = shown / total_w2[..., np.newaxis]
        weights = before * array_exp(logs)
        rest_w = beyond_w - float((weights * heater_w).sum() / weights.sum())
        seen: FloatArray = most + array_log(weights.sum(axis=1) / before.sum(axis=1))
        return PowerResponse(
            frozen(self.prior @ matrix), frozen(np.maximum(weights / weights.sum(), LEAST_WEIGHT)),
            frozen(mean + gain * error_w[..., np.newaxis]),
            frozen(covariance - gain[..., np.newaxis] * shown[..., np.newaxis, :]), *self._scatter(rest_w), rest_w,
            self.followed_w), seen

    def _scatter(self, rest_w: float) -> tuple[float, float]:
        """Return scatter [W^2] and number of blocks after the power that the heater does not explain [W]."""
        if self.before_w is None:
            return self.scatter_w2, self.blocks
        blocks = self.blocks + 1.0
        seen_w2 = 0.5 * CORRELATED * (rest_w - self.before_w)**2
        share = max(POWER_BLOCK_S / ROAD_LASTS_S, 1.0 / blocks)
        return max(self.scatter_w2 + share * (seen_w2 - self.scatter_w2), LEAST_SCATTER_W**2), blocks

    def support(self, kind: Heater) -> float:
        """Return the log-likelihood ratio of a kind of heater over a healthy one, from the power [nats]."""
        weights = self.weights.sum(axis=1)
        of_kind = [number for number, own in enumerate(HEATERS) if own is kind]
        return math.log(float(weights[of_kind].sum() / weights[HEALTHY])
                        / float(self.prior[of_kind].sum() / self.prior[HEALTHY]))
