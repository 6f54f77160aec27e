# SPDX-License-Identifier: Apache-2.0
"""
When a trip is where: by its route's stamp, and by the vehicle's position once that is known.

The timetable is the only source of times on the route: the mission with its delay, and the planned instant of
an actual one. Instants are integers, in nanoseconds of the node's clock.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import NamedTuple, TYPE_CHECKING

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.errors import age_beyond, figure_beyond, InvalidInput, quoted
from bev_preheat.route.places import Places
from bev_preheat.route.segments import LIMITS

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Mission, Progress
    from bev_preheat.control.settings import Settings

# Accuracy of a distance [m]: a vehicle within it of its planned place is on time; a vehicle that moves no further
# than this stands.
KNOWN_TO_M = 10.0
# From one message to the next the distance may fall by CORRECTED_BY_M [m], or exceed by that the distance that the
# fastest vehicle drives: positions are corrected.
CORRECTED_BY_M = 100.0
FASTEST_MPS = LIMITS['speed_mps'][1]
# The end of the route is known to this share of its length, and to CORRECTED_BY_M at least.
END_KNOWN_TO = 0.01
# Fixes older than KEPT_NS are dropped, because no caller asks further back; fixes are SPACED_NS apart or more.
KEPT_NS = 70 * NS_PER_S
SPACED_NS = NS_PER_S
# The pace along the route is averaged over this time.
PACE_OVER_NS = 5 * NS_PER_S
# A vehicle moves if its position has grown by more than KNOWN_TO_M within this time.
MOVES_WITHIN_NS = 10 * NS_PER_S


class _Fix(NamedTuple):
    """An instant, and the instant at which the vehicle's position at that time was planned [ns]."""

    stamp_ns: int
    planned_ns: int


class PlaceReport(NamedTuple):
    """
    The vehicle's place on a route of `length_m` [m], by its latest Progress.

    `delay_ns` [ns] is negative if it is early; `stood_ns` [ns] is the delay that has built up since it last moved.
    """

    latest: Progress
    length_m: float
    delay_ns: int
    stood_ns: int


class Timetable:
    """
    One Mission, and the vehicle's place on it.

    `planned` is the Mission by its own stamp; `mission` is the same with all its instants shifted by the delay of
    the latest Progress. Without Progress the two are equal. `latest` is the latest valid Progress, None before the
    first; `stood_ns` is the delay that has built up since the vehicle last moved.
    """

    def __init__(self, planned: Mission) -> None:
        """Go by the Mission's own stamp."""
        self.planned = self.mission = planned
        self.latest: Progress | None = None
        self.stood_ns = 0
        self._fixes: deque[_Fix] = deque()
        # For how long after the latest Progress the pace is assumed to continue [ns].
        self._goes_on_ns = 0
        self._places: Places | None = None
        # The furthest distance so far [m], and the distance [m] and delay [ns] at which it last grew.
        self._furthest_m = 0.0
        self._stands_at_m, self._stands_from_ns = 0.0, 0
        # The instant at which it last grew, and the planned instant at which other evidence has the vehicle stand.
        self._moved_ns = 0
        self._frozen_ns: int | None = None
        # The delay before that [ns]; None: no such standing.
        self._delay_before_ns: int | None = None

    @property
    def places(self) -> Places:
        """The Places of the whole trip; its stops are spans in which the vehicle stands."""
        if self._places is None:
            start_ns = self.planned.start_ns
            self._places = Places.joined(
                ((leg.start_ns - start_ns) / NS_PER_S, leg.places or Places.of_route(leg.route))
                for leg in self.planned.legs)
        return self._places

    @property
    def delay_ns(self) -> int:
        """The vehicle's delay [ns]; negative: it is early."""
        return self.mission.delay_ns

    @property
    def place(self) -> PlaceReport | None:
        """The PlaceReport of now; None without Progress."""
        if self.latest is None:
            return None
        return PlaceReport(self.latest, self.places.length_m, self.delay_ns, self.stood_ns)

    def lose_time(self) -> None:
        """Go by the Mission's own stamp again, because the clock was restarted."""
        self.latest, self.mission, self.stood_ns = None, self.planned, 0
        self._frozen_ns = self._delay_before_ns = None
        self._fixes.clear()

    def revise(self, planned: Mission) -> None:
        """Take the same Mission in other steps, or with another goal."""
        self.mission, self.planned = planned.delayed(self.delay_ns), planned

    def planned_ns(self, instant_ns: int) -> int:
        """
        Return the planned instant of the vehicle's position at an instant.

        Between two Progresses it is interpolated linearly; after the latest the pace continues, and becomes the
        planned pace once the latest is too old.
        """
        fixes = self._fixes
        if not fixes or instant_ns <= fixes[0].stamp_ns:
            delay_ns = fixes[0].stamp_ns - fixes[0].planned_ns if fixes else self.mission.delay_ns
            return instant_ns - delay_ns
        last = fixes[-1]
        if instant_ns > last.stamp_ns:
            since = next(fix for fix in reversed(fixes)
                         if fix.stamp_ns <= last.stamp_ns - PACE_OVER_NS or fix is fixes[0])
            beyond_ns = instant_ns - last.stamp_ns
            as_before_ns = min(beyond_ns, self._goes_on_ns)
            return last.planned_ns + _part_ns(as_before_ns, since, last) + beyond_ns - as_before_ns
        at = bisect_right(fixes, instant_ns - 1, key=lambda fix: fix.stamp_ns)
        before, after = fixes[at - 1], fixes[at]
        return before.planned_ns + _part_ns(instant_ns - before.stamp_ns, before, after)

    def accept(self, progress: Progress, now_ns: int, settings: Settings) -> None:
        """
        Take a Progress in; raise InvalidInput, with one problem per field, and keep the previous one if it is bad.

        The delay changes by the least amount that explains the reported position; it does not change while the
        route plans to stand.
        """
        is_followed = self._is_followed(progress, settings)
        problems = self._problems(progress, now_ns, settings, is_followed)
        if problems:
            raise InvalidInput(problems)
        start_ns, places = self.planned.start_ns, self.places
        expected_ns = progress.stamp_ns - self.delay_ns
        if not is_followed:
            self._fixes.clear()
        self._furthest_m = min(max(
            progress.distance_m, self._furthest_m if is_followed else 0.0), places.length_m)
        # Not beyond the end, which counts as reached within the accuracy of a distance.
        earliest_s = places.earliest_s(self._furthest_m - KNOWN_TO_M)
        latest_s = places.latest_s(self._furthest_m + KNOWN_TO_M)
        planned_ns = expected_ns
        if (expected_ns - start_ns) / NS_PER_S < earliest_s:
            planned_ns = start_ns + round(earliest_s * NS_PER_S)
        elif (expected_ns - start_ns) / NS_PER_S > latest_s:
            planned_ns = start_ns + round(latest_s * NS_PER_S)
        self._note(_Fix(progress.stamp_ns, planned_ns))
        self._goes_on_ns = round(settings.route_progress_timeout_s * NS_PER_S)
        delay_ns = progress.stamp_ns - planned_ns
        if delay_ns != self.delay_ns:
            self.mission = self.planned.delayed(delay_ns)
        if not is_followed or self._furthest_m > self._stands_at_m + KNOWN_TO_M:
            self._stands_at_m, self._stands_from_ns = self._furthest_m, delay_ns
            self._moved_ns = progress.stamp_ns
        self.stood_ns = delay_ns - self._stands_from_ns
        self.latest = progress

    def has_moved(self, now_ns: int, settings: Settings) -> bool | None:
        """Return whether the vehicle moves, by its latest Progress; None without a recent one."""
        latest = self.latest
        if latest is None or now_ns - latest.stamp_ns > settings.route_progress_timeout_s * NS_PER_S:
            return None
        return latest.stamp_ns - self._moved_ns <= MOVES_WITHIN_NS

    def stand(self, since_ns: int, recognised_ns: int, now_ns: int) -> None:
        """
        Stay at the place of an instant, because the vehicle stands or is charged: the delay grows.

        The vehicle has stood since `since_ns` [ns], recognised at `recognised_ns` [ns]. Its place is that at
        recognition, because a short stop is part of the route. Before the trip, at its stops and after its end
        time passes as planned.
        """
        planned, planned_ns = self.planned, self.planned_ns(now_ns)
        leg = planned.legs[planned.leg_number(planned_ns)]
        if self._frozen_ns is None:
            if not leg.start_ns <= planned_ns < leg.arrival_ns:
                return
            self._frozen_ns = max(self.planned_ns(recognised_ns), leg.start_ns)
            self._delay_before_ns = self.delay_ns
            self._note(_Fix(min(recognised_ns, now_ns), self._frozen_ns))
        self._note(_Fix(now_ns, self._frozen_ns))
        self._goes_on_ns = 0
        self.mission = planned.delayed(now_ns - self._frozen_ns)
        self.stood_ns = now_ns - max(since_ns, planned.start_ns)

    def go_on(self) -> None:
        """Continue the route from the place where the vehicle stood."""
        if self._frozen_ns is not None:
            self._frozen_ns, self.stood_ns = None, 0

    def take_back(self) -> None:
        """Undo the latest `stand` or `arrive`: the vehicle was driving all along."""
        if self._delay_before_ns is None:
            return
        self.mission = self.planned.delayed(self._delay_before_ns)
        self._frozen_ns = self._delay_before_ns = None
        self.stood_ns = 0
        self._fixes.clear()

    def arrive(self, since_ns: int) -> None:
        """End the current leg as of an instant [ns]: the vehicle has reached its charger."""
        planned = self.planned
        leg = planned.legs[planned.leg_number(
            self.planned_ns(since_ns) if self._frozen_ns is None else self._frozen_ns)]
        self._frozen_ns, self.stood_ns = None, 0
        self._fixes.clear()
        self._note(_Fix(since_ns, leg.arrival_ns))
        self._goes_on_ns = 0
        self.mission = planned.delayed(since_ns - leg.arrival_ns)

    def _is_followed(self, progress: Progress, settings: Settings) -> bool:
        """Return whether the latest Progress is recent enough to be compared with this one."""
        return self.latest is not None and (
            progress.stamp_ns - self.latest.stamp_ns
            <= settings.route_progress_timeout_s * NS_PER_S)

    def _problems(self, progress: Progress, now_ns: int, settings: Settings,
                  is_followed: bool) -> list[str]:
        problems = self._problems_with_route(progress)
        age_s = (now_ns - progress.stamp_ns) / NS_PER_S
        oldest_s, ahead_s = settings.route_progress_timeout_s, settings.clock_tolerance_s
        if not -ahead_s <= age_s <= oldest_s:
            problems.append(f'header.stamp: the position is {age_beyond(age_s, ahead_s, oldest_s)}')
        if problems:
            # A distance along another route cannot be checked.
            return problems
        length_m, distance_m = self.places.length_m, progress.distance_m
        if length_m == 0.0:
            return ['distance: has no meaning on a route whose speed is 0 in each segment']
        most_m = length_m + max(END_KNOWN_TO * length_m, CORRECTED_BY_M)
        if not 0.0 <= distance_m <= most_m:
            return [f'distance: {figure_beyond(distance_m, 0.0, most_m)} m is not allowed; it must be 0 ... '
                    f'{length_m:.0f} m, the length of the route']
        latest = self.latest
        if latest is None:
            return []
        since_s = (progress.stamp_ns - latest.stamp_ns) / NS_PER_S
        if since_s < 0.0:
            return [f'header.stamp: the position is {-since_s:.3f} s older than the previous one; '
                    'stamps must not go back']
        if not is_followed:
            return []
        gain_m, most_m = distance_m - latest.distance_m, FASTEST_MPS * since_s + CORRECTED_BY_M
        if not -CORRECTED_BY_M <= gain_m <= most_m:
            return [f'distance: {distance_m:.0f} m is {abs(gain_m):.0f} m '
                    f'{"beyond" if gain_m > 0.0 else "behind"} the {latest.distance_m:.0f} m of '
                    f'{since_s:.1f} s before; it must be at most {most_m:.0f} m beyond or '
                    f'{CORRECTED_BY_M:.0f} m behind']
        return []

    def _problems_with_route(self, progress: Progress) -> list[str]:
        planned = self.planned
        if progress.route_id != planned.route_id:
            return [f'route_id: {quoted(progress.route_id)} is not the current route, '
                    f'{quoted(planned.route_id)}']
        if progress.route_start_ns not in (None, planned.start_ns):
            apart_s = (progress.route_start_ns - planned.start_ns) / NS_PER_S
            return [f'route_stamp: is not that of the latest route plan, but {abs(apart_s):.3f} s '
                    f'{"after" if apart_s > 0.0 else "before"} it']
        return []

    def _note(self, fix: _Fix) -> None:
        fixes = self._fixes
        if fixes and fix.planned_ns < fixes[-1].planned_ns:
            fixes.clear()
        if len(fixes) > 1 and fix.stamp_ns - fixes[-2].stamp_ns < SPACED_NS:
            fixes.pop()
        elif fixes and fixes[-1].stamp_ns == fix.stamp_ns:
            fixes.pop()
        fixes.append(fix)
        while fixes[0].stamp_ns < fix.stamp_ns - KEPT_NS:
            fixes.popleft()


def _part_ns(span_ns: int, before: _Fix, after: _Fix) -> int:
    """Return the planned time that passes in a span [ns] at the pace between two fixes."""
    real_ns, planned_ns = after.stamp_ns - before.stamp_ns, after.planned_ns - before.planned_ns
    # Integers: without delay nothing is rounded.
    return span_ns if real_ns in (0, planned_ns) else span_ns * planned_ns // real_ns
