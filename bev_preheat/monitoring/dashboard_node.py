# SPDX-License-Identifier: Apache-2.0
"""`dashboard`: a live web page of running planners."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from bev_preheat.errors import InvalidInput
from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.planner_client import Controls
from bev_preheat.monitoring.planners import Planners, PLANNERS_PERIOD_S
from bev_preheat.monitoring.source import LiveSource
from bev_preheat.nodes.parameters import declare, Parameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.setup_watch import unknown_parameters
from bev_preheat.optional_packages import require
from bev_preheat.recording.battery_response import Unheated
from bev_preheat.vehicle import load_vehicle

PARAMETERS = (
    Parameter('address', '127.0.0.1', "The page's IP address: any other than a loopback address needs a token.",
              read_only=True),
    Parameter('port', 8080, "The page's port; 0: any free one.", limits=(0, 65535), read_only=True),
    Parameter('token', '', 'Asked for by the page: 16 to 256 visible ASCII characters, hard to guess. Empty: not '
              'asked for.', read_only=True, secret=True),
    Parameter('controls', False, 'Whether the page has buttons: preheating on or off, ready in …, cancel, skip '
              'the next departure.', read_only=True),
)
PROGRAM = NodeProgram(
    'dashboard', 'Serves a web page that shows running planners: what they do and why, with curves and, if '
    'allowed, buttons.', PARAMETERS,
    subscribes=(('preheat_plan', 'bev_preheat_msgs/PreheatPlan'), ('hvch_command', 'bev_preheat_msgs/HvchCommand'),
                ('heat_source_command', 'bev_preheat_msgs/HeatSourceCommand'),
                ('battery_state', 'sensor_msgs/BatteryState'),
                ('hvch_status', 'bev_preheat_msgs/HvchStatus: the delivered power'),
                ('route_plan', 'bev_preheat_msgs/RoutePlan: the reserve of charge'),
                ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))


class DashboardNode(Node):
    """Follows planners and serves the page; without parameter services, so that the token cannot be read."""

    def __init__(self) -> None:
        """Declare the parameters and start; raises InvalidInput if one is not allowed."""
        require('tornado')
        # Needs tornado.
        from bev_preheat.monitoring.server import PageServer
        super().__init__('dashboard', start_parameter_services=False)
        values = declare(self, PARAMETERS)
        for sentence in unknown_parameters(self):
            self.get_logger().warning(sentence)
        self._planners = Planners(self)
        self._source = LiveSource(self._planners.boards, self._planners.lock)
        self._vehicle_clients: dict[str, Any] = {}
        self._knows_vehicle: set[str] = set()
        self._vehicles: dict[str, str] = {}
        self._controls: Controls | None = None
        access = Access(values['address'], values['token'])
        self._server = PageServer(access, values['port'], self._source, self._planners.warn)
        if values['controls']:
            self._controls = Controls(self, self._source.note_outcome)
            self._source.ask_planner = self._controls.ask
        # Planners come and go in real time.
        self.create_timer(PLANNERS_PERIOD_S, self._planners.guarded('looking for planners', self._look),
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._server.start()
        self.get_logger().info(f'The page is at {self._server.url}' + (
            ', for those who know the token.' if access.needs_token else '.'))

    def last_words(self) -> None:
        """Close the port and all connections."""
        self._server.stop()

    def _look(self) -> None:
        back, forgotten = self._planners.look()
        self._knows_vehicle -= {*back, *forgotten}
        for name in forgotten:
            self._vehicles.pop(name, None)
            client = self._vehicle_clients.pop(name, None)
            if client is not None:
                self.destroy_client(client)
            if self._controls is not None:
                self._controls.disconnect(name)
        for name in self._planners.boards:
            if self._controls is not None:
                self._controls.connect(name)
            self._ask_for_vehicle(name)

    def _ask_for_vehicle(self, name: str) -> None:
        """Ask a planner once for its vehicle, from which the temperature without heating is computed."""
        if name not in self._vehicle_clients:
            self._vehicle_clients[name] = self.create_client(GetParameters, f'{name}/get_parameters')
        client = self._vehicle_clients[name]
        if name in self._knows_vehicle or not client.service_is_ready():
            return
        self._knows_vehicle.add(name)
        client.call_async(GetParameters.Request(names=['vehicle'])).add_done_callback(
            self._planners.guarded(f'{name}: its vehicle', lambda answered: self._on_vehicle(name, answered)))

    def _on_vehicle(self, name: str, answered: Any) -> None:
        board = self._source.boards.get(name)
        if board is None or answered.cancelled() or answered.exception() is not None:
            return
        values = answered.result().values
        unheated: Unheated | None = None
        try:
            if len(values) != 1 or values[0].type != ParameterType.PARAMETER_STRING:
                raise InvalidInput('the planner has no parameter vehicle')
            vehicle = values[0].string_value
            if self._vehicles.setdefault(name, vehicle) != vehicle:
                # The drive of another car, perhaps with other heat sources.
                self._vehicles[name] = vehicle
                with self._source.lock:
                    board.forget()
            unheated, problem = Unheated(load_vehicle(vehicle)), ''
        except InvalidInput as error:
            problem = f'Without the vehicle file no temperature without heating is shown: {error}'
        with self._source.lock:
            board.unheated, board.unheated_problem = unheated, problem
