# SPDX-License-Identifier: Apache-2.0
"""
The planner's inputs as topics: one table for the node, the flight recorder and replays.

An input of another kind is a row here, an event in `control/events.py` and its place in `control/inbox.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TYPE_CHECKING

from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import BATTERY_STATE, HVCH_STATUS, ROUTE_PLAN, ROUTE_PROGRESS
from bev_preheat.messages.battery_state import battery_event
from bev_preheat.messages.heater import heater_status_event
from bev_preheat.messages.route_progress import progress_event
from bev_preheat_msgs.msg import HvchStatus, RoutePlan, RouteProgress

if TYPE_CHECKING:
    from bev_preheat.control.events import Event
    from bev_preheat.control.state import State
    from bev_preheat.messages.route_intake import RouteIntake


class Reader(NamedTuple):
    """
    What reading a message may need: the planner's state, the messages of its routes, and a hint.

    `hint` is added to a refusal, '' adds nothing.
    """

    state: State
    routes: RouteIntake
    hint: str = ''


class Input(NamedTuple):
    """
    A topic: its message's type, its meaning as text ('': the type says it), and a message read as an event.

    `has_many_sources`: more than one publisher is no mistake.
    """

    message_type: Any
    words: str
    event: Callable[[Any, Reader], Event]
    has_many_sources: bool = False

    @property
    def type_name(self) -> str:
        """The name of the type, as ROS writes it."""
        return f'{self.message_type.__module__.partition(".")[0]}/msg/{self.message_type.__name__}'


INPUTS = {
    BATTERY_STATE: Input(BatteryState, '', lambda message, reader: battery_event(message, reader.hint)),
    ROUTE_PLAN: Input(RoutePlan, '', lambda message, reader: reader.routes.read(message, reader.state),
                      has_many_sources=True),
    ROUTE_PROGRESS: Input(RouteProgress, 'where the vehicle is, if known',
                          lambda message, reader: progress_event(message, reader.hint)),
    HVCH_STATUS: Input(HvchStatus, "the heater controller's answer, if there is one",
                       lambda message, reader: heater_status_event(
                           message, reader.state.vehicle.hvch.maximum_power_w)),
}
