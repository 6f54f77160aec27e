# SPDX-License-Identifier: Apache-2.0
"""Distance driven by the readings of an odometer, and the place that it gives on a route without coordinates."""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.line import Cause, Match
from bev_preheat.route.place_belief import FASTEST_MPS, ODOMETER_DEVIATION

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


class OdometerPlace:
    """
    Distance along a route of `length_m` [m] by an odometer, which starts at a reading.

    `start_m` [m] is the reading at the start of the route; None: its first reading, because the trip begins now.
    The place is lost if the count is reset.
    """

    def __init__(self, length_m: float, start_m: float | None) -> None:
        self.odometer = Odometer()
        self._length_m, self._start_m = length_m, start_m
        self._start: Reading | None = None
        self.match = Match(Cause.SILENT, 'No reading of the odometer has arrived yet', 0)

    def take(self, stamp_ns: int, reading_m: float) -> Match:
        """Return the Match of a reading [m], and keep it as `match`."""
        if not self.odometer.read(stamp_ns, reading_m):
            return Match(Cause.OVERTAKEN, f'The odometer reads {reading_m:g} m; it must be finite, and later than '
                         'the reading before', stamp_ns)
        latest = self.odometer.latest
        if self._start is None and latest is not None:
            self._start = latest if self._start_m is None else latest._replace(distance_m=self._start_m)
        self.match = self._match(stamp_ns, reading_m, driven_m(self._start, latest))
        return self.match

    def _match(self, stamp_ns: int, reading_m: float, moved_m: float | None) -> Match:
        if moved_m is None:
            return Match(Cause.UNCERTAIN, 'The odometer was reset or has jumped; the place is lost until the next '
                         'route', stamp_ns)
        if self._start_m is not None and reading_m < self._start_m:
            return Match(Cause.UNCERTAIN, f'The odometer reads {reading_m:.0f} m, less than the '
                         f'{self._start_m:.0f} m at the start of the route', stamp_ns)
        deviation_m = ODOMETER_DEVIATION * moved_m
        if moved_m > self._length_m + deviation_m:
            return Match(Cause.ARRIVED, f'{moved_m - self._length_m:.0f} m beyond the end of the route', stamp_ns)
        return Match(Cause.RECKONED, f'{moved_m / 1000:.2f} km from the start by the odometer', stamp_ns,
                     min(moved_m, self._length_m), deviation_m)
