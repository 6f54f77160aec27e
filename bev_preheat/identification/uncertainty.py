# SPDX-License-Identifier: Apache-2.0
"""
Intervals of the parameters: a bootstrap over whole trips, and profile likelihoods.

Residuals are correlated within a trip, so whole trips are drawn. Each draw takes one Gauss-Newton step from the
optimum, with the trips' gradients and information in the draw's numbers; the priors' centres vary as the
priors say.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.identification.parameters import NAMES

if TYPE_CHECKING:
    from bev_preheat.identification.fit import Fitter, ThermalFit
    from bev_preheat.numerics.arrays import FloatArray

DRAWS = 2000
SEED = 20240117
# Probability of the intervals, and its quantile of the normal distribution.
PROBABILITY, QUANTILE = 0.90, 1.6449
# Two lags stand for heater, coolant, plates and sensor. The error of that shows in no residual, so it is added to
# the deviations of the coordinates.
SYSTEMATIC_DEVIATIONS = {'heat_lag': 0.05, 'sensor_lag': 0.1}
# An interval wider than this share of the prior's tells nothing new.
MOST_OF_PRIOR = 0.75
# Rise of half the sum of squares at the ends of a profile interval.
RISE = 0.5 * QUANTILE**2
MOST_PROFILE_STEPS = 5
# An end is found if the rise is this close to RISE.
RISE_TOLERANCE = 0.15


class Interval(NamedTuple):
    """Ends of a 90 % interval in the parameter's coordinate."""

    low: float
    high: float


def bootstrap(fit: ThermalFit) -> FloatArray:
    """Return drawn coordinates (DRAWS, free)."""
    generator = np.random.default_rng(SEED)
    count = len(fit.terms)
    gradients = np.array([term.gradient for term in fit.terms])
    information = np.array([term.information for term in fit.terms])
    prior_root = np.linalg.cholesky(fit.prior_precision)
    # A draw of n of n trips varies too little by this factor.
    widen = math.sqrt(count / max(count - 1.0, 1.0))
    weights = generator.multinomial(count, np.full(count, 1.0 / count), DRAWS).astype(float)
    centres = generator.standard_normal((DRAWS, len(prior_root))) @ prior_root.T
    pull = (widen * (weights - 1.0)) @ gradients + centres
    whole = np.einsum('di,ijk->djk', weights, information) + fit.prior_precision
    return np.asarray(fit.theta[fit.free] - np.linalg.solve(whole, pull[..., np.newaxis])[..., 0])


def bootstrap_intervals(fit: ThermalFit) -> list[Interval]:
    """Return the Intervals of the free coordinates by `bootstrap`."""
    ends = np.quantile(bootstrap(fit), [0.5 - 0.5 * PROBABILITY, 0.5 + 0.5 * PROBABILITY], axis=0)
    return [Interval(*pair) for pair in ends.T.tolist()]


def profile_interval(fitter: Fitter, fit: ThermalFit, name: str) -> Interval:
    """Return the Interval of a thermal parameter within which the best fit costs at most RISE more."""
    at = NAMES.index(name)
    parameter = fitter.parameters[name]
    inverse, place = np.linalg.inv(fit.information), np.flatnonzero(fit.free).tolist().index(at)
    deviation = math.sqrt(inverse[place, place])
    # The other coordinates follow it, to first order.
    along = np.zeros(len(fit.theta))
    along[fit.free] = inverse[:, place] / inverse[place, place]
    ends = []
    for side, bound in ((-1.0, parameter.low), (1.0, parameter.high)):
        reach = QUANTILE * deviation
        for _ in range(MOST_PROFILE_STEPS):
            coordinate = fit.theta[at] + side * reach
            if (coordinate - bound) * side >= 0.0:
                coordinate = bound
            near = replace(fit, theta=fit.theta + along * (coordinate - fit.theta[at]))
            cost = fitter.fit(fit.structure, None, fit.electrical, near, {name: coordinate}).cost
            # A held parameter has no prior in the fit's cost.
            cost += 0.5 * ((coordinate - parameter.prior) / parameter.deviation)**2
            rise = max(cost - fit.cost, 1e-6)
            if abs(rise / RISE - 1.0) < RISE_TOLERANCE or (coordinate == bound and rise < RISE):
                break
            reach = abs(coordinate - fit.theta[at]) * min(max(math.sqrt(RISE / rise), 0.4), 2.5)
        ends.append(float(coordinate))
    return Interval(*ends)


def intervals_of(fitter: Fitter, fit: ThermalFit) -> dict[str, Interval]:
    """Return the Intervals of the free thermal parameters: the wider of bootstrap and profile at each end."""
    drawn = dict(zip(np.flatnonzero(fit.free).tolist(), bootstrap_intervals(fit)))
    found = {}
    for at, name in enumerate(NAMES):
        if not fit.free[at]:
            continue
        profile, own = profile_interval(fitter, fit, name), drawn[at]
        parameter, systematic = fitter.parameters[name], QUANTILE * SYSTEMATIC_DEVIATIONS.get(name, 0.0)
        below, above = (math.hypot(reach, systematic) for reach in (
            fit.theta[at] - min(profile.low, own.low), max(profile.high, own.high) - fit.theta[at]))
        estimate = float(fit.theta[at])
        found[name] = Interval(max(estimate - below, parameter.low), min(estimate + above, parameter.high))
    return found


def wider(fitter: Fitter, intervals: dict[str, Interval], fit: ThermalFit) -> dict[str, Interval]:
    """Return Intervals that also contain those of a fit that holds some of the parameters."""
    drawn, found = dict(zip(np.flatnonzero(fit.free).tolist(), bootstrap_intervals(fit))), {}
    for name, interval in intervals.items():
        parameter, own = fitter.parameters[name], drawn.get(NAMES.index(name), interval)
        found[name] = Interval(max(min(interval.low, own.low), parameter.low),
                               min(max(interval.high, own.high), parameter.high))
    return found


def correlations(fit: ThermalFit) -> list[tuple[str, str, float]]:
    """Return (name, name, correlation) of thermal parameters known only together: magnitude at least 0.8."""
    inverse = np.linalg.inv(fit.information)
    deviations = np.sqrt(np.diag(inverse))
    ratios = inverse / np.outer(deviations, deviations)
    names = [NAMES[at] if at < len(NAMES) else '' for at in np.flatnonzero(fit.free).tolist()]
    return [(names[i], names[j], float(ratios[i, j])) for i in range(len(names)) for j in range(i)
            if names[i] and names[j] and abs(ratios[i, j]) >= 0.8]
