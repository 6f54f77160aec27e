# SPDX-License-Identifier: Apache-2.0
"""A bang-bang rule: a battery that is below the target is heated for the last minutes before arrival."""

import numpy as np

import bev_preheat as bp


def heat_last(situation: bp.MethodSituation, minutes: float) -> np.ndarray:
    """Return the heater's power in each step [W], shape (N,): full power for the last minutes, or none."""
    if situation.state.temperature_c >= situation.goal.target_temperature_c:
        return np.zeros_like(situation.heater_limit_w)
    return situation.full_power(situation.time_s[-1] - 60.0 * minutes)


def last_10_minutes(situation: bp.MethodSituation) -> np.ndarray:
    """Heat for the last 10 minutes."""
    return heat_last(situation, 10.0)


def last_20_minutes(situation: bp.MethodSituation) -> np.ndarray:
    """Heat for the last 20 minutes."""
    return heat_last(situation, 20.0)


def last_30_minutes(situation: bp.MethodSituation) -> np.ndarray:
    """Heat for the last 30 minutes."""
    return heat_last(situation, 30.0)
