# SPDX-License-Identifier: Apache-2.0
"""
Refused inputs, and for how long each keeps the heater off.

A refused battery state says nothing about the trip; the next valid one clears it. A refused route may have
been a cancellation or another trip: the previous route continues only if the readable part of the refused
route rules that out (docs/explanation/safety.md has the reasons).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Self, TYPE_CHECKING

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


class _Refusal(NamedTuple):
    source: str
    sentence: str
    until: Until
    holds: bool = True


class Refusals(NamedTuple):
    """
    Refusals not yet cleared, the latest last: at most one per source; a value.

    Each holds the heater off until its `Until` arrives. The refusal of a route is remembered after that, until a
    valid route arrives.
    """

    in_order: tuple[_Refusal, ...] = ()

    @property
    def obstacle(self) -> str | None:
        """The sentence of the latest refusal that holds the heater off; None if none does."""
        return next((refusal.sentence for refusal in reversed(self.in_order) if refusal.holds), None)

    @property
    def route(self) -> str | None:
        """The sentence of the refused route, until a valid one arrives; None without a refused route."""
        return next((refusal.sentence for refusal in self.in_order if refusal.source == ROUTE), None)

    def of_battery(self, error: InvalidInput) -> Refusals:
        """Return the Refusals with that of a battery state."""
        return self._with(_Refusal(BATTERY, f'{BATTERY} refused: {error}', Until.VALID_STATE))

    def of_route(self, error: InvalidInput, refused: RefusedRoute, mission: Mission | None,
                 now_ns: int) -> tuple[Refusals, bool]:
        """
        Return the Refusals with that of a route, and whether the previous route may continue.

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
        return self._with(_Refusal(ROUTE, f'{ROUTE} refused: {error}. {consequence}', until)), not objection

    def of_misfit(self, error: InvalidInput) -> Refusals:
        """Return the Refusals with that of a current route that does not fit a new vehicle or new settings."""
        return self._with(_Refusal(VEHICLE, f'{ROUTE} refused: {error}', Until.VALID_ROUTE))

    def after_battery(self) -> Refusals:
        """Return the Refusals that a valid battery state leaves."""
        if not self.in_order:
            return self
        return Refusals(tuple(refusal._replace(holds=refusal.until is Until.VALID_ROUTE)
                              for refusal in self._without(BATTERY).in_order))

    def after_route(self) -> Refusals:
        """Return the Refusals that a valid route, or a cancellation, leaves."""
        return self._without(ROUTE, VEHICLE)

    def after_fit(self) -> Refusals:
        """Return the Refusals without a misfit, because the route fits the vehicle."""
        return self._without(VEHICLE)

    def _with(self, refusal: _Refusal) -> Refusals:
        return Refusals((*self._without(refusal.source).in_order, refusal))

    def _without(self, *sources: str) -> Refusals:
        return Refusals(tuple(refusal for refusal in self.in_order if refusal.source not in sources))
