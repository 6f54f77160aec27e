# SPDX-License-Identifier: Apache-2.0
"""Instants of readings on a steady clock: steps of the system's clock change no age."""

from __future__ import annotations

import time

# A stamp this far from the system's clock is another clock's: some adapters count from their own start [s].
FAR_S = 3600.0


def steady_s() -> float:
    """Return the seconds since the computer started, including those in which it slept."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def age_of_stamp(stamp_s: float | None, wall_s: float | None = None) -> float:
    """
    Return the age [s] of something stamped by the system's clock [s since the epoch], at least 0.

    A stamp that is not of this clock, or none, has the age 0.
    """
    if stamp_s is None or not stamp_s:
        return 0.0
    age_s = (time.time() if wall_s is None else wall_s) - stamp_s
    return age_s if 0.0 <= age_s <= FAR_S else 0.0
