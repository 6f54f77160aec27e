# SPDX-License-Identifier: Apache-2.0
"""Route plans on their way into a Supervisor: accepted, taken as a cancellation, or refused."""

import numpy as np

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.control.refusals import RefusedRoute
from bev_preheat.control.settings import MOST_STOPS
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.convert import (
    is_cancellation, LONGEST_ROUTE_ID, mission_from_message, nanoseconds, ROUTE_FIELDS)
from bev_preheat.nodes.stops import order_problems, value_problems
from bev_preheat.route.segments import LIMITS, MOST_SEGMENTS


class RouteIntake:
    """
    Gives RoutePlan messages to a Supervisor.

    `message` is the one that holds, and None where none does.
    """

    def __init__(self, supervisor):
        """Take the Supervisor."""
        self._supervisor = supervisor
        self.message = None

    def take(self, message):
        """Accept a route or a cancellation; raise InvalidInput where it was refused."""
        supervisor = self._supervisor
        if is_cancellation(message):
            supervisor.cancel()
            self.message = None
            return
        try:
            mission = self._mission(message)
        except InvalidInput as error:
            self.refuse(error, refused_route_of(message))
            raise
        except Exception as error:  # noqa: B902  what was not understood may be another trip
            self.refuse(InvalidInput(f'cannot be read: {type(error).__name__}'))
            raise
        try:
            supervisor.accept_mission(mission)
        except InvalidInput:
            self._forget_what_was_dropped()
            raise
        self.message = message

    def refuse(self, error, refused=RefusedRoute()):
        """Refuse a message with an InvalidInput; without a RefusedRoute nothing of it was read."""
        self._supervisor.refuse_route(error, refused)
        self._forget_what_was_dropped()

    def _forget_what_was_dropped(self):
        if self._supervisor.mission is None:
            self.message = None

    def revise(self):
        """Take the route that holds anew, after a change of vehicle or settings."""
        if self.message is not None:
            self._supervisor.revise_mission(self._mission(self.message))

    def _mission(self, message):
        supervisor = self._supervisor
        return mission_from_message(
            message, supervisor.defaults, supervisor.settings.planning_step_s)


def refused_route_of(message):
    """Return the RefusedRoute of a RoutePlan; what is not to be trusted counts as unreadable."""
    return RefusedRoute(message.route_id[:LONGEST_ROUTE_ID + 1], message.charging_planned,
                        _arrivals_ns(message))


def _arrivals_ns(message):
    """Return the instants [ns] at which the legs of a RoutePlan end, None where unreadable."""
    stamp, durations_s = message.header.stamp, message.segment_duration
    lengths = {len(getattr(message, name)) for name in ROUTE_FIELDS.values()} - {0}
    if (not len(durations_s) or max(lengths) > MOST_SEGMENTS
            or nanoseconds(stamp) <= 0 or stamp.nanosec >= NS_PER_S):
        return None
    # Of arrays that differ in length the duration may be the wrong one.
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
    # A leg ends later by the stops before it.
    stood_s = np.concatenate(([0.0], np.cumsum(np.asarray(stops_s, dtype=float))))
    return tuple(nanoseconds(stamp) + round(float(seconds) * NS_PER_S)
                 for seconds in arrivals_s + stood_s)
