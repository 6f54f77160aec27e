# SPDX-License-Identifier: Apache-2.0
"""
The identified vehicle's Uncertainty: 90 % intervals as standard deviations of the estimation's factors.

The factors' logarithms are taken as normal and independent. The fit's correlations (a heavier battery with more
heat from its resistance) only make predictions surer than that.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.identification.uncertainty import QUANTILE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from bev_preheat.identification.result import Estimated, ResistanceCurve
    from bev_preheat.vehicle.description import Uncertainty

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

    `start` is that of START, which values keep that the logs do not tell. `resistance` is None if the logs do not
    tell it. `speed_mps` is the mean speed of the drives: the factor on the leakage is one on both of its parts.
    """
    by_name = {item.name: item for item in estimates}
    found = {factor: _log_deviation(by_name[name].low, by_name[name].high) for factor, name in (
        ('heat_capacity', 'heat_capacity'), ('heater_efficiency', 'heater_efficiency'))
        if name in by_name and by_name[name].is_identified}
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
    return replace(start, **{name: float(f'{min(max(value, LEAST), MOST):.3g}')
                             for name, value in found.items()})


def _log_deviation(low: float, high: float) -> float:
    """Return the standard deviation of the logarithm of a value with this 90 % interval."""
    return math.log(max(high, TINY) / max(low, TINY)) / (2.0 * QUANTILE)
