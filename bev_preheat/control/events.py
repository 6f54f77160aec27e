# SPDX-License-Identifier: Apache-2.0
"""
The events that a step of the planner takes, and refused inputs; a refused input keeps the heater off for a time.

Plain data, on which `inbox.Inbox` and the supervisor act.

A refused battery state says nothing about the trip; the next valid one clears it. A refused route may have
been a cancellation or another trip: the previous route continues only if the readable part of the refused
route rules that out (docs/explanation/safety.md has the reasons).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import ClassVar, NamedTuple, Self

from bev_preheat.control.heater import HEATER_STATUS, HeaterStatus, SOURCE_STATUS
from bev_preheat.control.inputs import Measurement, Mission, Progress
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput, quoted
from bev_preheat.estimation.prior import Learned
from bev_preheat.vehicle.description import HVCH, Vehicle

# Topics of the planner's inputs, as those in `control.heater`; an event of a message is recorded by its topic.
BATTERY_STATE, ROUTE_PLAN, ROUTE_PROGRESS = 'battery_state', 'route_plan', 'route_progress'
# The source of the refusal of a current route that a new vehicle or new settings do not fit.
MISFIT = 'vehicle'
# Sums of the same durations in other steps differ by less.
ROUNDING_NS = 1_000_000


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
    until_valid_route: bool = True
    holds: bool = True


class Refusals(NamedTuple):
    """
    Refusals not yet cleared, the latest last: at most one per source; a value.

    Each holds the heater off until the next valid battery state, or `until_valid_route`. The refusal of a route is
    remembered after that, until a valid route arrives.
    """

    in_order: tuple[_Refusal, ...] = ()

    @property
    def obstacle(self) -> str | None:
        """The sentence of the latest refusal that holds the heater off; None if none does."""
        return next((refusal.sentence for refusal in reversed(self.in_order) if refusal.holds), None)

    @property
    def route(self) -> str | None:
        """The sentence of the refused route, until a valid one arrives; None without a refused route."""
        return next((refusal.sentence for refusal in self.in_order if refusal.source == ROUTE_PLAN), None)

    def of_battery(self, error: InvalidInput) -> Refusals:
        """Return the Refusals with that of a battery state."""
        return self._with(_Refusal(BATTERY_STATE, f'{BATTERY_STATE} refused: {error}', until_valid_route=False))

    def of_route(self, error: InvalidInput, refused: RefusedRoute, mission: Mission | None,
                 now_ns: int) -> tuple[Refusals, bool]:
        """Return the Refusals with that of a route, and whether the previous route, if any, may continue."""
        consequence = 'The heater is off until a valid route plan arrives.'
        objection = 'no route came before it' if mission is None else refused.objection_to(mission, now_ns)
        if not objection:
            consequence = 'The previous route holds again from the next valid battery state on.'
        elif mission is not None:
            consequence = f'The previous route was dropped because {objection}. {consequence}'
        return self._with(_Refusal(
            ROUTE_PLAN, f'{ROUTE_PLAN} refused: {error}. {consequence}', objection != '')), not objection

    def of_outdated_route(self, error: InvalidInput) -> Refusals:
        """Return the Refusals with that of an older route plan, which says nothing about the current trip."""
        holds = any(refusal.holds for refusal in self.in_order if refusal.source == ROUTE_PLAN)
        return self._with(_Refusal(
            ROUTE_PLAN, f'{ROUTE_PLAN} refused: {error}. The current route goes on.', False, holds))

    def of_misfit(self, error: InvalidInput) -> Refusals:
        """Return the Refusals with that of a current route that does not fit a new vehicle or new settings."""
        return self._with(_Refusal(MISFIT, f'{ROUTE_PLAN} refused: {error}'))

    def after_battery(self) -> Refusals:
        """Return the Refusals that a valid battery state leaves."""
        return Refusals(tuple(refusal._replace(holds=refusal.until_valid_route)
                              for refusal in self._without(BATTERY_STATE)))

    def after_route(self) -> Refusals:
        """Return the Refusals that a valid route, or a cancellation, leaves."""
        return Refusals(self._without(ROUTE_PLAN, MISFIT))

    def after_fit(self) -> Refusals:
        """Return the Refusals without a misfit, because the route fits the vehicle."""
        return Refusals(self._without(MISFIT))

    def _with(self, refusal: _Refusal) -> Refusals:
        return Refusals((*self._without(refusal.source), refusal))

    def _without(self, *sources: str) -> tuple[_Refusal, ...]:
        return tuple(refusal for refusal in self.in_order if refusal.source not in sources)


@dataclass(frozen=True)
class Event:
    """An event of `Supervisor.step`; `source` names the input in log lines, '' if it cannot be refused."""

    source: ClassVar[str] = ''


@dataclass(frozen=True)
class BatteryStateArrived(Event):
    """A battery state arrived; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = BATTERY_STATE
    measurement: Measurement
    hint: str = ''


@dataclass(frozen=True)
class BatteryStateUnreadable(Event):
    """A battery state arrived that could not be read; `percentage` is the message's own, NaN: none."""

    source: ClassVar[str] = BATTERY_STATE
    error: InvalidInput
    percentage: float = nan


@dataclass(frozen=True)
class RouteArrived(Event):
    """A route plan arrived."""

    source: ClassVar[str] = ROUTE_PLAN
    mission: Mission


@dataclass(frozen=True)
class RouteUnreadable(Event):
    """A route plan arrived that could not be read, but for the part in `refused`."""

    source: ClassVar[str] = ROUTE_PLAN
    error: InvalidInput
    refused: RefusedRoute = RefusedRoute()


@dataclass(frozen=True)
class TripCancelled(Event):
    """A route plan arrived that cancels the trip."""

    source: ClassVar[str] = ROUTE_PLAN


@dataclass(frozen=True)
class ProgressArrived(Event):
    """The vehicle reported its place on the route; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = ROUTE_PROGRESS
    progress: Progress
    hint: str = ''


@dataclass(frozen=True)
class ProgressUnreadable(Event):
    """A route progress arrived that could not be read."""

    source: ClassVar[str] = ROUTE_PROGRESS
    error: InvalidInput


@dataclass(frozen=True)
class HeaterStatusArrived(Event):
    """The controller of the HVCH answered; of another heat source see below."""

    source: ClassVar[str] = HEATER_STATUS
    status: HeaterStatus
    name: str = HVCH


@dataclass(frozen=True)
class HeaterStatusUnreadable(Event):
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
class PreheatingSwitched(Event):
    """The driver switched preheating on or off."""

    is_enabled: bool


@dataclass(frozen=True)
class ActivationChanged(Event):
    """A lifecycle manager activated the node or deactivated it; `why_not` is the sentence on an inactive one."""

    is_active: bool
    why_not: str


@dataclass(frozen=True)
class PreparationWanted(Event):
    """A goal of ~/prepare_battery arrived; it replaces the one before."""

    source: ClassVar[str] = 'prepare_battery'
    preparation_goal: PreparationGoal


@dataclass(frozen=True)
class PreparationEnded(Event):
    """The goal of ~/prepare_battery `preparation_goal` ends; None: the current goal, whichever it is."""

    preparation_goal: PreparationGoal | None
    ending: PreparationEnding
    explanation: str


@dataclass(frozen=True)
class DeparturesSkipped(Event):
    """The driver skips the departures up to an instant [ns]; None: none."""

    until_ns: int | None


@dataclass(frozen=True)
class RivalsChanged(Event):
    """Other nodes command the same heater, by these `names`; '': no longer."""

    names: str


@dataclass(frozen=True)
class Reconfigured(Event):
    """
    Parameters were set.

    `mission` is the current route as read with the new parameters, or the InvalidInput if it cannot be read with
    them; None without a route. `learned` is the Learned that the estimation restarts with; None: keep the
    estimation if the vehicle does not change.
    """

    source: ClassVar[str] = ROUTE_PLAN
    vehicle: Vehicle
    settings: Settings
    mission: Mission | InvalidInput | None = None
    learned: Learned | None = None
