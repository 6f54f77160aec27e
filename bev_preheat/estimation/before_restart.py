# SPDX-License-Identifier: Apache-2.0
"""
What outlasts the planner's process: the battery's last state, the driver's choices, the trip's end.

Also how they are read from the state file.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.tunables import JUST_BEGUN_NS, NOWHERE_M, OLDEST_CHOICE_NS

if TYPE_CHECKING:
    from bev_preheat.files.checked_yaml import FileData

# Temperature range of road vehicle batteries [deg C].
TEMPERATURE_RANGE_C = (-100.0, 150.0)
LATEST_NS = 2**63 - 1


@dataclass(frozen=True)
class LastSeen:
    """
    Battery temperature [deg C] and state of charge (0 ... 1) at an instant.

    The instant is in nanoseconds since the epoch, by the clock of the node that saw them.
    """

    temperature_c: float
    soc: float
    stamp_ns: int


def last_seen_from(entry: FileData) -> LastSeen:
    """Return the LastSeen of an entry; raise InvalidInput, naming field, value and range."""
    if not isinstance(entry, dict):
        raise InvalidInput('last_seen: must have temperature_c, soc and stamp_ns')
    temperature_c, soc = (
        _number(entry.get(name), f'last_seen.{name}', *limits)
        for name, limits in (('temperature_c', TEMPERATURE_RANGE_C), ('soc', (0.0, 1.0))))
    return LastSeen(temperature_c, soc, instant_from(entry.get('stamp_ns'), 'last_seen.stamp_ns'))


def instant_from(value: object, name: str) -> int:
    """Return an instant [ns] of a file; raise InvalidInput, naming field, value and range."""
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= LATEST_NS:
        raise InvalidInput(f'{name}: {quoted(str(value))} is not allowed; it must be a whole number, '
                           f'0 ... {LATEST_NS}')
    return value


def _number(value: object, name: str, low: float, high: float) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise InvalidInput(f'{name}: {quoted(str(value))} is not allowed; it must be {low:g} ... {high:g}')
    return float(value)


@dataclass(frozen=True)
class CancelledTrip:
    """A cancelled route: its identification, the stamp of its message [ns], and the instant of cancelling [ns]."""

    route_id: str
    route_stamp_ns: int
    cancelled_ns: int

    def is_of(self, route_id: str, route_stamp_ns: int) -> bool:
        """Return whether a message with this identification and stamp [ns] is the cancelled one."""
        return (self.route_id, self.route_stamp_ns) == (route_id, route_stamp_ns)


@dataclass(frozen=True)
class EndedTrip:
    """
    A trip that has ended: identification and stamp [ns] of its latest route plan, and the instant of the end [ns].

    `is_observed`: a position or the charging showed the end; otherwise the planned time was over.
    """

    route_id: str
    route_stamp_ns: int
    ended_ns: int
    is_observed: bool

    def includes(self, route_id: str, route_stamp_ns: int, length_m: float, now_ns: int) -> bool:
        """
        Return whether a route plan that arrives at an instant [ns] belongs to this trip: it begins no other.

        That is the plan itself, received again; one with its route_id that is older than it, or than an end that
        was observed; and one with its route_id that leads no further than NOWHERE_M. If the end lies ahead, the
        clock was set back: then a plan that has just begun begins a trip, as in a simulation that was restarted.
        """
        age_ns, is_same = now_ns - self.ended_ns, route_stamp_ns == self.route_stamp_ns
        # A route without a route_id is never an update.
        if route_id != self.route_id or age_ns > OLDEST_CHOICE_NS or not (is_same or route_id):
            return False
        if age_ns < 0:
            return route_stamp_ns < now_ns - JUST_BEGUN_NS
        return is_same or length_m <= NOWHERE_M or route_stamp_ns < (
            max(self.ended_ns, self.route_stamp_ns) if self.is_observed else self.route_stamp_ns)


@dataclass(frozen=True)
class DriverChoices:
    """
    Instant when preheating was switched off [ns], None while it is on, and the trip cancelled last, if any.

    Departures up to `skipped_until_ns` [ns] are skipped; None: none is. `ended_trip` is the trip that has ended;
    None: the latest one has not.

    Instants are those of the node's clock.
    """

    switched_off_ns: int | None = None
    cancelled_trip: CancelledTrip | None = None
    skipped_until_ns: int | None = None
    ended_trip: EndedTrip | None = None

    def after_restart(self, now_ns: int) -> DriverChoices:
        """
        Return the choices still valid at an instant [ns]: those not older than OLDEST_CHOICE_NS.

        A choice in the future stays valid: the clock was set back, so its age is unknown. Departures are
        skipped until then, whatever the choice's age.
        """
        oldest_ns, trip = now_ns - OLDEST_CHOICE_NS, self.cancelled_trip
        skipped_ns = self.skipped_until_ns
        return DriverChoices(
            None if self.switched_off_ns is None or self.switched_off_ns < oldest_ns
            else self.switched_off_ns,
            None if trip is None or trip.cancelled_ns < oldest_ns else trip,
            None if skipped_ns is None or skipped_ns < now_ns else skipped_ns,
            # Its age is checked when a route plan arrives: until then a simulated clock may stand at 0.
            self.ended_trip)


NO_CHOICES = DriverChoices()


def choices_from(entry: FileData) -> DriverChoices:
    """Return the DriverChoices of an entry; raise InvalidInput, naming field, value and range."""
    if not isinstance(entry, dict):
        raise InvalidInput('driver: must have switched_off_ns and cancelled_trip')
    off_ns, trip, skipped_ns, ended = (entry.get(name) for name in (
        'switched_off_ns', 'cancelled_trip', 'skipped_until_ns', 'ended_trip'))
    return DriverChoices(
        None if off_ns is None else instant_from(off_ns, 'driver.switched_off_ns'),
        None if trip is None else _trip_from(trip),
        None if skipped_ns is None else instant_from(skipped_ns, 'driver.skipped_until_ns'),
        None if ended is None else _ended_from(ended))


def _trip_from(entry: FileData) -> CancelledTrip:
    if not isinstance(entry, dict) or not isinstance(entry.get('route_id'), str):
        raise InvalidInput('driver.cancelled_trip: must have route_id, route_stamp_ns and cancelled_ns')
    return CancelledTrip(entry['route_id'], *(
        instant_from(entry.get(name), f'driver.cancelled_trip.{name}')
        for name in ('route_stamp_ns', 'cancelled_ns')))


def _ended_from(entry: FileData) -> EndedTrip:
    if not isinstance(entry, dict) or not isinstance(entry.get('route_id'), str) or not isinstance(
            entry.get('is_observed'), bool):
        raise InvalidInput('driver.ended_trip: must have route_id, route_stamp_ns, ended_ns and is_observed')
    stamp_ns, ended_ns = (instant_from(entry.get(name), f'driver.ended_trip.{name}')
                          for name in ('route_stamp_ns', 'ended_ns'))
    return EndedTrip(entry['route_id'], stamp_ns, ended_ns, entry['is_observed'])
