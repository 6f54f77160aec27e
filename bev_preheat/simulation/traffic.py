# SPDX-License-Identifier: Apache-2.0
"""What happens to a drive on its way, and what the trip planner says about it, and when."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
import math

import numpy as np

from bev_preheat.route.segments import Route


class Kind(Enum):
    """What an event is."""

    # Stands for `duration_s`, then goes on.
    STOP = 'stop'
    # For `duration_s` of the route it takes `factor` times as long, with 1 / factor^2 of the power.
    OTHER_PACE = 'other_pace'
    # From here on another `route`.
    DETOUR = 'detour'
    # The charger falls away: the drive goes on, but not to be charged.
    CANCEL_CHARGING = 'cancel_charging'
    # The drive ends here, at a charger.
    ARRIVE_EARLY = 'arrive_early'


@dataclass(frozen=True)
class Event:
    """
    One event of a Kind, at an instant of the drive [s].

    The trip planner sends a new route `route_plan_after_s` [s] later; None: it says nothing.
    """

    kind: Kind
    at_s: float
    route_plan_after_s: float | None = 0.0
    duration_s: float = 0.0
    factor: float = 1.0
    route: Route | None = None


@dataclass(frozen=True)
class TrafficNews:
    """
    What the trip planner says at an instant [s]: the route from then on, and whether it charges.

    `route` is None where the drive has ended by then; the route that was sent before is then cut.
    """

    at_s: float
    route: Route | None
    charging_planned: bool


def drive_with_events(route: Route, events: Iterable[Event],
                      charging_planned: bool = True) -> tuple[Route, list[TrafficNews]]:
    """
    Return (the Route that is driven, the News that the trip planner sends, in order).

    `events` are in order of time; those after the end of the drive do not happen.
    """
    news = []
    for event in sorted(events, key=lambda event: event.at_s):
        if event.at_s >= route.total_duration_s:
            continue
        route = _after(route, event)
        if event.kind is Kind.CANCEL_CHARGING:
            charging_planned = False
        if event.route_plan_after_s is not None:
            at_s = event.at_s + event.route_plan_after_s
            rest = route.after(at_s) if at_s < route.total_duration_s else None
            news.append(TrafficNews(at_s, rest, charging_planned))
    return route, news


def _after(route: Route, event: Event) -> Route:
    """Return the route with what an event makes of it."""
    at_s = event.at_s
    if event.kind is Kind.CANCEL_CHARGING:
        return route
    if event.kind is Kind.ARRIVE_EARLY:
        return route.before(at_s)
    if event.kind is Kind.STOP:
        changed = _standing(route.after(at_s), event.duration_s).followed_by(route.after(at_s))
    elif event.kind is Kind.OTHER_PACE:
        end_s = min(at_s + event.duration_s, route.total_duration_s)
        changed = _at_pace(route.before(end_s).after(at_s), event.factor)
        if end_s < route.total_duration_s:
            changed = changed.followed_by(route.after(end_s))
    else:
        assert event.route is not None
        changed = event.route
    return route.before(at_s).followed_by(changed) if at_s > 0.0 else changed


def _standing(route: Route, duration_s: float) -> Route:
    """One segment of standing where a route begins."""
    first = route.segments(0, 1)
    zero = np.zeros(1)
    return replace(first, duration_s=np.array([duration_s]), speed_mps=zero,
                   propulsion_power_w=zero, propulsion_power_rms_w=zero,
                   propulsion_power_magnitude_w=zero)


def _at_pace(route: Route, factor: float) -> Route:
    return replace(route.with_propulsion(1.0 / factor**2), duration_s=factor * route.duration_s,
                   speed_mps=route.speed_mps / factor)


@dataclass(frozen=True)
class ClockJump:
    """From an instant of the drive [s] on, clock and stamps are off by so much more [s]."""

    at_s: float
    by_s: float


def clock_offset_s(jumps: Sequence[ClockJump], instant_s: float) -> float:
    """Return by how much the clock is off at an instant of the drive [s]."""
    return math.fsum(jump.by_s for jump in jumps if jump.at_s <= instant_s)
