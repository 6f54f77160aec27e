# SPDX-License-Identifier: Apache-2.0
"""Reads route plans: a route, a cancellation, or the readable part of an unreadable one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bev_preheat.control.events import RouteArrived, RouteUnreadable, TripCancelled
from bev_preheat.control.refusals import RefusedRoute
from bev_preheat.control.settings import defaults_of, MOST_STOPS
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.convert import (
    is_cancellation,
    LONGEST_ROUTE_ID,
    mission_from_message,
    nanoseconds,
    ROUTE_FIELDS,
)
from bev_preheat.nodes.stops import order_problems, value_problems
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.route.segments import LIMITS, MOST_SEGMENTS

if TYPE_CHECKING:
    from bev_preheat.control.inbox import Inbox
    from bev_preheat.control.inputs import Mission
    from bev_preheat.control.planner_state import PlannerState
    from bev_preheat.control.settings import Settings
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
             holder: PlannerState | Inbox) -> RouteArrived | TripCancelled | RouteUnreadable:
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

    def read_again(self, holder: PlannerState | Inbox, vehicle: Vehicle,
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


def refused_route_of(message: RoutePlan) -> RefusedRoute:
    """Return the RefusedRoute of a RoutePlan; untrustworthy fields count as unreadable."""
    return RefusedRoute(message.route_id[:LONGEST_ROUTE_ID + 1], message.charging_planned,
                        _arrivals_ns(message))


def _arrivals_ns(message: RoutePlan) -> tuple[int, ...] | None:
    """Return the instants [ns] at which the legs of a RoutePlan end, None if unreadable."""
    stamp, durations_s = message.header.stamp, message.segment_duration
    lengths = {len(getattr(message, name)) for name in ROUTE_FIELDS.values()} - {0}
    if (not len(durations_s) or max(lengths) > MOST_SEGMENTS
            or nanoseconds(stamp) <= 0 or stamp.nanosec >= NS_PER_S):
        return None
    # If the lengths of the arrays differ, the durations may be wrong.
    count = max(lengths)
    if len(durations_s) != count and lengths != {1, count}:
        return None
    durations_s = np.asarray(durations_s, dtype=float)
    low_s, high_s = LIMITS['duration_s']
    if not ((durations_s >= low_s) & (durations_s <= high_s)).all():
        return None
    after_segment, stops_s = message.stop_after_segment, message.stop_duration
    if (len(after_segment) > MOST_STOPS or len(stops_s) != len(after_segment)
            or order_problems(after_segment, count) or value_problems('stop_duration', stops_s)):
        return None
    ends_s = np.cumsum(np.broadcast_to(durations_s, count))
    arrivals_s = ends_s[[*after_segment, count - 1]]
    # Earlier stops delay the end of a leg.
    stood_s = np.concatenate(([0.0], np.cumsum(np.asarray(stops_s, dtype=float))))
    return tuple(nanoseconds(stamp) + round(float(seconds) * NS_PER_S)
                 for seconds in arrivals_s + stood_s)
