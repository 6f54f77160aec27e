# SPDX-License-Identifier: Apache-2.0
"""
The events that a step of the planner takes, and refused inputs; a refused input keeps the heater off for a time.

Plain data; `inbox.Inbox.admit` and the supervisor act on it. `source` names the input in log lines; '' if it
cannot be refused.

A refused battery state says nothing about the trip; the next valid one clears it. A refused route may have
been a cancellation or another trip: the previous route continues only if the readable part of the refused
route rules that out (docs/explanation/safety.md has the reasons).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import nan
from typing import ClassVar, NamedTuple, Self, TYPE_CHECKING

from bev_preheat.control.heater import HEATER_STATUS, HeaterStatus, SOURCE_STATUS
from bev_preheat.control.inputs import Measurement, Mission, Progress
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.vehicle.description import HVCH, Vehicle

if TYPE_CHECKING:
    from bev_preheat.estimation.prior import Learned

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
        """Return the Refusals with that of a route, and whether the previous route, if any, may continue."""
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


# Topics of the planner's inputs; an event of a message is recorded by its topic.
BATTERY_STATE, ROUTE_PLAN, ROUTE_PROGRESS, HVCH_STATUS = (
    'battery_state', 'route_plan', 'route_progress', 'hvch_status')


@dataclass(frozen=True)
class BatteryStateArrived:
    """A battery state arrived; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = BATTERY
    measurement: Measurement
    hint: str = ''


@dataclass(frozen=True)
class BatteryStateUnreadable:
    """A battery state arrived that could not be read; `percentage` is the message's own, NaN: none."""

    source: ClassVar[str] = BATTERY
    error: InvalidInput
    percentage: float = nan


@dataclass(frozen=True)
class RouteArrived:
    """A route plan arrived."""

    source: ClassVar[str] = ROUTE
    mission: Mission


@dataclass(frozen=True)
class RouteUnreadable:
    """A route plan arrived that could not be read, but for the part in `refused`."""

    source: ClassVar[str] = ROUTE
    error: InvalidInput
    refused: RefusedRoute = RefusedRoute()


@dataclass(frozen=True)
class TripCancelled:
    """A route plan arrived that cancels the trip."""

    source: ClassVar[str] = ROUTE


@dataclass(frozen=True)
class ProgressArrived:
    """The vehicle reported its place on the route; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = PROGRESS
    progress: Progress
    hint: str = ''


@dataclass(frozen=True)
class ProgressUnreadable:
    """A route progress arrived that could not be read."""

    source: ClassVar[str] = PROGRESS
    error: InvalidInput


@dataclass(frozen=True)
class HeaterStatusArrived:
    """The controller of the HVCH answered; of another heat source see below."""

    source: ClassVar[str] = HEATER_STATUS
    status: HeaterStatus
    name: str = HVCH


@dataclass(frozen=True)
class HeaterStatusUnreadable:
    """An answer of the controller of the HVCH arrived that could not be read."""

    source: ClassVar[str] = HEATER_STATUS
    error: InvalidInput
    name: str = HVCH


@dataclass(frozen=True)
class SourceStatusArrived(HeaterStatusArrived):
    """The controller of a heat source beside the HVCH answered."""

    source: ClassVar[str] = SOURCE_STATUS


@dataclass(frozen=True)
class SourceStatusUnreadable(HeaterStatusUnreadable):
    """An answer of the controller of a heat source beside the HVCH arrived that could not be read."""

    source: ClassVar[str] = SOURCE_STATUS


@dataclass(frozen=True)
class PreheatingSwitched:
    """The driver switched preheating on or off."""

    source: ClassVar[str] = ''
    is_enabled: bool


@dataclass(frozen=True)
class ActivationChanged:
    """A lifecycle manager activated the node or deactivated it; `why_not` is the sentence on an inactive one."""

    source: ClassVar[str] = ''
    is_active: bool
    why_not: str


@dataclass(frozen=True)
class PreparationWanted:
    """A goal of ~/prepare_battery arrived; it replaces the one before."""

    source: ClassVar[str] = 'prepare_battery'
    preparation_goal: PreparationGoal


@dataclass(frozen=True)
class PreparationEnded:
    """The goal of ~/prepare_battery `preparation_goal` ends; None: the current goal, whichever it is."""

    source: ClassVar[str] = ''
    preparation_goal: PreparationGoal | None
    ending: PreparationEnding
    explanation: str


@dataclass(frozen=True)
class DeparturesSkipped:
    """The driver skips the departures up to an instant [ns]; None: none."""

    source: ClassVar[str] = ''
    until_ns: int | None


@dataclass(frozen=True)
class RivalsChanged:
    """Other nodes command the same heater, by these `names`; '': no longer."""

    source: ClassVar[str] = ''
    names: str


@dataclass(frozen=True)
class Reconfigured:
    """
    Parameters were set.

    `mission` is the current route as read with the new parameters, or the InvalidInput if it cannot be read with
    them; None without a route. `learned` is the Learned that the estimation restarts with; None: keep the
    estimation if the vehicle does not change.
    """

    source: ClassVar[str] = ROUTE
    vehicle: Vehicle
    settings: Settings
    mission: Mission | InvalidInput | None = None
    learned: Learned | None = None


# The events of Supervisor.step.
Event = (BatteryStateArrived | BatteryStateUnreadable | RouteArrived | RouteUnreadable
         | ProgressArrived | ProgressUnreadable | HeaterStatusArrived | HeaterStatusUnreadable
         | SourceStatusArrived | SourceStatusUnreadable
         | TripCancelled | ActivationChanged | PreheatingSwitched | RivalsChanged
         | PreparationWanted | PreparationEnded | DeparturesSkipped | Reconfigured)
