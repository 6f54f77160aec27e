# SPDX-License-Identifier: Apache-2.0
"""
The planner's inputs as topics: one table for the node, the flight recorder and replays; and route plans read.

An input of another kind is a row here, an event in `control/events.py` and its place in `control/inbox.py`.
A route plan is a route, a cancellation, or the readable part of an unreadable one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TYPE_CHECKING

from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import (
    BATTERY_STATE,
    ROUTE_PLAN,
    ROUTE_PROGRESS,
    RouteArrived,
    RouteUnreadable,
    TripCancelled,
)
from bev_preheat.control.heater import HEATER_STATUS, SOURCE_STATUS
from bev_preheat.control.settings import defaults_of
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.battery_state import battery_event
from bev_preheat.messages.heater import heater_status_event, source_status_event
from bev_preheat.messages.route_plan import is_cancellation, mission_from_message, refused_route_of
from bev_preheat.messages.route_progress import progress_event
from bev_preheat_msgs.msg import HeatSourceStatus, HvchStatus, RoutePlan, RouteProgress

if TYPE_CHECKING:
    from bev_preheat.control.events import Event
    from bev_preheat.control.inbox import Inbox
    from bev_preheat.control.inputs import Mission
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.state import State
    from bev_preheat.vehicle import Vehicle


class Input(NamedTuple):
    """
    A topic: message type, meaning, a message read as an event, whether many publishers are right, and depth.

    `event(message, state, routes, hint)` takes the planner's state, the RouteIntake, and a hint for refusals.
    """

    message_type: Any
    words: str
    event: Callable[[Any, State, RouteIntake, str], Event]
    has_many_sources: bool = False
    depth: int = 1

    @property
    def type_name(self) -> str:
        """The name of the type, as ROS writes it."""
        return f'{self.message_type.__module__.partition(".")[0]}/msg/{self.message_type.__name__}'


INPUTS = {
    BATTERY_STATE: Input(BatteryState, '', lambda message, state, routes, hint: battery_event(message, hint)),
    ROUTE_PLAN: Input(RoutePlan, '', lambda message, state, routes, hint: routes.read(message, state.inbox),
                      has_many_sources=True),
    ROUTE_PROGRESS: Input(RouteProgress, 'where the vehicle is, if known',
                          lambda message, state, routes, hint: progress_event(message, hint)),
    HEATER_STATUS: Input(HvchStatus, "the heater controller's answer, if there is one",
                         lambda message, state, routes, hint: heater_status_event(
                             message, state.vehicle.hvch.maximum_power_w)),
    SOURCE_STATUS: Input(HeatSourceStatus, 'the same of the other heat sources',
                         lambda message, state, routes, hint: source_status_event(message, state.vehicle),
                         has_many_sources=True, depth=20),
}


class RouteIntake:
    """Reads RoutePlans as events, and keeps them: a route is read again for other parameters."""

    def __init__(self) -> None:
        self._messages: dict[Mission, RoutePlan] = {}

    def message_of(self, mission: Mission | None) -> RoutePlan | None:
        """Return the message of a Mission; None if it is not retained."""
        return None if mission is None else self._messages.get(mission)

    def remember(self, mission: Mission, message: RoutePlan) -> None:
        """Retain the message of a Mission that was read before."""
        self._messages = {mission: message}

    def read(self, message: RoutePlan, inbox: Inbox) -> RouteArrived | TripCancelled | RouteUnreadable:
        """Return the event of a message, which an Inbox takes."""
        self._forget_all_but(inbox.latest_mission)
        if is_cancellation(message):
            return TripCancelled()
        try:
            return RouteArrived(self._mission(message, inbox.vehicle, inbox.settings))
        except InvalidInput as error:
            return RouteUnreadable(error, refused_route_of(message))
        except Exception as error:
            what = f'{type(error).__name__}: {error}' if str(error) else type(error).__name__
            return RouteUnreadable(InvalidInput(f'cannot be read: {what}'))

    def read_again(self, inbox: Inbox, vehicle: Vehicle, settings: Settings) -> Mission | InvalidInput | None:
        """Return the latest Mission for another vehicle or settings; InvalidInput: refused, None: no route."""
        self._forget_all_but(inbox.latest_mission)
        message = self.message_of(inbox.latest_mission)
        try:
            return None if message is None else self._mission(message, vehicle, settings)
        except InvalidInput as error:
            return error

    def _forget_all_but(self, kept: Mission | None) -> None:
        self._messages = {mission: message for mission, message in self._messages.items()
                          if mission is kept}

    def _mission(self, message: RoutePlan, vehicle: Vehicle, settings: Settings) -> Mission:
        mission = mission_from_message(
            message, defaults_of(vehicle, settings), settings.planning_step_s, vehicle)
        self._messages[mission] = message
        return mission
