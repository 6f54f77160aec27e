# SPDX-License-Identifier: Apache-2.0
"""A planner's messages and diagnostics as plain values; instants in seconds of the planner's clock."""

from __future__ import annotations

from bisect import bisect
from itertools import accumulate
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from bev_preheat.errors import shortened
from bev_preheat.messages.fields import seconds
from bev_preheat.messages.preheat_plan import session_texts

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticArray

    from bev_preheat_msgs.msg import PreheatPlan, RoutePlan

# No drive is longer [s].
LONGEST_DRIVE_S = 1e7
IN_DOUBT = ' in doubt since [s]'
SHARE = 'share of the command [1]'
LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')
# Messages come from any publisher; they must not fill the page.
LONGEST_TEXT, MOST_ENTRIES, MOST_DOUBTS, LONGEST_SOURCE = 600, 24, 12, 40


class PlanSeen(NamedTuple):
    """
    A PreheatPlan.

    `status` is the number of a planning.status.Status. Instants [s] are None if they are unset. Temperatures in
    deg C, charge 0 ... 1, charging times in s; NaN: unknown. The trajectories `times_s` (N + 1,) are instants,
    `temperatures_c` and `socs` are at them, `powers_w` (N,) and those of all heat sources by name, `sources_w`,
    between them; empty without a plan. `later_legs` is the number of legs after this one. `sessions` are the
    charging sessions with and without heating as text, () if the charger is unknown.
    """

    at_s: float
    route_id: str
    method: str
    status: int
    sentence: str
    heating_start_s: float | None
    heating_end_s: float | None
    arrival_s: float | None
    predicted_c: float
    deviation_k: float
    target_c: float
    most_c: float
    target_reason: str
    arrival_soc: float
    charging_s: float
    charging_unheated_s: float
    later_legs: int = 0
    times_s: tuple[float, ...] = ()
    temperatures_c: tuple[float, ...] = ()
    socs: tuple[float, ...] = ()
    powers_w: tuple[float, ...] = ()
    sources_w: Mapping[str, tuple[float, ...]] = {}
    sessions: tuple[str, ...] = ()


class EntrySeen(NamedTuple):
    """An entry of /diagnostics: name without the planner's, level (0 OK, 1 WARN, 2 ERROR, 3 STALE), values."""

    name: str
    level: int
    message: str
    values: dict[str, str]


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
    return PlanSeen(
        at_s=start_s, route_id=message.route_id, method=message.method, status=message.status,
        sentence=message.explanation,
        heating_start_s=_set_instant(message.heating_start) if message.heating_planned else None,
        heating_end_s=_set_instant(message.heating_end), arrival_s=_set_instant(message.arrival),
        predicted_c=message.predicted_arrival_temperature,
        deviation_k=message.predicted_arrival_temperature_deviation,
        target_c=message.target_battery_temperature, most_c=message.maximum_arrival_temperature,
        target_reason=message.target_reason,
        arrival_soc=message.predicted_arrival_soc, charging_s=message.charging_time,
        charging_unheated_s=message.charging_time_unheated, later_legs=len(message.later_arrival),
        times_s=tuple(start_s + each for each in after_s) if is_whole else (),
        temperatures_c=tuple(message.battery_temperature) if is_whole else (),
        socs=tuple(message.soc) if is_whole else (), powers_w=tuple(message.hvch_power) if is_whole else (),
        sources_w={shortened(name, LONGEST_SOURCE): powers_w[at * steps:(at + 1) * steps]
                   for at, name in enumerate(names)} if is_divided else {},
        sessions=session_texts(message) or ())


def route_seen(message: RoutePlan) -> RouteSeen:
    """Return the RouteSeen of a message."""
    return RouteSeen(tuple(message.stop_minimum_arrival_soc), len(message.stop_duration),
                     message.minimum_arrival_soc, tuple(accumulate(
                         message.segment_duration, initial=seconds(message.header.stamp)))[1:],
                     tuple(message.ambient_temperature))


def entries_seen(message: DiagnosticArray, planner: str) -> list[EntrySeen]:
    """Return the entries of a planner, by the full name of its node; [] if the message has none."""
    prefix = f'{planner.lstrip("/")}: '
    return [EntrySeen(status.name.removeprefix(prefix), status.level[0], status.message,
                      {item.key: item.value for item in status.values})
            for status in message.status if status.name.startswith(prefix)]


def _set_instant(stamp: Time) -> float | None:
    return None if (stamp.sec, stamp.nanosec) == (0, 0) else seconds(stamp)


class Departure(NamedTuple):
    """The next departure as text ('' for none), the state of its preparation, and the skipped departures."""

    next_words: str
    state: str
    skipped: str


class Diagnosis(NamedTuple):
    """
    The planner's entries as the page shows them.

    `is_enabled` is None if it is unknown, `goal` the goal of prepare_battery as text, '' for none; `departure` is
    None without departures. `heater_share` (0 ... 1) is the share of the command that the heater delivers by
    the planner's estimate.
    """

    entries: tuple[EntrySeen, ...] = ()
    regime: str = ''
    doubts: tuple[str, ...] = ()
    is_enabled: bool | None = None
    goal: str = ''
    departure: Departure | None = None
    heater_share: float = 1.0

    def as_dictionary(self) -> dict[str, Any]:
        """Return plain values for the page."""
        return {
            'entries': [[entry.name, level_name(entry.level), shortened(entry.message, LONGEST_TEXT)]
                        for entry in self.entries],
            'regime': self.regime, 'doubts': list(self.doubts), 'enabled': self.is_enabled, 'goal': self.goal,
            'departure': None if self.departure is None else self.departure._asdict()}


def diagnose(entries: Iterable[EntrySeen]) -> Diagnosis:
    """Return the Diagnosis of a planner's entries."""
    by_name: dict[str, EntrySeen] = {}
    for entry in entries:
        if len(by_name) < MOST_ENTRIES:
            by_name[entry.name] = entry
    values = {name: entry.values for name, entry in by_name.items()}
    signals, preheating, departures, heater = (
        values.get(name, {}) for name in ('signals', 'preheating', 'departures', 'heater'))
    doubts = tuple(shortened(key.removesuffix(IN_DOUBT), 60) for key in signals if key.endswith(IN_DOUBT))
    departure = None
    if 'departures' in by_name:
        departure = Departure(*(shortened(departures.get(key, ''), LONGEST_TEXT)
                                for key in ('next departure', 'state', 'skipped')))
    return Diagnosis(
        tuple(by_name[name] for name in sorted(by_name)), shortened(signals.get('regime', ''), 60),
        doubts[:MOST_DOUBTS], {'true': True, 'false': False}.get(preheating.get('enabled', '')),
        shortened(preheating.get('goal of prepare_battery', ''), LONGEST_TEXT), departure,
        _share(heater.get(SHARE, '')))


def _share(text: str) -> float:
    """Return a share as a number; 1 if the text has no number."""
    try:
        share = float(text)
    except ValueError:
        return 1.0
    return share if 0.0 <= share <= 1.0 else 1.0
