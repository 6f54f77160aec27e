# SPDX-License-Identifier: Apache-2.0
"""A planner's messages and diagnostics as plain values; instants in seconds of the planner's clock."""

from __future__ import annotations

from bisect import bisect
from itertools import accumulate, islice
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.errors import shortened
from bev_preheat.messages.diagnostics import values_of
from bev_preheat.messages.fields import seconds

if TYPE_CHECKING:
    from collections.abc import Mapping

    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

    from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

# No drive is longer [s].
LONGEST_DRIVE_S = 1e7
IN_DOUBT = ' in doubt since [s]'
SHARE = 'share of the command [1]'
# Entries of `departures` that the page shows, by its names.
DEPARTURE = {'next_words': 'next departure', 'state': 'state', 'skipped': 'skipped'}
LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
# Messages come from any publisher; they must not fill the page.
LONGEST_TEXT, MOST_ENTRIES, MOST_DOUBTS, LONGEST_SOURCE = 600, 24, 12, 40


class PlanSeen(NamedTuple):
    """
    A PreheatPlan `message` with its curves.

    Instants [s]: `at_s` is its stamp, `heating_start_s` None without heating. The trajectories `times_s` (N + 1,)
    are instants, `temperatures_c` [deg C] and `socs` (0 ... 1) are at them, `powers_w` [W] (N,) and those of all
    heat sources by name, `sources_w`, between them; empty without a plan.
    """

    message: PreheatPlan
    at_s: float
    heating_start_s: float | None
    times_s: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    socs: tuple[float, ...] = ()
    powers_w: tuple[float, ...] = ()
    sources_w: Mapping[str, tuple[float, ...]] = {}


class RouteSeen(NamedTuple):
    """
    The reserves of charge (0 ... 1) that a route asks for on arrival: at each stop, and at its end.

    `ends_s` are the instants at which its segments end [s], `ambient_c` their ambient temperatures [deg C].
    """

    stop_reserves: tuple[float, ...]
    stops: int
    reserve: float
    ends_s: tuple[float, ...] = ()
    ambient_c: tuple[float, ...] = ()

    def ambient_at_c(self, at_s: float) -> float:
        """Return the ambient temperature at an instant [deg C]; NaN: unknown."""
        segment = min(bisect(self.ends_s, at_s), len(self.ambient_c) - 1)
        return self.ambient_c[segment] if self.ambient_c else math.nan

    def reserve_of_leg(self, later_legs: int) -> float:
        """Return the reserve at the end of the leg that has `later_legs` legs after it."""
        stop = self.stops - later_legs
        if later_legs <= 0 or not 0 <= stop < self.stops:
            return self.reserve
        return self.stop_reserves[stop] if stop < len(self.stop_reserves) else 0.0


def level_name(level: float) -> str:
    """Return the name of a level of /diagnostics; the nearest for one out of range."""
    return LEVELS[min(max(int(level), 0), len(LEVELS) - 1)]


def plan_seen(message: PreheatPlan) -> PlanSeen:
    """Return the PlanSeen of a message; trajectories that are no curve count as none."""
    start_s, after_s = seconds(message.header.stamp), message.time
    count = len(after_s)
    # An axis of time needs rising instants; NaN compares as false.
    is_whole = start_s > 0.0 and count > 1 and (
        len(message.battery_temperature) == len(message.soc) == count == len(message.hvch_power) + 1) and all(
            0.0 <= before < after < LONGEST_DRIVE_S for before, after in zip(after_s, after_s[1:]))
    names, steps, powers_w = message.heat_source_name, count - 1, tuple(message.heat_source_power)
    is_divided = is_whole and 0 < len(names) <= MOST_ENTRIES and len(powers_w) == steps * len(names)
    seen = PlanSeen(
        message, start_s, (seconds(message.heating_start) or None) if message.heating_planned else None)
    return seen if not is_whole else seen._replace(
        times_s=tuple(start_s + each for each in after_s), temperatures_c=tuple(message.battery_temperature),
        socs=tuple(message.soc), powers_w=tuple(message.hvch_power), sources_w={
            shortened(name, LONGEST_SOURCE): powers_w[at * steps:(at + 1) * steps]
            for at, name in enumerate(names)} if is_divided else {})


def route_seen(message: RoutePlan) -> RouteSeen:
    """Return the RouteSeen of a message."""
    return RouteSeen(tuple(message.stop_minimum_arrival_soc), len(message.stop_duration),
                     message.minimum_arrival_soc, tuple(accumulate(
                         message.segment_duration, initial=seconds(message.header.stamp)))[1:],
                     tuple(message.ambient_temperature))


def entries_seen(message: DiagnosticArray, planner: str) -> dict[str, DiagnosticStatus]:
    """Return the first MOST_ENTRIES entries of a planner, by the full name of its node, by part."""
    prefix = f'{planner.lstrip("/")}: '
    own = (status for status in message.status if status.name.startswith(prefix))
    return {status.name.removeprefix(prefix): status for status in islice(own, MOST_ENTRIES)}


class Diagnosis(NamedTuple):
    """
    The planner's entries as the page shows them.

    `entries` are name, level and text of each. `is_enabled` is None if it is unknown, `goal` the goal of
    prepare_battery as text, '' for none; `departure` has texts on the next and the skipped departures and the
    state of the preparation, None without departures. `heater_share` (0 ... 1) is the share of the command that
    the heater delivers by the planner's estimate.
    """

    entries: tuple[tuple[str, str, str], ...] = ()
    regime: str = ''
    doubts: tuple[str, ...] = ()
    is_enabled: bool | None = None
    goal: str = ''
    departure: dict[str, str] | None = None
    heater_share: float = 1.0

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for the page."""
        return {'entries': self.entries, 'regime': self.regime, 'doubts': self.doubts, 'enabled': self.is_enabled,
                'goal': self.goal, 'departure': self.departure}


def diagnose(entries: Mapping[str, DiagnosticStatus]) -> Diagnosis:
    """Return the Diagnosis of a planner's entries by part."""
    values = {name: values_of(status) for name, status in entries.items()}
    signals, preheating, departures, heater = (
        values.get(name, {}) for name in ('signals', 'preheating', 'departures', 'heater'))
    doubts = tuple(shortened(key.removesuffix(IN_DOUBT), 60) for key in signals if key.endswith(IN_DOUBT))
    return Diagnosis(
        tuple((name, level_name(status.level[0]), shortened(status.message, LONGEST_TEXT))
              for name, status in sorted(entries.items())), shortened(signals.get('regime', ''), 60),
        doubts[:MOST_DOUBTS], {'true': True, 'false': False}.get(preheating.get('enabled', '')),
        shortened(preheating.get('goal of prepare_battery', ''), LONGEST_TEXT),
        {shown: shortened(departures.get(key, ''), LONGEST_TEXT) for shown, key in DEPARTURE.items()}
        if 'departures' in entries else None, _share(heater.get(SHARE, '')))


def _share(text: str) -> float:
    """Return a share as a number; 1 if the text has no number."""
    try:
        share = float(text)
    except ValueError:
        return 1.0
    return share if 0.0 <= share <= 1.0 else 1.0
