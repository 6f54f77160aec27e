# SPDX-License-Identifier: Apache-2.0
"""Events on the way of a drive, the trip planner's news about them, and random variation of power by traffic."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
import math

import numpy as np

from bev_preheat.numerics import FloatArray
from bev_preheat.route.segments import Route


class Kind(Enum):
    """Kind of an event."""

    # Stands for `duration_s`, then continues.
    STOP = 'stop'
    # For `duration_s` of the route the time is multiplied by `factor`, the power by 1 / factor^2.
    OTHER_PACE = 'other_pace'
    # From here on follows another `route`.
    DETOUR = 'detour'
    # The stop for charging is cancelled; the drive continues.
    CANCEL_CHARGING = 'cancel_charging'
    # The `probability` of charging at the end changes; the drive continues.
    CHARGING_PROBABILITY = 'charging_probability'
    # The drive ends early, at a charger.
    ARRIVE_EARLY = 'arrive_early'


@dataclass(frozen=True)
class Event:
    """
    One event of a Kind, at an instant of the drive [s].

    The trip planner sends a new route `route_plan_after_s` [s] later; None: never.
    """

    kind: Kind
    at_s: float
    route_plan_after_s: float | None = 0.0
    duration_s: float = 0.0
    factor: float = 1.0
    route: Route | None = None
    probability: float = 1.0


@dataclass(frozen=True)
class TrafficNews:
    """
    News from the trip planner at an instant [s]: the route from then on, and whether charging is planned.

    `route` is None if the drive has ended by then; the route sent before is then cut. `probability` is the new one
    of charging at the end, None: that of before the drive.
    """

    at_s: float
    route: Route | None
    charging_planned: bool
    probability: float | None = None


def drive_with_events(route: Route, events: Iterable[Event],
                      charging_planned: bool = True) -> tuple[Route, list[TrafficNews]]:
    """Return (driven Route, TrafficNews in order); `events` are in order, later ones ignored."""
    news, probability = [], None
    for event in sorted(events, key=lambda event: event.at_s):
        if event.at_s >= route.total_duration_s:
            continue
        route = _after(route, event)
        if event.kind is Kind.CANCEL_CHARGING:
            charging_planned = False
        if event.kind is Kind.CHARGING_PROBABILITY:
            probability = event.probability
        if event.route_plan_after_s is not None:
            at_s = event.at_s + event.route_plan_after_s
            rest = route.after(at_s) if at_s < route.total_duration_s else None
            news.append(TrafficNews(at_s, rest, charging_planned, probability))
    return route, news


def _after(route: Route, event: Event) -> Route:
    """Return the route as changed by an event."""
    at_s = event.at_s
    if event.kind in (Kind.CANCEL_CHARGING, Kind.CHARGING_PROBABILITY):
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
    """Return one segment of standing at the start of a route."""
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
    """From an instant of the drive [s] on, clock and stamps are off by an additional amount [s]."""

    at_s: float
    by_s: float


def clock_offset_s(jumps: Sequence[ClockJump], instant_s: float) -> float:
    """Return the clock error at an instant of the drive [s]."""
    return math.fsum(jump.by_s for jump in jumps if jump.at_s <= instant_s)


# Noise is smoothed over this many segments.
SMOOTHED = 5
WEIGHTS = np.full(SMOOTHED, 1.0 / np.sqrt(SMOOTHED))


def vary(random: np.random.Generator, steps: int, mean: float, variability: float) -> FloatArray:
    """Return a positive series (steps,) about its mean; `variability` is the deviation of its logarithm."""
    smooth = np.convolve(random.normal(size=steps), WEIGHTS, mode='same')[:steps]
    series: FloatArray = mean * np.exp(variability * smooth - 0.5 * variability**2)
    return series


# Number of cycles of accelerating, braking and rolling within a segment.
CYCLES = 3


def with_cycles(route: Route) -> Route:
    """
    Return the route with the power of each segment in cycles of constant powers.

    In each cycle the car drives with a power, regenerates with the same and rolls; the durations follow from
    mean, root mean square and mean magnitude of the segment. Segments without variation stay.
    """
    rms_w, magnitude_w = route.propulsion_power_rms_w, route.propulsion_power_magnitude_w
    varies = route.propulsion_power_variance_w2 > 0.0
    safe_w = np.where(varies, magnitude_w, 1.0)
    # Shares of the time, shape (N, 3), that reproduce all three; the power is rms^2 / magnitude.
    power_w = np.where(varies, rms_w**2 / safe_w, route.propulsion_power_w)
    total = np.where(varies, safe_w**2 / np.maximum(rms_w, 1e-9)**2, 1.0)
    driving = np.where(varies, 0.5 * (magnitude_w + route.propulsion_power_w) / np.where(
        varies, power_w, 1.0), 1.0)
    shares = np.stack((driving, total - driving, 1.0 - total), axis=1)
    powers_w = np.stack((power_w, -power_w, np.zeros(len(route))), axis=1)
    parts = np.where(varies, CYCLES, 1)
    durations_s = np.repeat(shares * (route.duration_s / parts)[:, np.newaxis], parts, axis=0)
    columns = {field.name: np.repeat(getattr(route, field.name), 3 * parts) for field in fields(Route)}
    columns['duration_s'] = durations_s.ravel()
    columns['propulsion_power_w'] = np.repeat(powers_w, parts, axis=0).ravel()
    columns['propulsion_power_rms_w'] = np.abs(columns['propulsion_power_w'])
    columns['propulsion_power_magnitude_w'] = columns['propulsion_power_rms_w']
    lasts = columns['duration_s'] > 1e-6
    return Route(**{name: values[lasts] for name, values in columns.items()})
