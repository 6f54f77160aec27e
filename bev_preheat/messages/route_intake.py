# SPDX-License-Identifier: Apache-2.0
"""Reads route plans: a route, a cancellation, or the readable part of an unreadable one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bev_preheat.control.events import RouteArrived, RouteUnreadable, TripCancelled
from bev_preheat.control.settings import defaults_of
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.route_plan import is_cancellation, mission_from_message, refused_route_of

if TYPE_CHECKING:
    from bev_preheat.control.inbox import Inbox
    from bev_preheat.control.inputs import Mission
    from bev_preheat.control.settings import Settings
    from bev_preheat.control.state import State
    from bev_preheat.vehicle import Vehicle
    from bev_preheat_msgs.msg import RoutePlan


class RouteIntake:
    """
    Reads RoutePlan messages as events for a Supervisor or an Inbox.

    It retains the messages, so that the current route can be read again with other parameters.
    """

    def __init__(self) -> None:
        """Start without a message."""
        self._messages: dict[Mission, RoutePlan] = {}

    def message_of(self, mission: Mission | None) -> RoutePlan | None:
        """Return the message of a Mission; None if it is not retained."""
        return None if mission is None else self._messages.get(mission)

    def remember(self, mission: Mission, message: RoutePlan) -> None:
        """Retain the message of a Mission that was read before."""
        self._messages = {mission: message}

    def read(self, message: RoutePlan,
             holder: State | Inbox) -> RouteArrived | TripCancelled | RouteUnreadable:
        """
        Return the event of a message: RouteArrived, TripCancelled or RouteUnreadable.

        `holder` is the Supervisor or Inbox that receives the event.
        """
        self._forget_all_but(holder.latest_mission)
        if is_cancellation(message):
            return TripCancelled()
        try:
            return RouteArrived(self._mission(message, holder.vehicle, holder.settings))
        except InvalidInput as error:
            return RouteUnreadable(error, refused_route_of(message))
        except Exception as error:
            what = f'{type(error).__name__}: {error}' if str(error) else type(error).__name__
            return RouteUnreadable(InvalidInput(f'cannot be read: {what}'))

    def read_again(self, holder: State | Inbox, vehicle: Vehicle,
                   settings: Settings) -> Mission | InvalidInput | None:
        """
        Return the holder's latest Mission, read for another vehicle or with other settings.

        Return the InvalidInput if it is invalid for these; None without a route.
        """
        self._forget_all_but(holder.latest_mission)
        message = self.message_of(holder.latest_mission)
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
