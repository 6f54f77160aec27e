# SPDX-License-Identifier: Apache-2.0
"""`dashboard`: a live web page of running planners."""

from __future__ import annotations

import sys
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, QoSReliabilityPolicy

from bev_preheat.dashboard.access import Access
from bev_preheat.dashboard.board import Board
from bev_preheat.dashboard.controls import Controls
from bev_preheat.dashboard.discovery import find_planners, surroundings_of
from bev_preheat.dashboard.ears import Ears
from bev_preheat.dashboard.messages import entries_seen, seconds
from bev_preheat.dashboard.source import LiveSource
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import declare, Parameter
from bev_preheat.nodes.process import run_node
from bev_preheat.optional_packages import require
from bev_preheat.replay.deviation import Unheated
from bev_preheat.vehicle import load_vehicle

if TYPE_CHECKING:
    from collections.abc import Callable

    from bev_preheat.dashboard.discovery import PlannerFound

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
                ('battery_state', 'sensor_msgs/BatteryState'),
                ('hvch_status', 'bev_preheat_msgs/HvchStatus: the delivered power'),
                ('route_plan', 'bev_preheat_msgs/RoutePlan: the reserve of charge'),
                ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))
ROUTES_PERIOD_S = 1.0
MOST_PLANNERS = 24
# A planner that has been gone for this time is no longer listed [s].
FORGOTTEN_AFTER_S = 900.0


class DashboardNode(Node):
    """
    Follows the planners of the ROS graph, and serves the page.

    It has no parameter services, so that the token cannot be read over ROS.
    """

    def __init__(self) -> None:
        """Declare the parameters and start; raises InvalidInput if one is not allowed."""
        require('tornado')
        # Needs tornado.
        from bev_preheat.dashboard.server import PageServer
        super().__init__('dashboard', start_parameter_services=False)
        self._news = RepetitionFilter()
        values = declare(self, PARAMETERS)
        self._source = LiveSource()
        self._found: dict[str, PlannerFound] = {}
        self._ears: dict[str, Ears] = {}
        self._vehicle_clients: dict[str, Any] = {}
        self._knows_vehicle: set[str] = set()
        self._gone_s: dict[str, float] = {}
        self._controls: Controls | None = None
        access = Access(values['address'], values['token'])
        self._server = PageServer(access, values['port'], self._shown(values), self._warn)
        self._server.start()
        self.get_logger().info(f'The page is at {self._server.url}' + (
            ', for those who know the token.' if access.needs_token else '.'))

    def _shown(self, values: dict[str, Any]) -> LiveSource:
        """Return the source of the page, and listen for it."""
        if values['controls']:
            self._controls = Controls(self, self._source.note_outcome)
            self._source.ask_planner = self._controls.ask
        self.create_subscription(
            DiagnosticArray, '/diagnostics', self._guarded('/diagnostics', self._on_diagnostics), QoSProfile(
                depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT))
        # Planners come and go in real time.
        self.create_timer(ROUTES_PERIOD_S, self._guarded('looking for planners', self._look),
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        return self._source

    def last_words(self) -> None:
        """Close the port and all connections."""
        self._server.stop()

    def _guarded(self, what: str, action: Callable[..., None]) -> Callable[..., None]:
        """Return an action that logs exceptions, because messages and answers come from any node."""
        def guarded(*arguments: Any) -> None:
            try:
                action(*arguments)
            except Exception as error:
                self._warn(f'{what}: {type(error).__name__}: {error}')
        return guarded

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        at_s, now_s = seconds(message.header.stamp), time.monotonic()
        for name, board in self._source.boards.items():
            entries = entries_seen(message, name)
            if entries:
                with self._source.lock:
                    board.see_diagnostics(at_s, entries, now_s)

    def _look(self) -> None:
        there, now_s = find_planners(self, self._found), time.monotonic()
        for name, planner in there.items():
            self._gone_s.pop(name, None)
            if self._found.get(name) != planner:
                self._follow(planner)
            if name not in self._source.boards:
                continue
            if not self._source.boards[name].around.is_there:
                # Restarted, perhaps with another vehicle.
                self._knows_vehicle.discard(name)
            self._ask_for_vehicle(name)
        for name in list(self._found):
            if name not in there and now_s - self._gone_s.setdefault(name, now_s) > FORGOTTEN_AFTER_S:
                self._forget(name)
        for name, board in self._source.boards.items():
            around = surroundings_of(self, name, name in there)
            with self._source.lock:
                board.around = around

    def _follow(self, planner: PlannerFound) -> None:
        name = planner.name
        if name in self._ears:
            self._ears.pop(name).close()
        elif len(self._source.boards) >= MOST_PLANNERS:
            self._warn(f'{name}: is not shown; the page has room for {MOST_PLANNERS} planners')
            return
        self._found[name] = planner
        board = self._source.boards.get(name) or Board()
        with self._source.lock:
            self._source.boards[name] = board
        self._ears[name] = Ears(self, planner, board, self._source.lock)
        if self._controls is not None:
            self._controls.connect(name)

    def _forget(self, name: str) -> None:
        self._ears.pop(name).close()
        self._knows_vehicle.discard(name)
        client = self._vehicle_clients.pop(name, None)
        if client is not None:
            self.destroy_client(client)
        if self._controls is not None:
            self._controls.disconnect(name)
        del self._found[name], self._gone_s[name]
        with self._source.lock:
            del self._source.boards[name]

    def _ask_for_vehicle(self, name: str) -> None:
        """Ask a planner once for its vehicle, from which the temperature without heating is computed."""
        if name not in self._vehicle_clients:
            self._vehicle_clients[name] = self.create_client(GetParameters, f'{name}/get_parameters')
        client = self._vehicle_clients[name]
        if name in self._knows_vehicle or not client.service_is_ready():
            return
        self._knows_vehicle.add(name)
        client.call_async(GetParameters.Request(names=['vehicle'])).add_done_callback(
            self._guarded(f'{name}: its vehicle', lambda answered: self._on_vehicle(name, answered)))

    def _on_vehicle(self, name: str, answered: Any) -> None:
        board = self._source.boards.get(name)
        if board is None or answered.cancelled() or answered.exception() is not None:
            return
        values = answered.result().values
        unheated: Unheated | None = None
        try:
            if len(values) != 1 or values[0].type != ParameterType.PARAMETER_STRING:
                raise InvalidInput('the planner has no parameter vehicle')
            unheated, problem = Unheated(load_vehicle(values[0].string_value)), ''
        except InvalidInput as error:
            problem = f'Without the vehicle file no temperature without heating is shown: {error}'
        with self._source.lock:
            board.unheated, board.unheated_problem = unheated, problem

    def _warn(self, sentence: str) -> None:
        if self._news.has(sentence):
            self.get_logger().warning(sentence)


def main() -> None:
    """Run the dashboard until a signal ends it."""
    sys.exit(run_node(DashboardNode, PROGRAM))


if __name__ == '__main__':
    main()
