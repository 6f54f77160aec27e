# SPDX-License-Identifier: Apache-2.0
"""
Refused inputs, and for how long each keeps the heater off.

A refused battery state says nothing about the trip; the next valid one clears it. A refused route may have
been a cancellation or another trip: the previous route continues only if the readable part of the refused
route rules that out (docs/explanation/safety.md has the reasons).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Self, TYPE_CHECKING

from bev_preheat.errors import InvalidInput, quoted

if TYPE_CHECKING:
    from bev_preheat.control.inputs import Mission

BATTERY, ROUTE, VEHICLE = 'battery_state', 'route_plan', 'vehicle'
PROGRESS = 'route_progress'
# Sums of the same durations in other steps differ by less.
ROUNDING_NS = 1_000_000


class Until(Enum):
    """The input that must arrive before the heater may be on again."""

    VALID_STATE = 'the next valid battery state'
    VALID_ROUTE = 'a valid route plan'


@dataclass(frozen=True)
class RefusedRoute:
    """
    The part of a refused route plan that decides whether the previous trip may continue.

    `arrivals_ns` are the instants [ns] at which its legs end, None if they cannot be read.
    """

    route_id: str = ''
    charging_planned: bool = False
    arrivals_ns: tuple[int, ...] | None = None

    @classmethod
    def of_mission(cls, mission: Mission) -> Self:
        """Return the RefusedRoute of a Mission that is readable but does not fit the vehicle."""
        return cls(mission.route_id, mission.legs[-1].charging_planned,
                   tuple(leg.arrival_ns for leg in mission.legs))

    def objection_to(self, mission: Mission, now_ns: int) -> str:
        """
        Return why a Mission must not continue after this refusal; '' if it may.

        It may if the refused route is an update of the same trip with no earlier arrivals: such an update does
        not call off the heating that the old route asks for.
        """
        if not self.route_id:
            return 'the refused route has no route_id'
        if self.route_id != mission.route_id:
            return (f'the refused route has another route_id, {quoted(self.route_id)} instead of '
                    f'{quoted(mission.route_id)}')
        if not self.charging_planned:
            return 'the refused route plans no charging'
        if self.arrivals_ns is None:
            return 'the arrival of the refused route cannot be read'
        before = [leg.arrival_ns for leg in mission.legs]
        if self._is_earlier(self.arrivals_ns[-1], before[-1]):
            return 'the refused route arrives earlier'
        # An update may omit stops that have been passed.
        before, after = ([arrival_ns for arrival_ns in arrivals_ns if arrival_ns > now_ns]
                         for arrivals_ns in (before, self.arrivals_ns))
        if len(after) != len(before) or any(map(self._is_earlier, after, before)):
            return 'the refused route has other stops, or arrives at one earlier'
        return ''

    @staticmethod
    def _is_earlier(instant_ns: int, other_ns: int) -> bool:
        return instant_ns < other_ns - ROUNDING_NS


@dataclass(frozen=True)
class _Refusal:
    sentence: str
    until: Until
    holds: bool = True


class Refusals:
    """
    Refusals not yet cleared, the latest last: at most one per source.

    Each holds the heater off until its `Until` arrives. The refusal of a route is remembered after that, until a
    valid route arrives.
    """

    def __init__(self) -> None:
        """Start without refusals."""
        self._by_source: dict[str, _Refusal] = {}

    @property
    def obstacle(self) -> str | None:
        """The sentence of the latest refusal that holds the heater off; None if none does."""
        if not self._by_source:
            return None
        holding = [refusal.sentence for refusal in self._by_source.values() if refusal.holds]
        return holding[-1] if holding else None

    @property
    def route(self) -> str | None:
        """The sentence of the refused route, until a valid one arrives; None without a refused route."""
        refusal = self._by_source.get(ROUTE)
        return refusal.sentence if refusal else None

    def note_battery(self, error: InvalidInput) -> None:
        """Note that a battery state was refused."""
        self._note(BATTERY, f'{BATTERY} refused: {error}', Until.VALID_STATE)

    def note_route(self, error: InvalidInput, refused: RefusedRoute, mission: Mission | None,
                   now_ns: int) -> bool:
        """
        Note that a route was refused; return whether the previous route may continue.

        `refused` is the RefusedRoute of the refused route, `mission` the previous route; None without one.
        """
        until = Until.VALID_ROUTE
        consequence = f'The heater is off until {until.value} arrives.'
        objection = 'no route came before it' if mission is None else refused.objection_to(mission, now_ns)
        if not objection:
            until = Until.VALID_STATE
            consequence = f'The previous route holds again from {until.value} on.'
        elif mission is not None:
            consequence = f'The previous route was dropped because {objection}. {consequence}'
        self._note(ROUTE, f'{ROUTE} refused: {error}. {consequence}', until)
        return not objection

    def note_misfit(self, error: InvalidInput) -> None:
        """Note that the current route does not fit a new vehicle or new settings."""
        self._note(VEHICLE, f'{ROUTE} refused: {error}', Until.VALID_ROUTE)

    def lift_by_battery(self) -> None:
        """Clear the refusals that a valid battery state ends."""
        if not self._by_source:
            return
        self._by_source.pop(BATTERY, None)
        self._by_source = {
            source: replace(refusal, holds=refusal.until is Until.VALID_ROUTE)
            for source, refusal in self._by_source.items()}

    def lift_by_route(self) -> None:
        """Clear the refusals that a valid route, or a cancellation, ends."""
        self._by_source.pop(ROUTE, None)
        self.lift_misfit()

    def lift_misfit(self) -> None:
        """Clear the misfit, because the route fits the vehicle."""
        self._by_source.pop(VEHICLE, None)

    def _note(self, source: str, sentence: str, until: Until) -> None:
        self._by_source.pop(source, None)
        self._by_source[source] = _Refusal(sentence, until)
