# SPDX-License-Identifier: Apache-2.0
"""RouteProgress: the vehicle's place on the route."""

from __future__ import annotations

from bev_preheat.control.events import ProgressArrived, ProgressUnreadable
from bev_preheat.control.inputs import Progress
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.fields import nanoseconds, route_id_problems, stamp_problems, time_message
from bev_preheat_msgs.msg import RouteProgress


def progress_event(message: RouteProgress, hint: str = '') -> ProgressArrived | ProgressUnreadable:
    """Return the event of a RouteProgress; `hint` is added to a refusal."""
    problems = []
    if message.distance == 0.0 and not message.has_distance:
        problems.append('distance: 0 counts as not given where has_distance is false; set it for a '
                        'vehicle that has not left the start')
    problems += route_id_problems(message.route_id) + stamp_problems(message.header.stamp)
    if problems:
        return ProgressUnreadable(InvalidInput([*problems, hint] if hint else problems))
    return ProgressArrived(Progress(
        message.distance, nanoseconds(message.header.stamp), message.route_id,
        nanoseconds(message.route_stamp) or None), hint)


def progress_message(progress: Progress) -> RouteProgress:
    """Return the RouteProgress of a Progress."""
    message = RouteProgress(route_id=progress.route_id, distance=progress.distance_m, has_distance=True,
                            route_stamp=time_message(progress.route_start_ns or 0))
    message.header.stamp = time_message(progress.stamp_ns)
    return message
