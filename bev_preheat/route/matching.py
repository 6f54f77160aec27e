# SPDX-License-Identifier: Apache-2.0
"""
The vehicle's place on its route, from position fixes and an odometer; no place if in doubt.

A belief about the place is followed from fix to fix (place_belief.py). A fix that contradicts it gives no place,
and begins a trial: a second belief, which replaces the first once it has proved itself. So one bad fix costs
nothing, and a vehicle that left the route has to drive along it again before it is back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from bev_preheat.numerics import FloatArray, NS_PER_S
from bev_preheat.route.line import Cause, Fix, MapLine, Match, Nearby, offset_m, unit_vector
from bev_preheat.route.odometer import driven_m, Odometer, Reading
from bev_preheat.route.place_belief import (
    carried_on,
    FASTEST_MPS,
    GATE_DEVIATIONS,
    ODOMETER_DEVIATION,
    Place,
    place_of,
    PlaceBelief,
    updated,
    weighed,
)

# Deviation of a fix that names none, and the least that is used: receivers underrate correlated errors [m].
USUAL_DEVIATION_M, LEAST_DEVIATION_M = 8.0, 3.0
# Deviation of the road from the digitised line: lane, centre line, digitising [m].
LINE_DEVIATION_M = 5.0
# A coarser fix is not used [m]: two such fixes may differ by more than the 100 m that a route_progress may fall.
COARSEST_M = 50.0
# Fixes closer in time show nothing new [s]; the planner needs a place once a second.
SPACED_S = 0.45
# After a longer silence the place is confirmed before it is published [s]: the vehicle may have driven 1.8 km.
GAP_S = 30.0
# A place is published if its pass has at least this probability, and the place at most this deviation [m].
LEAST_PROBABILITY, MOST_DEVIATION_M = 0.99, 50.0
# A place that is less certain than so many fixes has two humps: both sides of a turning point.
WIDEST_DEVIATIONS = 2.0
# A vehicle that falls back by more [m] drives against the route's direction.
TURNED_BACK_M = 40.0
# So many contradicting fixes over this time [s]: the vehicle has left its place, and the fixes are no outliers.
LEFT_FIXES, LEFT_AFTER_S = 3, 5.0
# A trial is confirmed after so many fixes over this time [s]; if the vehicle had left its route, after this
# distance along it [m], in which a road that crosses the route leaves the gate.
CONFIRM_FIXES, CONFIRM_AFTER_S, CONFIRM_AFTER_M = 3, 5.0, 100.0
# A vehicle that has not left its route may stand, within STANDS_M [m] for STANDS_S [s], or has driven ALONG_M [m]
# along the route.
STANDS_M, STANDS_S, ALONG_M = 10.0, 10.0, 50.0
# Meanwhile the fix moves with the place to this many deviations; a road that crosses the route takes it aside.
STEADY_DEVIATIONS = 2.0
# A trip is found at its start as often as anywhere else; its start reaches so far [m].
START_PRIOR, START_REACHES_M = 0.5, 200.0
# Beyond the end of the route the vehicle has arrived if its last place was this close to it [m].
END_M = 100.0
# The course of the vehicle is that over the latest fixes within this distance and time.
COURSE_M, COURSE_S = 25.0, 15.0
# A receiver that holds its position while it stands does so for the length of a red light [s].
USUAL_FROZEN_AFTER_S = 30.0
# The speed is that over this time [s]; noise, bends and the time since then change it by SPEED_DEVIATION_MPS
# [m/s], and no car accelerates faster [m/s^2].
SPEED_OVER_S, SPEED_DEVIATION_MPS, ACCELERATION_MPS2 = 2.0, 10.0, 6.0
# A vehicle faster than this [m/s] moves: its position cannot stay the same to the last digit. For
# SLOW_RECEIVER_S [s] a publisher may repeat the position of a slower receiver.
MOVES_MPS, SLOW_RECEIVER_S = 3.0, 2.0
# An odometer that counts this much meanwhile [m] shows the same.
MOVED_M = 10.0
# The cosine beyond which the course is along the route's direction, or against it: 45 degrees.
ALONG = math.cos(math.radians(45.0))


@dataclass(frozen=True)
class _Track:
    """A belief at its latest fix, and how it began; `furthest_m` is its furthest mean distance [m]."""

    belief: PlaceBelief
    place: Place
    fix: Fix
    odometer: Reading | None
    first_fix: Fix
    first_place: Place
    fixes: int
    furthest_m: float


class Matcher:
    """
    Follows the vehicle along a MapLine.

    `from_start`: the trip begins now, so a vehicle near the start is taken to be there rather than at a later
    place nearby. A position that stays the same to the last digit is used for `frozen_after_s` [s]; as long as
    the odometer stands; and not at all if the vehicle was moving before.
    """

    def __init__(self, line: MapLine, from_start: bool, frozen_after_s: float = USUAL_FROZEN_AFTER_S) -> None:
        self.line, self._from_start, self._frozen_after_s = line, from_start, frozen_after_s
        self._same: Fix | None = None
        self._same_reading: Reading | None = None
        self._was_moving = False
        self.odometer = Odometer()
        self._track: _Track | None = None
        self._trial: _Track | None = None
        self._contradicts = 0
        self._contradicts_since_ns = 0
        self._has_left = False
        self._latest: Fix | None = None
        self._course: list[Fix] = []
        self.match = Match(Cause.SILENT, 'No position has arrived yet', 0)

    def take(self, fix: Fix) -> Match:
        """Return the Match of a fix, and keep it as `match`; within SPACED_S of the last fix it has no place."""
        latest = self._latest
        if latest is not None and fix.stamp_ns <= latest.stamp_ns:
            return Match(Cause.OVERTAKEN, 'The position is not newer than the one before', fix.stamp_ns)
        if latest is not None and fix.stamp_ns - latest.stamp_ns < SPACED_S * NS_PER_S:
            return self.match._replace(stamp_ns=fix.stamp_ns, distance_m=None, deviation_m=None)
        deviation_m = max(USUAL_DEVIATION_M if fix.deviation_m is None else fix.deviation_m, LEAST_DEVIATION_M)
        if deviation_m > COARSEST_M:
            self.match = Match(Cause.COARSE, f'The position has a deviation of {deviation_m:.0f} m; at most '
                               f'{COARSEST_M:.0f} m are used', fix.stamp_ns)
            return self.match
        self._latest = fix
        frozen = self._frozen(fix)
        if frozen is not None:
            self.match = frozen
            return frozen
        self.match = self._matched(fix._replace(deviation_m=math.hypot(deviation_m, LINE_DEVIATION_M)))
        return self.match

    def reckon(self, stamp_ns: int) -> Match | None:
        """Return the place by the odometer since the last confirmed place; None without one."""
        track = self._track
        if track is None or self._has_left or self._contradicts or not _is_clear(track.place):
            return None
        moved_m = driven_m(track.odometer, self.odometer.at(stamp_ns))
        if moved_m is None or stamp_ns <= track.fix.stamp_ns:
            return None
        deviation_m = math.hypot(_deviation_m(track), ODOMETER_DEVIATION * moved_m)
        if deviation_m > MOST_DEVIATION_M or track.place.distance_m + moved_m > self.line.length_m:
            return None
        self.match = Match(Cause.RECKONED, f'{moved_m:.0f} m by the odometer since the last position', stamp_ns,
                           track.place.distance_m + moved_m, deviation_m)
        return self.match

    def _frozen(self, fix: Fix) -> Match | None:
        """Return the Match of a fix that repeats the position before it without evidence of standing, or None."""
        same = self._same
        if same is None or same[1:3] != fix[1:3]:
            self._same, self._same_reading = fix, self.odometer.at(fix.stamp_ns)
            speed_mps = self._speed_mps(fix)
            self._was_moving = speed_mps is not None and speed_mps > MOVES_MPS
            return None
        seconds = (fix.stamp_ns - same.stamp_ns) / NS_PER_S
        moved_m = driven_m(self._same_reading, self.odometer.at(fix.stamp_ns))
        if moved_m is not None and moved_m <= MOVED_M:
            return None
        if moved_m is None and not self._was_moving and seconds <= self._frozen_after_s:
            return None
        if seconds <= SLOW_RECEIVER_S:
            return self.match._replace(stamp_ns=fix.stamp_ns, distance_m=None, deviation_m=None)
        return Match(Cause.FROZEN, f'The position has been the same to the last digit for {seconds:.0f} s',
                     fix.stamp_ns)

    def _speed_mps(self, fix: Fix) -> float | None:
        """Return the vehicle's mean speed [m/s] over at least SPEED_OVER_S before a fix; None: not known."""
        before = [other for other in self._course if fix.stamp_ns - other.stamp_ns >= SPEED_OVER_S * NS_PER_S]
        if not before:
            return None
        return _apart_m(before[-1], fix) / (fix.stamp_ns - before[-1].stamp_ns) * NS_PER_S

    # One fix

    def _matched(self, fix: Fix) -> Match:
        near = self.line.near(fix.latitude_deg, fix.longitude_deg, GATE_DEVIATIONS * _sigma_m(fix))
        self._course = [other for other in self._course
                        if fix.stamp_ns - other.stamp_ns <= COURSE_S * NS_PER_S] + [fix]
        track = self._track
        is_gap = track is None or fix.stamp_ns - track.fix.stamp_ns > GAP_S * NS_PER_S
        if track is not None and not self._has_left and not is_gap:
            followed = self._followed(track, fix, near)
            if followed is not None and followed.furthest_m - followed.place.distance_m <= TURNED_BACK_M:
                self._track, self._trial, self._contradicts = followed, None, 0
                return self._told(followed, fix)
            self._note_contradiction(fix)
        trial = self._trial
        follows = trial is not None and fix.stamp_ns - trial.fix.stamp_ns <= GAP_S * NS_PER_S
        followed = self._followed(trial, fix, near) if trial is not None and follows else None
        if followed is not None and followed.furthest_m - followed.place.distance_m > TURNED_BACK_M:
            followed = None
        if followed is not None and self._aside_m(followed) > STEADY_DEVIATIONS * _sigma_m(fix):
            # The vehicle comes from aside; from here on it may follow the route.
            followed = replace(followed, first_fix=fix, first_place=followed.place, fixes=1)
        if followed is None and len(near.at):
            followed = self._begun(fix, near)
        self._trial = followed
        if followed is not None and (is_gap or self._has_left) and self._is_confirmed(followed):
            self._track, self._trial, self._has_left, self._contradicts = followed, None, False, 0
            return self._told(followed, fix)
        return self._doubt(fix, near)

    def _followed(self, track: _Track, fix: Fix, near: Nearby) -> _Track | None:
        reading = self.odometer.at(fix.stamp_ns)
        seconds = (fix.stamp_ns - track.fix.stamp_ns) / NS_PER_S
        speed_mps = self._speed_mps(track.fix)
        # The vehicle accelerates throughout at most.
        fastest_mps = FASTEST_MPS if speed_mps is None else min(
            FASTEST_MPS, speed_mps + SPEED_DEVIATION_MPS + ACCELERATION_MPS2 * seconds)
        belief = updated(self.line, track.belief, near, _sigma_m(fix), seconds,
                         driven_m(track.odometer, reading), fastest_mps)
        if belief is None:
            return None
        place = place_of(self.line, belief)
        return replace(track, belief=belief, place=place, fix=fix, odometer=reading, fixes=track.fixes + 1,
                       furthest_m=max(track.furthest_m, place.distance_m))

    def _begun(self, fix: Fix, near: Nearby) -> _Track | None:
        belief = weighed(self.line, near, _sigma_m(fix), self._prior(fix, near))
        if belief is None:
            return None
        place = place_of(self.line, belief)
        return _Track(belief, place, fix, self.odometer.at(fix.stamp_ns), fix, place, 1, place.distance_m)

    def _prior(self, fix: Fix, near: Nearby) -> FloatArray:
        """Return the density [1/m] of places before the first fix of a trial, at the points near it."""
        anywhere: FloatArray = np.full(len(near.at), 1.0 / self.line.length_m)
        track = self._track
        if track is not None:
            seconds = (fix.stamp_ns - track.fix.stamp_ns) / NS_PER_S
            return 0.5 * anywhere + 0.5 * carried_on(
                self.line, track.belief, near, seconds, driven_m(track.odometer, self.odometer.at(fix.stamp_ns)))
        if self._from_start:
            at_start = (self.line.along_m[near.at] <= START_REACHES_M) / START_REACHES_M
            return START_PRIOR * at_start + (1.0 - START_PRIOR) * anywhere
        return anywhere

    def _is_confirmed(self, trial: _Track) -> bool:
        """Return whether a trial has followed the route long enough, and does not merely cross it."""
        first, last = trial.first_fix, trial.fix
        seconds = (last.stamp_ns - first.stamp_ns) / NS_PER_S
        moved_m = trial.place.distance_m - trial.first_place.distance_m
        is_long = trial.fixes >= CONFIRM_FIXES and seconds >= CONFIRM_AFTER_S
        if not is_long or not _is_clear(trial.place):
            return False
        if self._has_left:
            return moved_m >= CONFIRM_AFTER_M
        return moved_m >= ALONG_M or (seconds >= STANDS_S and _apart_m(first, last) <= STANDS_M)

    def _aside_m(self, trial: _Track) -> float:
        """Return by how much the fix has moved against its place since the trial began [m]."""
        residuals = []
        for fix, place in ((trial.first_fix, trial.first_place), (trial.fix, trial.place)):
            latitude_deg, longitude_deg = self.line.position(place.distance_m)
            residuals.append(offset_m(latitude_deg, longitude_deg, fix.latitude_deg, fix.longitude_deg))
        return math.dist(*residuals)

    # In words

    def _told(self, track: _Track, fix: Fix) -> Match:
        place, deviation_m = track.place, _deviation_m(track)
        if not _is_clear(place):
            return Match(Cause.AMBIGUOUS, _ambiguous(place), fix.stamp_ns)
        if deviation_m > MOST_DEVIATION_M or place.deviation_m > WIDEST_DEVIATIONS * _sigma_m(fix):
            return Match(Cause.UNCERTAIN, f'The place has a deviation of {deviation_m:.0f} m, too much '
                         'for a position', fix.stamp_ns)
        return Match(Cause.MATCHED, f'{place.distance_m / 1000:.2f} km from the start', fix.stamp_ns,
                     place.distance_m, deviation_m)

    def _doubt(self, fix: Fix, near: Nearby) -> Match:
        at, away_m = self.line.nearest(fix.latitude_deg, fix.longitude_deg)
        track, trial = self._track, self._trial
        cause, sentence = Cause.CONFIRMING, 'The position is near the route; its place is not confirmed yet'
        is_tracked = track is not None and not self._has_left and self._contradicts
        if len(near.at) == 0:
            far = f'{away_m:.0f} m' if away_m < 10e3 else f'{away_m / 1000:.0f} km'
            has_arrived = track is not None and self.line.length_m - track.place.distance_m <= END_M
            cause = Cause.ARRIVED if has_arrived else Cause.OFF_ROUTE
            sentence = f'The position is {far} from the route'
        elif self._is_against(fix, near):
            cause, sentence = Cause.AGAINST, 'The vehicle drives along the route, against its direction'
        elif trial is not None and not _is_clear(trial.place):
            cause, sentence = Cause.AMBIGUOUS, _ambiguous(trial.place)
        elif is_tracked:
            cause = Cause.ELSEWHERE
            sentence = (f'The position is near {self.line.along_m[at] / 1000:.2f} km of the route, where the '
                        'vehicle cannot be yet')
        if is_tracked and self._contradicts < LEFT_FIXES:
            cause = Cause.OUTLIER
        return Match(cause, sentence, fix.stamp_ns)

    # Events

    def _note_contradiction(self, fix: Fix) -> None:
        if self._contradicts == 0:
            self._contradicts_since_ns = fix.stamp_ns
        self._contradicts += 1
        if (self._contradicts >= LEFT_FIXES
                and fix.stamp_ns - self._contradicts_since_ns >= LEFT_AFTER_S * NS_PER_S):
            self._has_left = True

    def _is_against(self, fix: Fix, near: Nearby) -> bool:
        """Return whether the vehicle drives against the direction of all parts of the route near it."""
        for other in reversed(self._course):
            if _apart_m(other, fix) >= COURSE_M:
                east, north = unit_vector(other.latitude_deg, other.longitude_deg,
                                          fix.latitude_deg, fix.longitude_deg)
                cosines = [np.dot((east, north), self.line.direction(at)) for at in near.at]
                return bool(min(cosines) <= -ALONG and max(cosines) < ALONG)
        return False


def _apart_m(one: Fix, other: Fix) -> float:
    return math.hypot(*offset_m(one.latitude_deg, one.longitude_deg, other.latitude_deg, other.longitude_deg))


def _is_clear(place: Place) -> bool:
    return place.probability >= LEAST_PROBABILITY


def _ambiguous(place: Place) -> str:
    return (f'The position fits several places of the route: {place.distance_m / 1000:.2f} km and '
            f'{(place.other_m or 0.0) / 1000:.2f} km')


def _deviation_m(track: _Track) -> float:
    """Return the deviation of a place [m]: that of its fix at least, because errors of fixes are correlated."""
    return max(track.place.deviation_m, _sigma_m(track.fix))


def _sigma_m(fix: Fix) -> float:
    """Return the deviation of a fix from the line [m], set when it was taken."""
    assert fix.deviation_m is not None
    return fix.deviation_m
