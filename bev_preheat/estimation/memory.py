# SPDX-License-Identifier: Apache-2.0
"""Learned values of a car, as the prior of its next drive, and their form in the state file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.errors import InvalidInput
from bev_preheat.estimation.hypotheses import Heater
from bev_preheat.estimation.prior import FACTOR_BOUNDS, LAG_BOUNDS, LAGS, Lags, Learned, prior_factor_covariance
from bev_preheat.estimation.state import FACTOR_NAMES, FACTORS, PROPULSION
from bev_preheat.tunables import LAG_DEVIATION, LEAST_VARIANCE, OVERNIGHT

if TYPE_CHECKING:
    from bev_preheat.estimation.estimate import Estimate
    from bev_preheat.files.checked_yaml import FileData
    from bev_preheat.numerics.arrays import FloatArray

# The consumption error of one route says little about the next.
REMEMBERED = slice(0, PROPULSION - FACTORS.start)
NAMES = FACTOR_NAMES[REMEMBERED]
LAG_NAMES = ('heat', 'sensor')
# Keys of an entry; the first two are mandatory, the others are present if the lags were learned.
KEYS = ('log_factors', 'covariance', 'log_lags', 'lag_variances')


def learned_from(estimate: Estimate) -> Learned:
    """Return the Learned of an Estimate."""
    bounds = np.array([FACTOR_BOUNDS[index] for index in range(FACTORS.start, FACTORS.stop)])
    # A mean over filters at a bound may exceed it by rounding.
    factors = np.clip(estimate.mean[FACTORS], -bounds, bounds)
    covariance = estimate.covariance[FACTORS, FACTORS].copy()
    prior = prior_factor_covariance()
    route = PROPULSION - FACTORS.start
    factors[route] = 0.0
    covariance[route, :] = covariance[:, route] = 0.0
    covariance[route, route] = prior[route, route]
    # The variance of a car that was hardly seen grows, but never beyond the prior's.
    shrink = np.sqrt(np.minimum(1.0, np.diag(prior) / np.diag(covariance)))
    return Learned(factors, covariance * np.outer(shrink, shrink), _lags_from(estimate))


def _lags_from(estimate: Estimate) -> Lags | None:
    """Return the Lags of an Estimate; None: a faulty heater gives no information about them."""
    if estimate.heater.heater is not Heater.ANSWERS:
        return None
    return Lags(np.clip(estimate.mean[[*LAGS]], LAG_BOUNDS[:, 0], LAG_BOUNDS[:, 1]),
                np.minimum(np.diag(estimate.covariance)[[*LAGS]], LAG_DEVIATION**2))


def as_entry(learned: Learned) -> dict[str, FileData]:
    """Return the stored part of a Learned as plain values for JSON."""
    entry = {'log_factors': dict(zip(NAMES, learned.factors[REMEMBERED].tolist())),
             'covariance': learned.covariance[REMEMBERED, REMEMBERED].tolist()}
    if learned.lags is not None:
        entry['log_lags'] = dict(zip(LAG_NAMES, learned.lags.logs.tolist()))
        entry['lag_variances'] = dict(zip(LAG_NAMES, learned.lags.variances.tolist()))
    return entry


def from_entry(entry: FileData) -> Learned:
    """
    Return the Learned of an entry, with the uncertainty of one night added.

    Raises InvalidInput, naming the value and its valid range.
    """
    try:
        logs = np.array([entry['log_factors'][name] for name in NAMES], dtype=float)
        covariance = np.array(entry['covariance'], dtype=float)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(f'log_factors or covariance is damaged: {error}') from error
    _check(logs, covariance)
    factors, whole = np.zeros(len(FACTOR_NAMES)), prior_factor_covariance()
    factors[REMEMBERED] = logs
    whole[REMEMBERED, REMEMBERED] = covariance + OVERNIGHT**2 * np.eye(len(NAMES))
    return Learned(factors, whole, _lags_of(entry))


def _lags_of(entry: dict[str, FileData]) -> Lags | None:
    """Return the Lags of an entry, with the uncertainty of one night added; None if it has none."""
    if 'log_lags' not in entry and 'lag_variances' not in entry:
        return None
    try:
        logs, variances = (np.array([entry[key][name] for name in LAG_NAMES], dtype=float)
                           for key in ('log_lags', 'lag_variances'))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(f'log_lags or lag_variances is damaged: {error}') from error
    for name, value, (low, high) in zip(LAG_NAMES, logs, LAG_BOUNDS):
        if not low <= value <= high:
            raise InvalidInput(f'log_lags.{name}: {value:g} is not allowed; it must be '
                               f'{low:.3f} ... {high:.3f}')
    most = LAG_DEVIATION**2
    for name, value in zip(LAG_NAMES, variances):
        if not 0.0 <= value <= most:
            raise InvalidInput(f'lag_variances.{name}: {value:g} is not allowed; it must be '
                               f'0 ... {most:g}')
    return Lags(logs, np.minimum(variances + OVERNIGHT**2, most))


def _check(logs: FloatArray, covariance: FloatArray) -> None:
    size = len(NAMES)
    bounds = [FACTOR_BOUNDS[FACTORS.start + index] for index in range(size)]
    for name, value, bound in zip(NAMES, logs, bounds):
        if not abs(value) <= bound:
            raise InvalidInput(f'log_factors.{name}: {value:g} is not allowed; it must be '
                               f'{-bound:g} ... {bound:g}')
    if covariance.shape != (size, size) or not np.isfinite(covariance).all():
        raise InvalidInput(f'covariance: must be {size} times {size} finite numbers')
    variances = np.diag(covariance)
    most = np.diag(prior_factor_covariance())[REMEMBERED] * (1.0 + 1e-6)
    symmetric = np.allclose(covariance, covariance.T, rtol=1e-6, atol=1e-15)
    if not symmetric or (variances > most).any() or (
            np.linalg.eigvalsh(covariance) < -LEAST_VARIANCE).any():
        raise InvalidInput('covariance: is not positive semidefinite, or exceeds the prior '
                           f'(standard deviations {", ".join(_roots(variances))})')


def _roots(variances: FloatArray) -> list[str]:
    return [f'{math.sqrt(value):.3g}' if value >= 0.0 else 'none' for value in variances]
