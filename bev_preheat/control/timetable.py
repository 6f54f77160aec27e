# SPDX-License-Identifier: Apache-2.0
"""
When a trip is where: by its route's stamp, and by the vehicle's position once that is known.

The timetable is the only source of times on the route: the mission with its delay, and the planned instant of
an actual one. It is a value: each observation (a position, standing, charging, the passing of time) makes another
one. Its place comes from the latest observation alone, and a trip that has ended stays ended: no method leads
back. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, replace
from itertools import dropwhile
from typing import NamedTuple, Self, TYPE_CHECKING

from bev_preheat.control.heater import KEPT_NS
from bev_preheat.errors import age_beyond, figure_beyond, InvalidInput, quoted
from bev_preheat.numerics import NS_PER_S
from bev_preheat.route.segments import LIMITS
from bev_preheat.tunables import (
    CORRECTED_BY_M,
    END_KNOWN_TO,
    JUST_BEGUN_NS,
    KNOWN_TO_M,
    MOST_REPLACED,
    MOVES_WITHIN_NS,
    PACE_OVER_NS,
    STANDING_AFTER_S,
)

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Leg, Mission, Progress
    from bev_preheat.control.settings import Settings

# A distance may lie CORRECTED_BY_M behind the furthest one before, or exceed by that the distance that the fastest
# vehicle drives. A vehicle that stands or charges so close to the end of a leg has arrived there: its place at the
# charger is not a point of the road.
FASTEST_MPS = LIMITS['speed_mps'][1]
# Fixes are this far apart or more.
SPACED_NS = NS_PER_S


class _Fix(NamedTuple):
    """An instant, and the instant at which the vehicle's position at that time was planned [ns]."""

    stamp_ns: int
    planned_ns: int


class _Track(NamedTuple):
    """
    The positions on the route so far.

    `furthest_m` [m] is the furthest one. `stands_at_m` [m] and `stands_from_ns` [ns] are distance and delay at
    which it last grew, `moved_ns` the instant; None: the positions since `since_ns`, which followed one another,
    have not grown yet.
    """

    latest: Progress
    furthest_m: float
    since_ns: int
    stands_at_m: float
    stands_from_ns: int
    moved_ns: int | None = None


class TripEnd(NamedTuple):
    """The end of a trip [ns], None: before the clock was restarted; otherwise than observed, its time was over."""

    at_ns: int | None
    is_observed: bool


@dataclass(frozen=True, eq=False)
class Timetable:
    """
    One Mission, and the vehicle's place on it.

    `planned` is the Mission by its own stamp; `mission` is the same with all its instants shifted by the delay.
    `end` is the TripEnd, None before it. `stood_ns` is the delay that has built up since the vehicle last moved.
    `begun_ns` is the start of the trip's first route plan, `known_ns` the instant at which this one arrived;
    positions from before it belong to another one. `fixes` are in order of their instants. `undriven` is the
    latest first position that is too far to be driven by then, `frozen` a position that stays while the vehicle
    drives; None: none.
    """

    planned: Mission
    mission: Mission
    begun_ns: int
    known_ns: int | None = None
    end: TripEnd | None = None
    stood_ns: int = 0
    track: _Track | None = None
    undriven: Progress | None = None
    frozen: Progress | None = None
    # The planned instant of the place at which the vehicle stands [ns]; None: it drives.
    held_at_ns: int | None = None
    fixes: tuple[_Fix, ...] = ()
    # For how long after the latest fix the pace is assumed to continue [ns].
    goes_on_ns: int = 0
    # The delay before a charge that may turn out to be a descent [ns]; None: no such charge.
    delay_before_charge_ns: int | None = None
    # The standing before the route plan was replaced [ns].
    stood_before_ns: int = 0
    # The stamps of the trip's route plans that were replaced [ns], the latest ones.
    replaced_ns: tuple[int, ...] = ()

    @classmethod
    def of(cls, planned: Mission, known_ns: int | None = None) -> Self:
        """Return the Timetable of a Mission by its own stamp, which arrived at an instant [ns], None: unknown."""
        return cls(planned, planned, planned.start_ns, known_ns)

    def updated(self, planned: Mission, now_ns: int) -> Timetable:
        """
        Return the Timetable of a later route plan for the same trip, received at an instant [ns].

        It goes by its own stamp, unless it has the same instants as the route plan before. A vehicle that stands
        does not begin to stand.
        """
        if planned.has_instants_of(self.planned):
            return self.revised(planned)
        return replace(Timetable.of(planned, now_ns), begun_ns=min(self.begun_ns, planned.start_ns),
                       stood_before_ns=self.stood_ns, stood_ns=self.stood_ns, replaced_ns=(
                           *self.replaced_ns, self.planned.start_ns)[-MOST_REPLACED:])

    def outdated(self, planned: Mission, now_ns: int) -> str:
        """Return why a route plan received at an instant [ns] is older than the current one; '' if not."""
        current, over_ns = self.planned, now_ns - planned.arrival_ns
        if self.end is not None or planned.has_instants_of(current):
            return ''
        # An update that ends now says that the vehicle has arrived.
        if over_ns >= (JUST_BEGUN_NS if planned.route_id == current.route_id else 0):
            return (f'header.stamp: by its times route {quoted(planned.route_id)} ended '
                    f'{over_ns / NS_PER_S:.0f} s before it arrived; the stamp is the start of segment 0')
        is_replaced = (planned.route_id == current.route_id and planned.start_ns != current.start_ns
                       and planned.start_ns in self.replaced_ns)
        return 'header.stamp: a later route plan has replaced this one; an update has a new stamp' * is_replaced

    def on_the_way(self, now_ns: int) -> Timetable:
        """Return the Timetable of a vehicle that drives now [ns]: a start within a minute counts as now."""
        early_ns = self.planned.start_ns - now_ns
        is_about_to_start = self.delay_ns == 0 and 0 < early_ns <= STANDING_AFTER_S * NS_PER_S
        return replace(self, mission=self.planned.delayed(-early_ns)) if is_about_to_start else self

    def revised(self, planned: Mission) -> Timetable:
        """Return the Timetable of the same Mission in other steps, or with another goal."""
        return replace(self, planned=planned, mission=planned.delayed(self.delay_ns))

    @property
    def delay_ns(self) -> int:
        """The vehicle's delay [ns]; negative: it is early."""
        return self.mission.delay_ns

    @property
    def latest(self) -> Progress | None:
        """The latest Progress that counts; None without one."""
        return None if self.track is None else self.track.latest

    def planned_ns(self, instant_ns: int) -> int:
        """
        Return the planned instant of the vehicle's position at an instant.

        Between two fixes it is interpolated linearly; after the latest the pace continues, and becomes the
        planned pace once the latest is too old. After the end of the trip it is not before the planned arrival.
        """
        planned_ns = self._by_fixes_ns(instant_ns)
        if self.end is None or (self.end.at_ns is not None and instant_ns < self.end.at_ns):
            return planned_ns
        return max(planned_ns, self.planned.arrival_ns)

    def _by_fixes_ns(self, instant_ns: int) -> int:
        fixes = self.fixes
        if not fixes or instant_ns <= fixes[0].stamp_ns:
            delay_ns = fixes[0].stamp_ns - fixes[0].planned_ns if fixes else self.mission.delay_ns
            return instant_ns - delay_ns
        last = fixes[-1]
        if instant_ns > last.stamp_ns:
            since = next(fix for fix in reversed(fixes)
                         if fix.stamp_ns <= last.stamp_ns - PACE_OVER_NS or fix is fixes[0])
            beyond_ns = instant_ns - last.stamp_ns
            as_before_ns = min(beyond_ns, self.goes_on_ns)
            return last.planned_ns + _part_ns(as_before_ns, since, last) + beyond_ns - as_before_ns
        at = bisect_right(fixes, instant_ns - 1, key=lambda fix: fix.stamp_ns)
        before, after = fixes[at - 1], fixes[at]
        return before.planned_ns + _part_ns(instant_ns - before.stamp_ns, before, after)

    # Time

    def passed(self, now_ns: int) -> Timetable:
        """Return the Timetable at an instant [ns]: a trip whose time is over has ended."""
        arrival_ns = self.mission.arrival_ns
        if self.end is not None or now_ns < arrival_ns:
            return self
        track = self.track
        is_there = track is not None and track.furthest_m >= self.planned.places.length_m - KNOWN_TO_M
        return self.ended(TripEnd(arrival_ns, is_there))

    def ended(self, end: TripEnd) -> Timetable:
        """Return the Timetable of a trip that has ended; its arrival is at the end."""
        mission = self.mission if end.at_ns is None else self._delayed(end.at_ns - self.planned.arrival_ns)
        return replace(self, end=end, mission=mission, held_at_ns=None, stood_ns=0, delay_before_charge_ns=None)

    def without_instants(self) -> Timetable:
        """Return the Timetable by the Mission's own stamp, because the clock was restarted."""
        end = None if self.end is None else self.end._replace(at_ns=None)
        return replace(Timetable.of(self.planned), begun_ns=self.begun_ns, end=end)

    # Positions

    def at_progress(self, progress: Progress, now_ns: int, settings: Settings) -> Timetable:
        """
        Return the Timetable with a Progress; raise InvalidInput, with one problem per field, if it is bad.

        The delay changes by the least amount that explains the reported position; it does not change while the
        route plans to stand. After the end of the trip no position counts.
        """
        # It may be from before this route plan replaced another with its route_id.
        is_of_route_before = (self.known_ns is not None and progress.route_start_ns is None
                              and progress.stamp_ns < self.known_ns)
        if self.end is not None or is_of_route_before:
            return self
        # Recent enough for a pace between the latest position and this one.
        is_followed = self.has_position(progress.stamp_ns, settings)
        problems = self._problems(progress, now_ns, settings, is_followed)
        if problems:
            raise InvalidInput(problems)
        start_ns, places, track = self.planned.start_ns, self.planned.places, self.track
        furthest_m = min(max(progress.distance_m, track.furthest_m if track else 0.0), places.length_m)
        # Not beyond the end, which counts as reached within the accuracy of a distance.
        earliest_s = places.earliest_s(furthest_m - KNOWN_TO_M)
        latest_s = places.latest_s(furthest_m + KNOWN_TO_M)
        planned_ns = progress.stamp_ns - self.delay_ns
        elapsed_s = (planned_ns - start_ns) / NS_PER_S
        if not earliest_s <= elapsed_s <= latest_s:
            planned_ns = start_ns + round((earliest_s if elapsed_s < earliest_s else latest_s) * NS_PER_S)
        delay_ns = progress.stamp_ns - planned_ns
        stood_before_ns = self.stood_before_ns
        if track is None or not is_followed:
            # Whether it has moved, only the next positions show.
            track = _Track(progress, furthest_m, progress.stamp_ns, furthest_m, delay_ns)
        elif furthest_m > track.stands_at_m + KNOWN_TO_M:
            track = _Track(progress, furthest_m, track.since_ns, furthest_m, delay_ns, progress.stamp_ns)
            stood_before_ns = 0
        else:
            track = track._replace(latest=progress, furthest_m=furthest_m)
        return replace(
            self, mission=self._delayed(delay_ns), track=track, frozen=None, held_at_ns=None,
            fixes=_noted(self.fixes if is_followed else (), _Fix(progress.stamp_ns, planned_ns)),
            goes_on_ns=round(settings.route_progress_timeout_s * NS_PER_S),
            stood_before_ns=stood_before_ns, delay_before_charge_ns=None,
            stood_ns=stood_before_ns + delay_ns - track.stands_from_ns)

    def without_frozen_position(self) -> Timetable:
        """Return the Timetable of a vehicle that has driven on since its position last moved."""
        track = self.track
        return self if track is None else replace(
            self.driving(), mission=self._delayed(track.stands_from_ns), track=None, frozen=track.latest, fixes=())

    def has_position(self, now_ns: int, settings: Settings) -> bool:
        """Return whether the vehicle's position is known at an instant [ns]: the latest Progress is recent."""
        return self.track is not None and (
            now_ns - self.track.latest.stamp_ns <= settings.route_progress_timeout_s * NS_PER_S)

    def has_moved(self, now_ns: int, settings: Settings) -> bool | None:
        """Return whether the vehicle moves, by its latest positions; None if they do not show it."""
        track = self.track
        if track is None or self.end is not None or not self.has_position(now_ns, settings):
            return None
        if track.moved_ns is not None and track.latest.stamp_ns - track.moved_ns <= MOVES_WITHIN_NS:
            return True
        return False if track.latest.stamp_ns - track.since_ns > MOVES_WITHIN_NS else None

    def is_at_end_of_leg(self, now_ns: int) -> bool:
        """Return whether the furthest position is at the end of the current leg, as close as a charger may be."""
        if self.track is None:
            return False
        end_m = self._end_of_m(self._leg_at(self.planned_ns(now_ns)))
        return self.track.furthest_m >= end_m - CORRECTED_BY_M

    # Standing and charging, by other evidence

    def standing(self, since_ns: int, recognised_ns: int, now_ns: int, is_charged: bool) -> Timetable:
        """
        Return the Timetable of a vehicle that stands or `is_charged`: it stays at its place, and the delay grows.

        The vehicle has stood since `since_ns` [ns], recognised at `recognised_ns` [ns]. Its place is that at
        recognition, because a short stop is part of the route, but not before its latest fix. Before the trip, at
        its stops and after its end time passes as planned.
        """
        held_ns, fixes, planned_ns = self.held_at_ns, self.fixes, self.planned_ns(now_ns)
        before_ns = self.delay_before_charge_ns
        leg = self._leg_at(planned_ns)
        if held_ns is None:
            if self.end is not None or not leg.start_ns <= planned_ns < leg.arrival_ns:
                return self
            held_ns = max(self.planned_ns(recognised_ns), leg.start_ns,
                          fixes[-1].planned_ns if fixes else leg.start_ns)
            if not fixes or fixes[-1].stamp_ns < recognised_ns:
                fixes = _noted(fixes, _Fix(min(recognised_ns, now_ns), held_ns))
        if is_charged and before_ns is None and held_ns > leg.start_ns:
            before_ns = self.delay_ns
        return replace(
            self, held_at_ns=held_ns, fixes=_noted(fixes, _Fix(now_ns, held_ns)), goes_on_ns=0,
            mission=self.planned.delayed(now_ns - held_ns),
            delay_before_charge_ns=before_ns,
            stood_ns=now_ns - max(since_ns, self.begun_ns))

    def driving(self) -> Timetable:
        """Return the Timetable of a vehicle that drives on from its place."""
        return replace(self, held_at_ns=None, stood_ns=0, stood_before_ns=0, delay_before_charge_ns=None)

    def released(self, until_ns: int | None) -> Timetable:
        """Return the Timetable of a vehicle that stood until an instant [ns]; None: until now, or did not."""
        if self.held_at_ns is None:
            return self
        if until_ns is None or self.end is not None:
            return self.driving()
        before_ns = self.delay_before_charge_ns
        before_ns = self.delay_ns - self.stood_ns if before_ns is None else before_ns
        delay_ns = max(until_ns - self.held_at_ns, before_ns)
        return replace(self.driving(), mission=self.planned.delayed(delay_ns), fixes=())

    def driven_all_along(self) -> Timetable:
        """Return the Timetable without the latest charge, which was a descent."""
        before_ns = self.delay_before_charge_ns
        if before_ns is None or self.end is not None:
            return self.driving()
        return replace(self.driving(), mission=self.planned.delayed(before_ns), fixes=())

    def arrived(self, since_ns: int, is_at_place: bool) -> Timetable:
        """Return the Timetable of a vehicle at the end of its current leg since an instant [ns]."""
        leg = self._leg_at(self.planned_ns(since_ns) if self.held_at_ns is None else self.held_at_ns)
        arrived = replace(
            self, mission=self.planned.delayed(since_ns - leg.arrival_ns), held_at_ns=None, stood_ns=0,
            fixes=(_Fix(since_ns, leg.arrival_ns),))
        if is_at_place and self.track is not None:
            arrived = replace(arrived, track=self.track._replace(
                furthest_m=max(self.track.furthest_m, self._end_of_m(leg))))
        return arrived.ended(TripEnd(since_ns, True)) if leg is self.planned.legs[-1] else arrived

    def _leg_at(self, planned_ns: int) -> Leg:
        return self.planned.legs[self.planned.leg_number(planned_ns)]

    def _end_of_m(self, leg: Leg) -> float:
        """Return the distance [m] at the end of a planned leg."""
        planned = self.planned
        return planned.places.distance_at_m((leg.arrival_ns - planned.start_ns) / NS_PER_S)

    def _delayed(self, delay_ns: int) -> Mission:
        # The same object while the delay stays.
        return self.mission if delay_ns == self.delay_ns else self.planned.delayed(delay_ns)

    # Checks of a Progress

    def after_refused(self, progress: Progress) -> Timetable:
        """Return the Timetable that knows a refused Progress, if it is too far to be driven by then."""
        is_first = self.track is None and progress.route_id == self.planned.route_id
        return replace(self, undriven=progress) if is_first and self._undriven_problems(progress) else self

    def _undriven_problems(self, progress: Progress) -> list[str]:
        """Return the problem of a first position that is too far to be driven by then, or goes on from one."""
        if self.known_ns is None:
            return []
        # A vehicle may leave before the stamp of its route plan.
        since_s = max(0, progress.stamp_ns - min(self.planned.start_ns, self.known_ns)) / NS_PER_S
        most_m = FASTEST_MPS * since_s + CORRECTED_BY_M
        distance_m, far, problem = progress.distance_m, self.undriven, ''
        if distance_m > most_m:
            problem = f'have been driven within {since_s:.1f} s; at most {most_m:.0f} m are possible'
        elif far is not None:
            pace_mps = max(float(leg.route.speed_mps.max()) for leg in self.planned.legs)
            gap_m = CORRECTED_BY_M + pace_mps * abs(progress.stamp_ns - far.stamp_ns) / NS_PER_S
            if abs(distance_m - far.distance_m) <= gap_m:
                problem = f'go on from {far.distance_m:.0f} m, which was too far to be driven by then'
        return [] if not problem else [
            f'distance: {distance_m:.0f} m {problem}: it counts from the start of segment 0, which begins at the '
            'stamp of route_plan']

    def _problems(self, progress: Progress, now_ns: int, settings: Settings,
                  is_followed: bool) -> list[str]:
        planned, problems = self.planned, []
        if progress.route_id != planned.route_id:
            problems.append(f'route_id: {quoted(progress.route_id)} is not the current route, '
                            f'{quoted(planned.route_id)}')
        elif progress.route_start_ns not in (None, planned.start_ns):
            apart_s = (progress.route_start_ns - planned.start_ns) / NS_PER_S
            problems.append(f'route_stamp: is not that of the latest route plan, but {abs(apart_s):.3f} s '
                            f'{"after" if apart_s > 0.0 else "before"} it')
        age_s = (now_ns - progress.stamp_ns) / NS_PER_S
        oldest_s, ahead_s = settings.route_progress_timeout_s, settings.clock_tolerance_s
        if not -ahead_s <= age_s <= oldest_s:
            problems.append(f'header.stamp: the position is {age_beyond(age_s, ahead_s, oldest_s)}')
        if problems:
            # A distance along another route cannot be checked.
            return problems
        length_m, distance_m = planned.places.length_m, progress.distance_m
        if length_m == 0.0:
            return ['distance: has no meaning on a route whose speed is 0 in each segment']
        most_m = length_m + max(END_KNOWN_TO * length_m, CORRECTED_BY_M)
        if not 0.0 <= distance_m <= most_m:
            return [f'distance: {figure_beyond(distance_m, 0.0, most_m)} m is not allowed; it must be 0 ... '
                    f'{length_m:.0f} m, the length of the route']
        track = self.track
        if self.frozen is not None and abs(distance_m - self.frozen.distance_m) <= KNOWN_TO_M:
            return [f'distance: has stayed at {distance_m:.0f} m for minutes, although the battery drives the '
                    'vehicle']
        if track is None:
            return self._undriven_problems(progress)
        since_s = (progress.stamp_ns - track.latest.stamp_ns) / NS_PER_S
        if since_s < 0.0:
            return [f'header.stamp: the position is {-since_s:.3f} s older than the previous one; '
                    'stamps must not go back']
        behind_m = track.furthest_m - distance_m
        if behind_m > CORRECTED_BY_M:
            return [f'distance: {distance_m:.0f} m is {behind_m:.0f} m behind the {track.furthest_m:.0f} m that '
                    f'were reached before; it must be at most {CORRECTED_BY_M:.0f} m behind: a vehicle that turns '
                    'back needs a new route plan']
        gain_m, most_m = distance_m - track.latest.distance_m, FASTEST_MPS * since_s + CORRECTED_BY_M
        if is_followed and gain_m > most_m:
            return [f'distance: {distance_m:.0f} m is {gain_m:.0f} m beyond the {track.latest.distance_m:.0f} m '
                    f'of {since_s:.1f} s before; it must be at most {most_m:.0f} m beyond']
        return []


def _noted(fixes: tuple[_Fix, ...], fix: _Fix) -> tuple[_Fix, ...]:
    """Return fixes and a later one, without those that are too old or too close."""
    if fixes and fix.planned_ns < fixes[-1].planned_ns:
        return (fix,)
    if (len(fixes) > 1 and fix.stamp_ns - fixes[-2].stamp_ns < SPACED_NS) or (
            fixes and fixes[-1].stamp_ns == fix.stamp_ns):
        fixes = fixes[:-1]
    return (*dropwhile(lambda old: old.stamp_ns < fix.stamp_ns - KEPT_NS, fixes), fix)


def _part_ns(span_ns: int, before: _Fix, after: _Fix) -> int:
    """Return the planned time that passes in a span [ns] at the pace between two fixes."""
    real_ns, planned_ns = after.stamp_ns - before.stamp_ns, after.planned_ns - before.planned_ns
    # Integers: without delay nothing is rounded.
    return span_ns if real_ns in (0, planned_ns) else span_ns * planned_ns // real_ns
