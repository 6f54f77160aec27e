# SPDX-License-Identifier: Apache-2.0
"""The vehicle's place on a route without coordinates: the odometer since the start."""

from __future__ import annotations

from bev_preheat.route.line import Cause, Match
from bev_preheat.route.odometer import driven_m, Odometer, Reading
from bev_preheat.route.place_belief import ODOMETER_DEVIATION


class OdometerPlace:
    """
    Distance along a route of `length_m` [m] by an odometer, which starts at a reading.

    `start_m` [m] is the reading at the start of the route; None: its first reading, because the trip begins now.
    The place is lost if the count is reset.
    """

    def __init__(self, length_m: float, start_m: float | None) -> None:
        """Begin without a reading."""
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
