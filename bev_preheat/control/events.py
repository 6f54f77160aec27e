# SPDX-License-Identifier: Apache-2.0
"""
The events that a step of the planner takes.

Plain data; `inbox.Inbox.admit` and the supervisor act on it. `source` names the input in log lines; '' if it
cannot be refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import nan
from typing import ClassVar, TYPE_CHECKING

from bev_preheat.control.heater_power import HEATER_STATUS, HeaterStatus
from bev_preheat.control.inputs import Measurement, Mission, Progress
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.control.refusals import BATTERY, PROGRESS, RefusedRoute, ROUTE
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.vehicle.description import Vehicle

if TYPE_CHECKING:
    from bev_preheat.estimation.prior import Learned

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
    """The heater's controller answered."""

    source: ClassVar[str] = HEATER_STATUS
    status: HeaterStatus


@dataclass(frozen=True)
class HeaterStatusUnreadable:
    """An answer of the heater's controller arrived that could not be read."""

    source: ClassVar[str] = HEATER_STATUS
    error: InvalidInput


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
         | TripCancelled | ActivationChanged | PreheatingSwitched | RivalsChanged
         | PreparationWanted | PreparationEnded | DeparturesSkipped | Reconfigured)
