# SPDX-License-Identifier: Apache-2.0
"""How long the heater waits for a new planner after the old one was killed while heating."""

from __future__ import annotations

import os
from statistics import median
from time import perf_counter
from typing import TYPE_CHECKING

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import BatteryState

from bev_preheat.control.inputs import Leg, Mission
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.route import load_route
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, RoutePlan
from bev_preheat_studies.cost.figures import Figure
from bev_preheat_studies.cost.process_cost import DOMAIN, EMPTY, planner_command, running

if TYPE_CHECKING:
    from collections.abc import Callable

RESTARTS = 10
STATE_PERIOD_S = 0.1
# Too short for the target: heating starts at once.
DRIVE_S = 1200.0
PATIENCE_S = 60.0
# After this time, no message of a killed process is in transit.
SILENCE_S = 0.3


class Car(Node):
    """Trip planner, battery and heater; they keep running while planners come and go."""

    def __init__(self) -> None:
        """Publish a latched route that needs heat at once, and battery states continuously."""
        super().__init__('car')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._routes = self.create_publisher(RoutePlan, 'route_plan', latched)
        self._states = self.create_publisher(BatteryState, 'battery_state', 1)
        self.create_subscription(HvchCommand, 'hvch_command', self._on_command, 1)
        self.heats = False
        route = load_route('reference', load_vehicle('reference').defaults)
        self._routes.publish(route_plan_message(Mission('restart', (Leg(
            route.after(route.total_duration_s - DRIVE_S),
            self.get_clock().now().nanoseconds, target_temperature_c=25.0),))))
        self.create_timer(STATE_PERIOD_S, self._send_state)

    def _send_state(self) -> None:
        state = BatteryState(temperature=-7.0, percentage=0.9)
        state.header.stamp = self.get_clock().now().to_msg()
        self._states.publish(state)

    def _on_command(self, message: HvchCommand) -> None:
        self.heats = message.battery_heating_power > 0.0

    def spin_while(self, condition: Callable[[], bool], patience_s: float) -> bool:
        """Spin while a condition holds; return whether it ended in time."""
        end = perf_counter() + patience_s
        while condition():
            if perf_counter() > end:
                return False
            rclpy.spin_once(self, timeout_sec=0.01)
        return True


def measure(log: Callable[[str], object]) -> list[Figure]:
    """Return the Figures; `log` takes a line of progress."""
    os.environ['ROS_DOMAIN_ID'] = DOMAIN
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init()
    try:
        figures = []
        for who, process in (('planner', planner_command()), ('empty node', EMPTY)):
            times_s = _restarts_s(process)
            log(f'{who}, process start to first heat: '
                + ', '.join(f'{time_s:.2f}' for time_s in sorted(times_s)) + ' s')
            figures += [Figure(f'restart after SIGKILL to first heat: {who}, {name}',
                               reduced(times_s), 's')
                        for name, reduced in (('least', min), ('median', median), ('most', max))]
        return figures
    finally:
        rclpy.try_shutdown()


def _restarts_s(process: list[str]) -> list[float]:
    """Return the times from a process's start to its first heat [s]; the first start does not count."""
    car = Car()
    times_s = []
    try:
        for _ in range(RESTARTS + 1):
            car.spin_while(lambda: True, SILENCE_S)
            car.heats = False
            started = perf_counter()
            with running(process) as running_process:
                if not car.spin_while(lambda: not car.heats, PATIENCE_S):
                    raise TimeoutError(f'no heat from a new process within {PATIENCE_S:g} s')
                times_s.append(perf_counter() - started)
                running_process.kill()
                running_process.wait()
        return times_s[1:]
    finally:
        car.destroy_node()
