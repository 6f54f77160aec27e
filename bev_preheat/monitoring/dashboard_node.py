# SPDX-License-Identifier: Apache-2.0
"""
`dashboard`: a live web page of running planners.

They are found in the ROS graph by the types of their topics, whatever these are called. Subscriptions are best
effort and of depth 1, except for latched topics: a publisher never waits for this process, nor keeps samples for
it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
from threading import Lock
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.events import HeaterStatusArrived
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.battery_state import read_temperatures
from bev_preheat.messages.fields import seconds
from bev_preheat.messages.heater import heater_status_event
from bev_preheat.monitoring.access import Access
from bev_preheat.monitoring.board import Board
from bev_preheat.monitoring.planner_client import Controls
from bev_preheat.monitoring.seen import entries_seen, plan_seen, route_seen
from bev_preheat.monitoring.source import LiveSource
from bev_preheat.monitoring.view import Surroundings
from bev_preheat.nodes.node import RepetitionFilter
from bev_preheat.nodes.parameters import declare, Parameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.setup_watch import endpoint_name, unknown_parameters
from bev_preheat.nodes.topics import BEST_EFFORT, LARGEST_ROUTE_BYTES, LATCHED, MOST_SOURCES
from bev_preheat.optional_packages import require
from bev_preheat.recording.battery_response import Unheated
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HeatSourceCommand, HvchCommand, HvchStatus, PreheatPlan, RoutePlan

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

# The full names of a planner's topics by the type of their messages; '' if it has none.
Topics = dict[str, str]

PLAN, COMMAND, SOURCE, ROUTE, ANSWER = (f'bev_preheat_msgs/msg/{name}' for name in (
    'PreheatPlan', 'HvchCommand', 'HeatSourceCommand', 'RoutePlan', 'HvchStatus'))
BATTERY = 'sensor_msgs/msg/BatteryState'
CLOCK = '/clock'
# Of each heat source a command comes at the same instant.
SOURCES = QoSProfile(depth=MOST_SOURCES, reliability=QoSReliabilityPolicy.BEST_EFFORT)
# `look` is called so often [s].
PLANNERS_PERIOD_S = 1.0
MOST_PLANNERS = 24
# A planner that has been gone for this time is forgotten [s].
FORGOTTEN_AFTER_S = 900.0
# A killed planner stays in the graph for up to 20 s beside its successor [s].
RIVALS_AFTER_S = 25.0


class Planners:
    """
    Follows the planners of the ROS graph; `boards` has the Board of each by the full name of its node.

    `look` is to be called about once a second, in the thread of the node's callbacks;
    other threads read `boards` under `lock`.
    """

    def __init__(self, node: Node) -> None:
        """Listen to diagnostics."""
        self._node, self._news = node, RepetitionFilter()
        self.lock = Lock()
        self.boards: dict[str, Board] = {}
        self._found: dict[str, Topics] = {}
        self._subscriptions: dict[str, list[Any]] = {}
        self._gone_s: dict[str, float] = {}
        # When each was the only publisher of its plan [s].
        self._alone_s: dict[str, float] = {}
        node.create_subscription(
            DiagnosticArray, '/diagnostics', self.guarded('/diagnostics', self._on_diagnostics), QoSProfile(
                depth=10, reliability=QoSReliabilityPolicy.BEST_EFFORT))

    def look(self) -> tuple[list[str], list[str]]:
        """Look for planners; return those that came back, perhaps with another vehicle, and lost ones, by name."""
        there, now_s, back = find_planners(self._node, self._found), time.monotonic(), list[str]()
        for name, topics in there.items():
            self._gone_s.pop(name, None)
            if name in self.boards and not self.boards[name].around.is_there:
                back.append(name)
            if self._found.get(name) != topics:
                self._follow(name, topics)
        forgotten = [name for name in self._found
                     if name not in there and now_s - self._gone_s.setdefault(name, now_s) > FORGOTTEN_AFTER_S]
        for name in forgotten:
            self._unsubscribe(name)
            del self._found[name], self._gone_s[name], self._alone_s[name]
            with self.lock:
                del self.boards[name]
        for name, board in self.boards.items():
            followers = {endpoint_name(endpoint) for endpoint in self._node.get_subscriptions_info_by_topic(CLOCK)}
            around = Surroundings(name in there, name in followers, self._node.count_publishers(CLOCK) > 0,
                                  self._rivals(name, now_s))
            with self.lock:
                board.around = around
        return back, forgotten

    def _rivals(self, name: str, now_s: float) -> str:
        """Return the sentence on several publishers of a planner's plan that are there for RIVALS_AFTER_S."""
        topic = self._found[name][PLAN]
        publishers = sorted(endpoint_name(endpoint) for endpoint in self._node.get_publishers_info_by_topic(topic)
                            if endpoint.topic_type == PLAN)
        if len(publishers) < 2:
            self._alone_s[name] = now_s
        return '' if now_s - self._alone_s.setdefault(name, now_s) < RIVALS_AFTER_S else (
            f'{topic} has {len(publishers)} publishers, {", ".join(publishers)}; it must have one')

    def _follow(self, name: str, topics: Topics) -> None:
        if name in self._subscriptions:
            self._unsubscribe(name)
        elif len(self.boards) >= MOST_PLANNERS:
            self.warn(f'{name}: is not shown; there is room for {MOST_PLANNERS} planners')
            return
        self._found[name] = topics
        with self.lock:
            board = self.boards.setdefault(name, Board())
        # Publishers of other qualities of service are not worth a warning each.
        quiet = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._subscriptions[name] = [
            self._node.create_subscription(
                message, topics[kind], self.guarded(topics[kind], partial(self._take, board)), qos,
                raw=kind == ROUTE, event_callbacks=quiet)
            for kind, message, qos in (
                (COMMAND, HvchCommand, BEST_EFFORT), (SOURCE, HeatSourceCommand, SOURCES),
                (ANSWER, HvchStatus, BEST_EFFORT), (PLAN, PreheatPlan, LATCHED),
                (BATTERY, BatteryState, BEST_EFFORT),
                # A route may be published with any quality of service.
                (ROUTE, RoutePlan, LATCHED), (ROUTE, RoutePlan, BEST_EFFORT)) if topics[kind]]

    def _unsubscribe(self, name: str) -> None:
        for subscription in self._subscriptions.pop(name):
            self._node.destroy_subscription(subscription)

    def _take(self, board: Board, message: Any) -> None:
        """Fill a Board with a message of its planner, or of the planner's inputs; a route comes as bytes."""
        now_s = time.monotonic()
        with self.lock:
            if board.around.rivals and isinstance(message, HvchCommand | HeatSourceCommand | PreheatPlan):
                return
            match message:
                case HvchCommand():
                    board.see_command(seconds(message.header.stamp), message.battery_heating_power, message.reason,
                                      now_s, seconds(message.valid_until))
                case HeatSourceCommand():
                    board.see_source(seconds(message.header.stamp), message.name, message.battery_heating_power)
                case HvchStatus():
                    event = heater_status_event(message, math.inf)
                    if isinstance(event, HeaterStatusArrived):
                        board.see_answer(event.status)
                case PreheatPlan():
                    board.see_plan(plan_seen(message), now_s)
                case BatteryState():
                    board.see_battery(seconds(message.header.stamp), read_temperatures(message, []).battery_c,
                                      message.percentage, now_s)
                # The planner refuses longer ones unread, too.
                case bytes() if len(message) <= LARGEST_ROUTE_BYTES:
                    board.see_route(route_seen(deserialize_message(message, RoutePlan)))

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        at_s, now_s = seconds(message.header.stamp), time.monotonic()
        for name, board in self.boards.items():
            entries = entries_seen(message, name)
            if entries and not board.around.rivals:
                with self.lock:
                    board.see_diagnostics(at_s, entries, now_s)

    def guarded(self, what: str, action: Callable[..., None]) -> Callable[..., None]:
        """Return an action that logs exceptions, because messages and answers come from any node."""
        def guarded(*arguments: Any) -> None:
            try:
                action(*arguments)
            except Exception as error:
                self.warn(f'{what}: {type(error).__name__}: {error}')
        return guarded

    def warn(self, sentence: str) -> None:
        """Log a warning, once."""
        if self._news.has(sentence):
            self._node.get_logger().warning(sentence)


def find_planners(node: Node, known: dict[str, Topics]) -> dict[str, Topics]:
    """Return the Topics of planners that are there, by full name; `known` are those found before."""
    found: dict[str, Topics] = {}
    for topic, types in node.get_topic_names_and_types():
        if PLAN not in types:
            continue
        for endpoint in node.get_publishers_info_by_topic(topic):
            if endpoint.topic_type != PLAN or endpoint.node_name.startswith('_'):
                continue
            name = endpoint_name(endpoint)
            # Again each time, because some may be discovered later.
            topics = _examine(node, endpoint.node_name, endpoint.node_namespace, topic) or known.get(name)
            if topics is not None:
                found[name] = topics
    return found


def _examine(node: Node, name: str, namespace: str, plan_topic: str) -> Topics | None:
    try:
        out = node.get_publisher_names_and_types_by_node(name, namespace)
        into = node.get_subscriber_names_and_types_by_node(name, namespace)
    except NodeNameNonExistentError:
        # Its endpoints are known before its name.
        return None
    topics = {PLAN: plan_topic} | {
        kind: next((topic for topic, types in ends if kind in types), '')
        for ends, kind in ((out, COMMAND), (out, SOURCE), (into, BATTERY), (into, ROUTE), (into, ANSWER))}
    # Otherwise half discovered.
    return topics if topics[COMMAND] and topics[BATTERY] else None


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
