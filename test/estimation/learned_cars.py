# SPDX-License-Identifier: Apache-2.0
"""Learned values of a car, for the tests of memory and state file."""

import numpy as np

from bev_preheat.estimation.estimate import Estimate, FACTORS, SIZE, SOC, TEMPERATURE
from bev_preheat.estimation.hypotheses import Heater, HeaterReport
from bev_preheat.estimation.prior import LAGS, prior_factor_covariance

FACTORS_SEEN = np.array([0.07, -0.2, 0.11, -0.03, 0.4])
LAGS_SEEN, LAG_VARIANCES_SEEN = np.array([0.6, -0.9]), np.array([0.04, 0.2])


def some_covariance():
    """Return a covariance smaller than the prior's, with correlations."""
    deviations = 0.3 * np.sqrt(np.diag(prior_factor_covariance()))
    correlation = 0.25 * np.ones((5, 5)) + 0.75 * np.eye(5)
    return correlation * np.outer(deviations, deviations)


def an_estimate(covariance=None, heater=Heater.ANSWERS):
    """Return an Estimate with FACTORS_SEEN and LAGS_SEEN."""
    mean, whole = np.zeros(SIZE), np.eye(SIZE)
    mean[[TEMPERATURE, SOC]], mean[FACTORS], mean[[*LAGS]] = (12.0, 0.7), FACTORS_SEEN, LAGS_SEEN
    whole[FACTORS, FACTORS] = some_covariance() if covariance is None else covariance
    whole[LAGS, LAGS] = LAG_VARIANCES_SEEN
    return Estimate(0, mean, whole, HeaterReport(heater, 1.0, 1.0), 0.0)
