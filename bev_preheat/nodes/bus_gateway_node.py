# SPDX-License-Identifier: Apache-2.0
"""`bus_gateway`: the battery's signals of CAN or VSS as `battery_state`, and the heater's command onto CAN."""

from __future__ import annotations

from queue import SimpleQueue
import sys
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from bev_preheat.bus.bus_clock import steady_s
from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.conditioning import ACTUATORS
from bev_preheat.bus.live_map import AMBIENT, load_live_map, SPEED
from bev_preheat.bus.vss_source import VssSource
from bev_preheat.errors import InvalidInput
from bev_preheat.nodes.bus_conditioning import BusConditioning
from bev_preheat.nodes.bus_messages import bus_entry, live_battery_message
from bev_preheat.nodes.command_line import NodeProgram
from bev_preheat.nodes.convert import time_message
from bev_preheat.nodes.heater_output import HeaterOutput
from bev_preheat.nodes.news import RepetitionFilter
from bev_preheat.nodes.parameters import declare, Parameter
from bev_preheat.nodes.process import run_node
from bev_preheat.nodes.setup_watch import DIAGNOSTICS_PERIOD_S, RESTART_S, SetupWatch
from bev_preheat.numerics.factors import NS_PER_S

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bev_preheat.bus.battery import LiveBattery
    from bev_preheat.bus.source import LiveSource

PARAMETERS = (
    Parameter('signals', '', 'Signal map with a part live: a name in config/signals or a YAML file.',
              read_only=True),
    Parameter('battery_state_period', 1.0, 'Period of battery_state', 's', (0.02, 60.0), read_only=True),
    Parameter('planner', 'planner', 'Name of the planner whose prepare_battery serves BatteryConditioning of VSS.',
              read_only=True),
    Parameter('longest_lease', 10.0, 'A command with a longer lease is refused', 's', (0.05, 60.0),
              read_only=True),
    Parameter('execute_commands', True, 'Write hvch_command to CAN if the map has heater_command. False: leave '
              'it to heater_controller, which also keeps the gates and the rate limit of the heater.',
              read_only=True),
)
PROGRAM = NodeProgram(
    'bus_gateway', 'Publishes the battery of a CAN bus (DBC) or of a VSS databroker as battery_state, and writes '
    "the heater's command to CAN.", PARAMETERS,
    subscribes=(('hvch_command', 'bev_preheat_msgs/HvchCommand: written to CAN if the map says so; with VSS, '
                 'whether it heats'),),
    publishes=(('battery_state', 'sensor_msgs/BatteryState'),
               ('vehicle_speed', 'std_msgs/Float64 [m/s], if the map has speed_mps'),
               ('hvch_status', 'bev_preheat_msgs/HvchStatus, if it writes the command'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')),
    actions=(('planner/prepare_battery',
              'bev_preheat_msgs/PrepareBattery (client): for BatteryConditioning of VSS'),))
# Stamps of one reading differ by less than this unless the clock was set [s].
SAME_STAMP_S = 0.05


class BusGatewayNode(Node):
    """
    Publishes the battery at a steady rate while its signals are valid, and nothing otherwise.

    Ages are measured on the monotonic clock; with use_sim_time on /clock.
    """

    def __init__(self) -> None:
        """Declare the parameters and open the bus; raises InvalidInput if the map does not fit."""
        super().__init__('bus_gateway')
        values = declare(self, PARAMETERS)
        if not values['signals']:
            raise InvalidInput('signals: is not given; name a signal map with a part live (signals:=my_car.yaml)')
        self._map = load_live_map(values['signals'])
        self._simulated = bool(self.get_parameter('use_sim_time').value)
        self._news = RepetitionFilter()
        self._latest_s = 0.0
        self._lacking: tuple[str, ...] = ()
        self._published, self._same = 0, (0.0, 0)
        self._battery: LiveBattery | None = None
        self._state_publisher = self.create_publisher(BatteryState, 'battery_state', 1)
        self._speed_publisher = (self.create_publisher(Float64, 'vehicle_speed', 1)
                                 if SPEED in self._map.sources else None)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # A timer on the system's clock would stand still after that was set back.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        subscribes = self._connect(values)
        self.create_timer(values['battery_state_period'], self._on_state,
                          clock=None if self._simulated else steady)
        self.create_timer(DIAGNOSTICS_PERIOD_S, self._on_diagnostics, clock=steady)
        publishes = ('battery_state', *(() if self._output is None else ('hvch_status',)),
                     *(() if self._speed_publisher is None else ('vehicle_speed',)))
        self._setup = SetupWatch(self, subscribes, publishes, single=(*publishes, *subscribes))
        self._source.start()
        self.get_logger().info(f'Signal map {self._map.signals.name}: {self._source.name}')

    def _connect(self, values: Mapping[str, Any]) -> list[str]:
        """Make the source, and the way back to the bus; return the subscribed topics."""
        self._source: LiveSource
        self._output: HeaterOutput | None = None
        self._conditioning: BusConditioning | None = None
        if self._map.vss is None:
            source = CanSource(self._map, self._now_s)
            self._source = source
            if source.heater_frame is None or not values['execute_commands']:
                return []
            self._output = HeaterOutput(self, source, values['longest_lease'], self._now_s, self._tell)
            return ['hvch_command']
        if not self._map.vss.conditioning:
            self._source = VssSource(self._map, self._now_s, lambda values: None)
            return []
        requests: SimpleQueue[Mapping[str, Any]] = SimpleQueue()
        broker = VssSource(self._map, self._now_s, requests.put, ACTUATORS)
        self._source = broker
        self._conditioning = BusConditioning(self, values['planner'], broker, requests, values['longest_lease'])
        return ['hvch_command']

    def _now_s(self) -> float:
        """Return the instant [s] on the clock of the readings; called by the bus's thread, too."""
        if self._simulated:
            return float(self.get_clock().now().nanoseconds) / NS_PER_S
        return steady_s()

    def _refuse(self, sentence: str) -> None:
        self._tell(True, sentence)

    def _tell(self, is_refused: bool, sentence: str) -> None:
        if not self._news.has(sentence):
            return
        # One call for each severity: rclpy raises if a line of code logs with a second one.
        if is_refused:
            self.get_logger().warning(sentence)
        else:
            self.get_logger().info(sentence)

    # Battery state

    def _on_state(self) -> None:
        now_s = self._now_s()
        if now_s < self._latest_s - RESTART_S:
            self.get_logger().warning(f'The clock fell back by {self._latest_s - now_s:.1f} s: all readings are '
                                      'dropped.')
            self._source.forget()
        self._latest_s = now_s
        self._battery, self._lacking = self._source.battery(now_s)
        if self._conditioning is not None:
            self._conditioning.has_battery = self._battery is not None
            self._conditioning.is_plugged_in = self._battery is not None and bool(self._battery.is_charging)
            self._conditioning.ambient_c = self._source.value(AMBIENT, now_s)
        speed_mps = None if self._speed_publisher is None else self._source.value(SPEED, now_s)
        if self._speed_publisher is not None and speed_mps is not None:
            self._speed_publisher.publish(Float64(data=speed_mps))
        if self._battery is None or (self._simulated and now_s == 0.0):
            return
        stamp_ns = self._stamp_ns(self._battery.instant_s, now_s)
        if stamp_ns <= 0:
            return
        self._published += 1
        self._state_publisher.publish(live_battery_message(self._battery, time_message(stamp_ns)))

    def _stamp_ns(self, instant_s: float, now_s: float) -> int:
        """Return an instant on the readings' clock as ROS time [ns]."""
        stamp_ns = int(self.get_clock().now().nanoseconds) - round((now_s - instant_s) * NS_PER_S)
        same_s, same_ns = self._same
        if instant_s == same_s and abs(stamp_ns - same_ns) < SAME_STAMP_S * NS_PER_S:
            return same_ns
        self._same = (instant_s, stamp_ns)
        return stamp_ns

    # Diagnostics

    def _on_diagnostics(self) -> None:
        now_s, name, hardware = self._now_s(), self.get_fully_qualified_name(), self._map.signals.name
        problem, battery = self._source.problem, self._battery
        lacking = [f'battery_state is not published: {sentence}' for sentence in self._lacking[:1]]
        lacking += self._lacking[1:]
        doubts = list(self._source.doubts(now_s).values())
        for sentence in ([f'{self._source.name}: {problem}'] if problem else [*lacking, *doubts]):
            self._refuse(sentence)
        message = DiagnosticArray(status=[
            bus_entry(name, 'bus', hardware, [f'{self._source.name}: {problem}'] if problem else [], [],
                      f'{self._source.name}: works', self._source.figures()),
            bus_entry(name, 'signals', hardware, lacking,
                      [*doubts, *(() if battery is None else battery.missing)], 'all signals are valid',
                      self._figures(battery, now_s)),
            self._setup.entry(hardware)])
        for part in (self._output, self._conditioning):
            if part is not None:
                message.status.append(part.entry(name, hardware))
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(message)

    def _figures(self, battery: LiveBattery | None, now_s: float) -> dict[str, str]:
        figures = {'published battery states': str(self._published)}
        if battery is not None:
            figures['age of the oldest signal [s]'] = f'{now_s - battery.instant_s:.2f}'
        return figures

    # End

    def last_words(self) -> None:
        """Write 0 W, and close the bus."""
        for part in (self._output, self._conditioning):
            if part is not None:
                part.end()
        self._source.close()


def main() -> None:
    """Run the gateway until a signal ends it."""
    sys.exit(run_node(BusGatewayNode, PROGRAM))


if __name__ == '__main__':
    main()
