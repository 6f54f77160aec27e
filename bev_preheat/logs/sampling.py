# SPDX-License-Identifier: Apache-2.0
"""How often a signal was sampled, and its gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.logs.recording import Series
    from bev_preheat.numerics.arrays import BoolArray

# An interval is a gap if it is this many times the usual one, and longer than LEAST_GAP_S. In a log whose
# intervals
# mostly are the same, a single missing sample is a gap.
GAP_TIMES, REGULAR_GAP_TIMES, LEAST_GAP_S = 2.5, 1.9, 1.5
REGULAR_SHARE, REGULAR_DEVIATION = 0.6, 0.05


@dataclass(frozen=True)
class Sampling:
    """Usual interval of the samples [s] (NaN: fewer than two); number of gaps; the longest and its start [s]."""

    interval_s: float
    gaps: int
    longest_gap_s: float
    longest_gap_at_s: float


def shortest_gap_s(series: Series) -> float:
    """Return the length from which on an interval is a gap [s]."""
    if len(series.time_s) < 2:
        return np.inf
    steps_s = np.diff(series.time_s)
    usual_s = float(np.median(steps_s))
    regular = np.mean(np.abs(steps_s - usual_s) <= REGULAR_DEVIATION * usual_s) >= REGULAR_SHARE
    return max(LEAST_GAP_S, (REGULAR_GAP_TIMES if regular else GAP_TIMES) * usual_s)


def gaps(series: Series) -> BoolArray:
    """Return which intervals between samples are gaps, shape (N - 1,)."""
    return np.diff(series.time_s) > shortest_gap_s(series)


def sampling(series: Series) -> Sampling:
    """Return the Sampling of a signal."""
    if len(series.time_s) < 2:
        return Sampling(np.nan, 0, 0.0, 0.0)
    steps_s, gap = np.diff(series.time_s), gaps(series)
    at = int(np.argmax(steps_s))
    return Sampling(float(np.median(steps_s)), int(gap.sum()), float(steps_s[at]) if gap.any() else 0.0,
                    float(series.time_s[at]))
