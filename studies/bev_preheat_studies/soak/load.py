# SPDX-License-Identifier: Apache-2.0
"""The input of a soak test (valid states, routes, and garbage), and the planner's output."""

from __future__ import annotations

from array import array
import math
import random
import time

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.timer import Timer
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.msg import HvchCommand, RoutePlan

CABIN_W = 1700.0
# One battery state in BAD_STATE_EVERY is garbage, and a share BAD_ROUTES of the routes; period of the routes [s];
# one route in HEATING_ROUTES needs heat.
BAD_STATE_EVERY = 300
BAD_ROUTES = 0.3
ROUTE_PERIOD_S = 4.0
HEATING_ROUTES = 4
# States that a busy computer could not send in time are sent later, at most this many seconds of them.
MOST_BEHIND_S = 0.1
SERVICE_PERIOD_S = 7.0
# The battery's response to the commands, made fast so that plans come and go [K/s per W].
HEATING_K_PER_J = 4e-6
COOLING_PER_S = 2e-3
AMBIENT_C = -8.0


class SoakLoad:
    """
    Publishes to a planner while its node spins, and records the answers.

    `commands` are the instants at which commands arrived [s, time.monotonic], `wrong` sentences on forbidden ones.
    """

    def __init__(self, node: Node, rate_hz: float, seed: int, heater_w: float) -> None:
        """Advertise and subscribe; `heater_w` is the heater's maximum [W]."""
        self._node, self._period_s = node, 1.0 / rate_hz
        self._timer: Timer | None = None
        self._random = random.Random(seed)
        self._most_w = heater_w - CABIN_W
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._states = node.create_publisher(BatteryState, 'battery_state', 1)
        self._routes = node.create_publisher(RoutePlan, 'route_plan', latched)
        self._enable = node.create_client(SetBool, 'planner/enable')
        self._set_parameters = node.create_client(SetParameters, 'planner/set_parameters')
        node.create_subscription(HvchCommand, 'hvch_command', self._on_command, 100)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 100)
        self.commands: list[float] = []
        self.wrong: list[str] = []
        self.states_sent = self.garbage_sent = self.routes_sent = self.calls = 0
        self.heating_commands = self.internal_errors = 0
        self._temperature_c, self._power_w = AMBIENT_C, 0.0
        self._next_state_s = self._next_route_s = self._next_call_s = -math.inf

    def start(self) -> None:
        """Start publishing."""
        self._timer = self._node.create_timer(
            self._period_s, self._on_due, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def stop(self) -> None:
        """End it."""
        if self._timer is not None:
            self._timer.cancel()

    @property
    def is_connected(self) -> bool:
        """Whether a planner is connected."""
        return (self._states.get_subscription_count() > 0
                and self._routes.get_subscription_count() > 0
                and self._node.count_publishers('hvch_command') > 0)

    def _on_due(self) -> None:
        now_s = time.monotonic()
        if now_s >= self._next_route_s:
            self._send_route()
            self._next_route_s = now_s + ROUTE_PERIOD_S * self._random.uniform(0.2, 1.8)
        if now_s >= self._next_call_s:
            self._call()
            self._next_call_s = now_s + SERVICE_PERIOD_S * self._random.uniform(0.5, 1.5)
        self._next_state_s = max(self._next_state_s, now_s - MOST_BEHIND_S)
        while self._next_state_s <= now_s:
            self._send_state()
            self._next_state_s += self._period_s

    def _stamp(self, ago_s: float = 0.0) -> Time:
        return time_message(self._node.get_clock().now().nanoseconds - round(ago_s * NS_PER_S))

    def _send_state(self) -> None:
        self._temperature_c += self._period_s * (
            HEATING_K_PER_J * self._power_w
            - COOLING_PER_S * (self._temperature_c - AMBIENT_C))
        message = BatteryState(temperature=self._temperature_c, percentage=0.75, voltage=395.0,
                               current=-45.0 - self._power_w / 395.0)
        message.header.stamp = self._stamp()
        if self.states_sent % BAD_STATE_EVERY == BAD_STATE_EVERY - 1:
            self.garbage_sent += 1
            kind = self._random.randrange(4)
            if kind == 0:
                message.temperature = math.nan
            elif kind == 1:
                message.percentage = 75.0
            elif kind == 2:
                message.temperature += 273.15
            else:
                message.header.stamp = self._stamp(self._random.choice((60.0, -60.0)))
        self._states.publish(message)
        self.states_sent += 1

    def _send_route(self) -> None:
        # Some routes are too short to wait with heating, so that there is always some heating.
        heats = self.routes_sent % HEATING_ROUTES == 0
        count = 20 if heats else self._random.choice((20, 60, 120, 300))
        message = RoutePlan(
            route_id=f'{self.routes_sent}', segment_duration=array('d', [30.0] * count),
            speed=array('d', [22.0]),
            propulsion_power=array('d', [self._random.uniform(-5e3, 30e3) for _ in range(count)]),
            ambient_temperature=array('d', [AMBIENT_C]), cabin_heating_power=array('d', [CABIN_W]),
            charging_planned=heats or self._random.random() < 0.9,
            target_battery_temperature=25.0 if heats else self._random.choice((0.0, 10.0, 25.0)))
        if self._random.random() < 0.3 and count > 20:
            middle = count // 2
            message.stop_after_segment = array('I', [middle])
            for field, value in (
                    ('stop_duration', 900.0), ('stop_target_battery_temperature', 20.0),
                    ('stop_minimum_arrival_soc', 0.1), ('departure_battery_temperature', 25.0),
                    ('departure_soc', 0.8)):
                setattr(message, field, array('d', [value]))
        message.header.stamp = self._stamp(self._random.uniform(0.0, 30.0))
        if not heats and self._random.random() < BAD_ROUTES:
            self.garbage_sent += 1
            wrong: tuple[tuple[str, float | list[float]], ...] = (
                ('speed', [-3.0]), ('propulsion_power', [math.nan] * count), ('speed', []),
                ('segment_duration', [0.0] * count), ('ambient_temperature', [270.0]),
                ('minimum_arrival_soc', 55.0))
            name, bad = self._random.choice(wrong)
            setattr(message, name, array('d', bad) if isinstance(bad, list) else bad)
        self._routes.publish(message)
        self.routes_sent += 1

    def _call(self) -> None:
        self.calls += 1
        if self._random.random() < 0.4:
            self._enable.call_async(SetBool.Request(data=False))
            self._enable.call_async(SetBool.Request(data=True))
            return
        name, value = self._random.choice((
            ('planning_step', 20.0), ('planning_step', 30.0), ('command_lease', -1.0),
            ('battery_state_timeout', math.nan), ('arrival_soc_margin', 0.05)))
        self._set_parameters.call_async(SetParameters.Request(parameters=[Parameter(
            name=name, value=ParameterValue(
                type=ParameterType.PARAMETER_DOUBLE, double_value=value))]))

    def _on_command(self, message: HvchCommand) -> None:
        self.commands.append(time.monotonic())
        self._power_w = message.battery_heating_power
        self.heating_commands += self._power_w > 0.0
        lease_s = (nanoseconds(message.valid_until) - nanoseconds(message.header.stamp)) / NS_PER_S
        if not 0.0 <= self._power_w <= self._most_w + 1e-6:
            self._note_wrong(f'{self._power_w} W is commanded; allowed is 0 ... {self._most_w} W')
        if not lease_s <= 2.5 + 1e-6:
            self._note_wrong(f'a lease of {lease_s:.3f} s')
        self.internal_errors += message.reason == HvchCommand.INTERNAL_ERROR

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.internal_errors += status.message.startswith('INTERNAL_ERROR')

    def _note_wrong(self, sentence: str) -> None:
        if len(self.wrong) < 100:
            self.wrong.append(sentence)
