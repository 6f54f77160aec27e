# SPDX-License-Identifier: Apache-2.0
"""
Intervals of the parameters: a bootstrap over whole trips, and profile likelihoods; the vehicle's Uncertainty.

Residuals are correlated within a trip, so whole trips are drawn. Each draw takes one Gauss-Newton step from the
optimum, with the trips' gradients and information in the draw's numbers; the priors' centres vary as the
priors say.

The Uncertainty has the intervals as standard deviations of the estimation's factors, whose logarithms are taken
as normal and independent: the fit's correlations only make predictions surer than that.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
import math
from typing import NamedTuple, TYPE_CHECKING

import numpy as np

from bev_preheat.identification.parameters import NAMES
from bev_preheat.identification.trips import LEAST_TRIPS

if TYPE_CHECKING:
    from bev_preheat.identification.fit import Fitter, ThermalFit
    from bev_preheat.identification.result import Estimated, ResistanceCurve
    from bev_preheat.vehicle.description import Uncertainty

DRAWS = 2000
SEED = 20240117
# Probability of the intervals, and its quantile of the normal distribution.
PROBABILITY, QUANTILE = 0.90, 1.6449
# Two lags stand for heater, coolant, plates and sensor. The error of that shows in no residual, so it is added to
# the deviations of the coordinates.
SYSTEMATIC_DEVIATIONS = {'heat_lag': 0.05, 'sensor_lag': 0.1}
# An interval wider than this share of the prior's shows nothing new.
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


def bootstrap_intervals(fit: ThermalFit) -> dict[int, Interval]:
    """Return the Intervals of free coordinates by index, from drawn trips; of too few trips, those of the fit."""
    centre, count = fit.theta[fit.free], len(fit.gradients)
    if count < LEAST_TRIPS:
        reach = QUANTILE * np.sqrt(np.diag(np.linalg.inv(fit.information)))
        ends = np.stack((centre - reach, centre + reach))
    else:
        generator = np.random.default_rng(SEED)
        prior_root = np.linalg.cholesky(fit.prior_precision)
        # A draw of n of n trips varies too little by this factor.
        widen = math.sqrt(count / max(count - 1.0, 1.0))
        weights = generator.multinomial(count, np.full(count, 1.0 / count), DRAWS).astype(float)
        centres = generator.standard_normal((DRAWS, len(prior_root))) @ prior_root.T
        pull = (widen * (weights - 1.0)) @ fit.gradients + centres
        whole = np.einsum('di,ijk->djk', weights, fit.informations) + fit.prior_precision
        drawn = centre - np.linalg.solve(whole, pull[..., np.newaxis])[..., 0]
        ends = np.quantile(drawn, [0.5 - 0.5 * PROBABILITY, 0.5 + 0.5 * PROBABILITY], axis=0)
    return {at: Interval(*pair) for at, pair in zip(np.flatnonzero(fit.free).tolist(), ends.T.tolist())}


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
            cost = fitter.fit(fit.structure, fit.electrical, near, {name: coordinate}).cost
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
    drawn, found = bootstrap_intervals(fit), {}
    for at, name in enumerate(NAMES):
        if at not in drawn:
            continue
        profile, own = profile_interval(fitter, fit, name), drawn[at]
        parameter, systematic = fitter.parameters[name], QUANTILE * SYSTEMATIC_DEVIATIONS.get(name, 0.0)
        below, above = (math.hypot(reach, systematic) for reach in (
            fit.theta[at] - min(profile.low, own.low), max(profile.high, own.high) - fit.theta[at]))
        estimate = float(fit.theta[at])
        found[name] = Interval(max(estimate - below, parameter.low), min(estimate + above, parameter.high))
    return found


def wider(fitter: Fitter, intervals: dict[str, Interval], fit: ThermalFit) -> dict[str, Interval]:
    """Return Intervals that also contain those of a fit with held parameters, or of another structure."""
    drawn, found = bootstrap_intervals(fit), {}
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


# Battery temperatures [deg C] of drives on which heating may pay. The estimation has one factor on the resistance
# at all temperatures, so its variance is the mean over these, including those that no log covers.
DRIVEN_C = (-10.0, 20.0)
# Bounds of the vehicle file.
LEAST, MOST = 0.005, 1.0
# Least value in the logarithm of an interval's end: an interval may begin at 0.
TINY = 1e-9


def uncertainty_of(start: Uncertainty, estimates: Iterable[Estimated], resistance: ResistanceCurve | None,
                   speed_mps: float) -> Uncertainty:
    """
    Return the Uncertainty of an identified vehicle file.

    `start` is that of START, which values keep that the logs do not give. `resistance` is None if the logs do not
    give it. `speed_mps` is the mean speed of the drives: the factor on the leakage is one on both of its parts.
    """
    by_name = {item.name: item for item in estimates}
    found = {name: _log_deviation(item.low, item.high) for name, item in by_name.items()
             if name in ('heat_capacity', 'heater_efficiency') and item.is_identified}
    at_stand, with_speed = by_name['leakage'], by_name['leakage_with_speed']
    if at_stand.is_identified:
        found['leakage'] = math.hypot(
            at_stand.estimate * _log_deviation(at_stand.low, at_stand.high),
            speed_mps * (with_speed.high - with_speed.low) / (2.0 * QUANTILE)) / (
                at_stand.estimate + speed_mps * with_speed.estimate)
    if resistance is not None:
        low_c, high_c = DRIVEN_C
        driven = (resistance.temperature_c >= low_c) & (resistance.temperature_c <= high_c)
        if driven.any():
            logs = np.log(resistance.high_ohm[driven] / resistance.low_ohm[driven]) / (2.0 * QUANTILE)
            found['resistance'] = math.sqrt(np.mean(logs**2))
    return with_deviations(start, found)


def with_deviations(start: Uncertainty, found: Mapping[str, float]) -> Uncertainty:
    """Return an Uncertainty with other relative deviations by name, rounded and within the file's bounds."""
    return replace(start, **{name: float(f'{min(max(value, LEAST), MOST):.3g}') for name, value in found.items()})


def _log_deviation(low: float, high: float) -> float:
    """Return the standard deviation of the logarithm of a value with this 90 % interval."""
    return math.log(max(high, TINY) / max(low, TINY)) / (2.0 * QUANTILE)
