# SPDX-License-Identifier: Apache-2.0
"""Distance driven between two instants, from the readings of an odometer."""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.route.place_belief import FASTEST_MPS

# A reading is valid for an instant this much before or after it [s]: two readings a second at 60 m/s apart.
VALID_S = 2.0
# Readings kept; at 100 Hz, twice VALID_S.
KEPT = 400
# A reading that falls by more [m], or rises faster than the vehicle drives and by more, starts another series.
ODOMETER_JUMP_M = 50.0


class Reading(NamedTuple):
    """A reading [m] at an instant [ns]; readings of different series cannot be subtracted."""

    stamp_ns: int
    distance_m: float
    series: int


class Odometer:
    """Readings of an odometer, at whatever offset; a reset or a jump starts another series."""

    def __init__(self) -> None:
        """Start without a reading."""
        self._readings: deque[Reading] = deque(maxlen=KEPT)

    @property
    def latest(self) -> Reading | None:
        """The latest reading; None before the first."""
        return self._readings[-1] if self._readings else None

    def read(self, stamp_ns: int, distance_m: float) -> bool:
        """Take a reading [m]; return whether it was valid: finite, and later than the one before."""
        latest = self.latest
        if not math.isfinite(distance_m) or (latest is not None and stamp_ns <= latest.stamp_ns):
            return False
        series = 0
        if latest is not None:
            most_m = FASTEST_MPS * (stamp_ns - latest.stamp_ns) / NS_PER_S + ODOMETER_JUMP_M
            gain_m = distance_m - latest.distance_m
            series = latest.series if -ODOMETER_JUMP_M <= gain_m <= most_m else latest.series + 1
        self._readings.append(Reading(stamp_ns, distance_m, series))
        return True

    def at(self, stamp_ns: int) -> Reading | None:
        """Return the reading at an instant [ns], interpolated; None without a reading nearby."""
        before = after = None
        for reading in reversed(self._readings):
            if reading.stamp_ns <= stamp_ns:
                before = reading
                break
            after = reading
        near = [reading for reading in (before, after) if reading is not None
                and abs(reading.stamp_ns - stamp_ns) <= VALID_S * NS_PER_S]
        if not near:
            return None
        if len(near) == 1 or near[0].series != near[1].series:
            return near[0]
        share = (stamp_ns - near[0].stamp_ns) / (near[1].stamp_ns - near[0].stamp_ns)
        return Reading(stamp_ns, near[0].distance_m + share * (near[1].distance_m - near[0].distance_m),
                       near[0].series)


def driven_m(since: Reading | None, until: Reading | None) -> float | None:
    """Return the distance [m] between two readings; None if it is not known."""
    if since is None or until is None or since.series != until.series:
        return None
    return max(until.distance_m - since.distance_m, 0.0)
