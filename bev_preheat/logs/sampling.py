# SPDX-License-Identifier: Apache-2.0
"""How often a signal was sampled, and its gaps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bev_preheat.logs.recording import Series
    from bev_preheat.numerics.arrays import BoolArray

# An interval is a gap if it is this many times the usual one, and longer than LEAST_GAP_S.
GAP_TIMES, LEAST_GAP_S = 2.5, 1.5


@dataclass(frozen=True)
class Sampling:
    """Usual interval of the samples [s] (NaN: fewer than two), and number, longest and start of the longest gap [s]."""

    interval_s: float
    gaps: int
    longest_gap_s: float
    longest_gap_at_s: float


def shortest_gap_s(series: Series) -> float:
    """Return the length from which on an interval is a gap [s]."""
    return max(LEAST_GAP_S, GAP_TIMES * float(np.median(np.diff(series.time_s)))) if len(series.time_s) > 1 else np.inf


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
