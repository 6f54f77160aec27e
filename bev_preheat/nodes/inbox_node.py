# SPDX-License-Identifier: Apache-2.0
"""A node that hears battery state and route plan as the planner does, and refuses the same."""

from __future__ import annotations

from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import Event, RouteUnreadable
from bev_preheat.control.inbox import Inbox
from bev_preheat.control.settings import Settings
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.battery_state import battery_event
from bev_preheat.messages.inputs import RouteIntake
from bev_preheat.nodes.node import guarded, ProgramNode
from bev_preheat.nodes.parameters import Parameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.topics import BEST_EFFORT, RouteListener
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import RoutePlan

DEFAULTS = Settings()
VEHICLE = Parameter('vehicle', 'reference',
                    "Vehicle: a name in config/vehicles or a YAML file; the planner's own.")
INPUT_PARAMETERS = (
    Parameter('planning_step', DEFAULTS.planning_step_s,
              "Routes are planned in steps of this length; the planner's own", 's', (1.0, 300.0)),
    Parameter('battery_state_timeout', DEFAULTS.battery_state_timeout_s,
              'A battery state older than this is not used', 's', (0.1, 60.0)),
    Parameter('clock_tolerance', DEFAULTS.clock_tolerance_s,
              'A battery state may be stamped this far in the future', 's', (0.0, 10.0)),
)


class InboxNode(ProgramNode):
    """A node with an Inbox, and the latest refusals by source; its program has VEHICLE and INPUT_PARAMETERS."""

    def __init__(self, program: NodeProgram) -> None:
        super().__init__(program)
        vehicle = load_vehicle(self.values['vehicle'])
        self.hardware = vehicle.name
        self.inbox, self.routes = Inbox.empty(vehicle, self.settings()), RouteIntake()
        self.problems: dict[str, str] = {}
        self.create_subscription(BatteryState, 'battery_state', self._on_battery_state, BEST_EFFORT)
        RouteListener(self, self._on_route_plan, self._on_refused_route)

    def settings(self) -> Settings:
        """Return the Settings of the parameters; nothing is estimated."""
        return Settings(battery_state_timeout_s=self.values['battery_state_timeout'],
                        clock_tolerance_s=self.values['clock_tolerance'],
                        planning_step_s=self.values['planning_step'], estimation=False)

    @guarded
    def _on_battery_state(self, message: BatteryState) -> None:
        event = battery_event(message, self.setup.clock_hint(message.header.stamp, self.now_ns()))
        if self.accepts(event):
            self.on_event(event)

    @guarded
    def _on_route_plan(self, message: RoutePlan) -> None:
        if self.is_news(message):
            event = self.routes.read(message, self.inbox)
            if self.accepts(event):
                self.on_event(event)

    @guarded
    def _on_refused_route(self, error: InvalidInput) -> None:
        self.accepts(RouteUnreadable(error))

    def accepts(self, event: Event) -> bool:
        """Deliver an event to the inbox; return whether it was accepted, and log a refusal."""
        self.inbox, refusal = self.inbox.taken(event, self.now_ns())
        if refusal is None:
            self.problems.pop(event.source, None)
            return True
        # An error for the planner; here the car is not affected.
        self.problems[event.source] = f'{event.source} refused: {refusal}.'
        self.tell(f'{event.source} refused: {refusal}')
        return False

    def is_news(self, message: RoutePlan) -> bool:
        """Return whether a route plan is worth reading."""
        return True

    def on_event(self, event: Event) -> None:
        """Go on after an accepted event."""
