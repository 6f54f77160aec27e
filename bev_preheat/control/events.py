# SPDX-License-Identifier: Apache-2.0
"""
Everything that a step of the planner can be given.

`deliver(inbox, now_ns)` hands an event to the Inbox and raises InvalidInput where it is refused;
`source` names the input in log lines, '' where it cannot be refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import ClassVar, TYPE_CHECKING

from bev_preheat.control.inputs import Measurement, Mission, Progress
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.refusals import BATTERY, PROGRESS, RefusedRoute, ROUTE
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle.description import Vehicle

if TYPE_CHECKING:
    from bev_preheat.control.inbox import Inbox
    from bev_preheat.estimation.prior import Learned


@dataclass(frozen=True)
class BatteryStateArrived:
    """A battery state arrived; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = BATTERY
    measurement: Measurement
    hint: str = ''

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Accept it, or refuse it with the hint."""
        try:
            inbox.accept_battery(self.measurement, now_ns)
        except InvalidInput as error:
            if not self.hint:
                raise
            BatteryStateUnreadable(
                InvalidInput([*error.problems, self.hint]),
                self.measurement.state.soc).deliver(inbox, now_ns)


@dataclass(frozen=True)
class BatteryStateUnreadable:
    """A battery state arrived that could not be read; `percentage` is the message's own, NaN: none."""

    source: ClassVar[str] = BATTERY
    error: InvalidInput
    percentage: float = nan

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Refuse it."""
        inbox.refuse_battery(self.error, self.percentage, now_ns)
        raise self.error


@dataclass(frozen=True)
class RouteArrived:
    """A route plan arrived."""

    source: ClassVar[str] = ROUTE
    mission: Mission

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Accept it, or refuse it."""
        inbox.accept_mission(self.mission)


@dataclass(frozen=True)
class RouteUnreadable:
    """A route plan arrived that could not be read, but for the part in `refused`."""

    source: ClassVar[str] = ROUTE
    error: InvalidInput
    refused: RefusedRoute = RefusedRoute()

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Refuse it."""
        inbox.refuse_route(self.error, self.refused)
        raise self.error


@dataclass(frozen=True)
class TripCancelled:
    """A route plan arrived that cancels the trip."""

    source: ClassVar[str] = ROUTE

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Drop the route."""
        inbox.cancel(now_ns)


@dataclass(frozen=True)
class ProgressArrived:
    """The vehicle said where on its route it is; `hint` is added to its refusal, '' adds nothing."""

    source: ClassVar[str] = PROGRESS
    progress: Progress
    hint: str = ''

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Accept it, or refuse it with the hint."""
        try:
            inbox.accept_progress(self.progress, now_ns)
        except InvalidInput as error:
            hints = [self.hint] if self.hint else []
            ProgressUnreadable(InvalidInput([*error.problems, *hints])).deliver(inbox, now_ns)


@dataclass(frozen=True)
class ProgressUnreadable:
    """A route progress arrived that could not be read."""

    source: ClassVar[str] = PROGRESS
    error: InvalidInput

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Refuse it."""
        inbox.refuse_progress(self.error)
        raise self.error


@dataclass(frozen=True)
class PreheatingSwitched:
    """The driver switched preheating on or off."""

    source: ClassVar[str] = ''
    is_enabled: bool

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Note it."""
        inbox.switch(self.is_enabled, now_ns)


@dataclass(frozen=True)
class PreparationWanted:
    """A goal of ~/prepare_battery arrived; it replaces the one before."""

    source: ClassVar[str] = 'prepare_battery'
    preparation_goal: PreparationGoal

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Pursue it, or refuse it; then all goes on as before."""
        inbox.preparation.begin(self.preparation_goal, inbox, now_ns)
        inbox.note_other_goal()


@dataclass(frozen=True)
class PreparationEnded:
    """A goal of ~/prepare_battery, `preparation_goal`, is not to be pursued any more; None: whichever it is."""

    source: ClassVar[str] = ''
    preparation_goal: PreparationGoal | None
    ending: PreparationEnding
    explanation: str

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Let it go."""
        if inbox.preparation.end(self.preparation_goal, self.ending, self.explanation, inbox):
            inbox.note_other_goal()


@dataclass(frozen=True)
class RivalsChanged:
    """Other nodes command the same heater, by these `names`; '': none does any more."""

    source: ClassVar[str] = ''
    names: str

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Note them."""
        inbox.rivals = self.names


@dataclass(frozen=True)
class Reconfigured:
    """
    Parameters were set.

    `mission` is the current route as read with the new parameters, or the InvalidInput where it
    cannot be read with them; None: there is no route.
    `learned` is the Learned that the estimation restarts with, None to keep it where the vehicle
    stays.
    """

    source: ClassVar[str] = ROUTE
    vehicle: Vehicle
    settings: Settings
    mission: Mission | InvalidInput | None = None
    learned: Learned | None = None

    def deliver(self, inbox: Inbox, now_ns: int) -> None:
        """Apply them; the route is refused where it does not fit the vehicle."""
        inbox.vehicle, inbox.settings = self.vehicle, self.settings
        if isinstance(self.mission, InvalidInput):
            inbox.drop_misfit(self.mission)
            raise self.mission
        if self.mission is not None:
            inbox.revise_mission(self.mission)


# What Supervisor.step is given.
Event = (BatteryStateArrived | BatteryStateUnreadable | RouteArrived | RouteUnreadable
         | ProgressArrived | ProgressUnreadable | TripCancelled | PreheatingSwitched | RivalsChanged
         | PreparationWanted | PreparationEnded | Reconfigured)
