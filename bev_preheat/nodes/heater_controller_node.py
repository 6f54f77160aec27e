# SPDX-License-Identifier: Apache-2.0
"""
Executes `hvch_command` by the rules of `vehicle.heater_controller`, and answers with `hvch_status`.

`main(output)` runs it with a car's own heater: `output(power_w)` sets the power [W] and returns the measured one
[W], or None. The executable writes the power to CAN by a signal map (`signals`); without one it has no heater
behind it and shows the rules only. With `heat_source` it executes `heat_source_command` of that source instead,
and answers with `heat_source_status`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
import sys
import time

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from bev_preheat.control.inputs import Measurement
from bev_preheat.errors import age_beyond, InvalidInput
from bev_preheat.messages.battery_state import measurement_from_message
from bev_preheat.messages.fields import known
from bev_preheat.nodes.heater_execution import HeaterExecution, open_can_heater, Output
from bev_preheat.nodes.node import LIFECYCLE, NOT_ACTIVE, ProgramNode
from bev_preheat.nodes.parameters import StartParameter
from bev_preheat.nodes.process import NodeProgram, run_node
from bev_preheat.nodes.topics import BEST_EFFORT
from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle import load_vehicle
from bev_preheat.vehicle.description import HeatingGates, HVCH
from bev_preheat.vehicle.heater_controller import HeaterLimits, Instant, Refusal, Verdict

PARAMETERS = (
    StartParameter('vehicle', 'reference', "Vehicle, for the heater's maximum power and heating_gates: a name in "
                   'config/vehicles or a YAML file.'),
    StartParameter('heat_source', '', "Execute heat_source_command for this name in the vehicle's heat_sources. "
                   'Empty: hvch_command.'),
    StartParameter('period', 0.1, 'The power is set this often', 's', (0.01, 1.0)),
    StartParameter('power_rise', 0.0, 'The power rises at most at this rate; it falls at once', 'W/s', (1.0, 1e6),
                   unset_means='no limit'),
    StartParameter('longest_lease', 10.0, 'A command with a longer lease is refused', 's', (0.05, 60.0)),
    StartParameter('clock_tolerance', 1.0, 'A command may be stamped this far in the future', 's', (0.0, 10.0)),
    StartParameter('command_deadline', 2.5, 'Deadline and liveliness requested of the publisher, at least its '
                   'command_lease', 's', (0.05, 60.0), unset_means='none requested'),
    StartParameter('battery_state_timeout', 5.0, 'heating_gates that look at the battery or the speed close if '
                   'the latest value is older than this', 's', (0.1, 60.0)),
    StartParameter('signals', '', "Signal map with the heater's frame on CAN: a name in config/signals or a YAML "
                   'file. Empty: no heater.'),
    LIFECYCLE,
)
PROGRAM = NodeProgram(
    'heater_controller', 'Executes the heater command within its lease and the limits, and reports the result.',
    PARAMETERS,
    subscribes=(('hvch_command', 'bev_preheat_msgs/HvchCommand'),
                ('heat_source_command', 'bev_preheat_msgs/HeatSourceCommand, with heat_source'),
                ('battery_state', 'sensor_msgs/BatteryState, if heating_gates look at the battery'),
                ('vehicle_speed', 'std_msgs/Float64 [m/s], if the vehicle heats only while it stands')),
    publishes=(('hvch_status', 'bev_preheat_msgs/HvchStatus'),
               ('heat_source_status', 'bev_preheat_msgs/HeatSourceStatus, with heat_source'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')))


class GateInputs:
    """Subscribes to the inputs of the gates; `topics` are the names."""

    def __init__(self, node: Node, gates: HeatingGates, timeout_s: float, tell: Callable[[str], None]) -> None:
        """Subscribe; values older than `timeout_s` [s] close the gates, and `tell` logs a sentence."""
        self._node, self._gates, self._timeout_s, self._tell = node, gates, timeout_s, tell
        self._measurement: Measurement | None = None
        self._measured_at_s = self._speed_at_s = -math.inf
        self._speed_mps = math.nan
        self.topics: list[str] = []
        if gates.looks_at_battery:
            node.create_subscription(BatteryState, 'battery_state', self.on_battery_state, BEST_EFFORT)
            self.topics.append('battery_state')
        if gates.only_while_standing:
            node.create_subscription(Float64, 'vehicle_speed', self._on_speed, BEST_EFFORT)
            self.topics.append('vehicle_speed')

    def on_battery_state(self, message: BatteryState) -> None:
        """Take a battery state in, or the reason for its refusal."""
        now_ns = self._node.get_clock().now().nanoseconds
        try:
            measurement = measurement_from_message(message)
            age_s, most_s = (now_ns - measurement.stamp_ns) / NS_PER_S, self._timeout_s
            if abs(age_s) > most_s:
                raise InvalidInput(f'header.stamp: the state is {age_beyond(age_s, most_s, most_s)}')
            self._measurement = replace(measurement, arrived_ns=now_ns)
        except InvalidInput as error:
            self._tell(f'battery_state refused: {error}')
            self._measurement = None
        self._measured_at_s = time.monotonic()

    def _on_speed(self, message: Float64) -> None:
        self._speed_mps, self._speed_at_s = message.data, time.monotonic()

    def verdict(self, now: Instant) -> Verdict:
        """Return the gates' Verdict; without the values that they need they are closed."""
        gates, now_s = self._gates, now.steady_ns / NS_PER_S
        soc = temperature_c = speed_mps = math.nan
        if gates.looks_at_battery:
            measurement = self._measurement
            if measurement is None or now_s - self._measured_at_s > self._timeout_s or not (
                    measurement.stamp_ns - now.clock_ns <= self._timeout_s * NS_PER_S
                    and now.clock_ns < measurement.expires_ns(self._timeout_s)):
                return Verdict(Refusal.OTHER, 'no valid battery_state, which heating_gates need')
            soc, temperature_c = measurement.state.soc, measurement.state.temperature_c
        if gates.only_while_standing:
            if now_s - self._speed_at_s > self._timeout_s:
                return Verdict(Refusal.OTHER, 'no vehicle_speed, which heating_gates need')
            speed_mps = self._speed_mps
        return gates.verdict(soc, temperature_c, speed_mps)


class HeaterControllerNode(ProgramNode):
    """Wires gates, lifecycle and a steady timer to a HeaterExecution and the heater's output."""

    def __init__(self, output: Output | None = None) -> None:
        super().__init__(PROGRAM)
        values, vehicle = self.values, load_vehicle(self.values['vehicle'])
        name = values['heat_source'] or HVCH
        self.hardware, most_w = vehicle.name, vehicle.most_w(name)
        self._can = open_can_heater(values['signals'], most_w, name) if values['signals'] else None
        self._bus_problem, self._is_active = '', not values['lifecycle']
        self._execution = HeaterExecution(
            self, HeaterLimits(most_w, known(values['power_rise']) or math.inf,
                               vehicle.steps_w(name), values['longest_lease'], values['clock_tolerance']),
            # Without a heater the executable shows the rules only.
            output or self._can or (lambda power_w: None), self._obstacle,
            self.tell, known(values['command_deadline']), name)
        self._gate_inputs = GateInputs(self, vehicle.gates_of(name), values['battery_state_timeout'], self.tell)
        if values['lifecycle']:
            self.manage(self._on_activation)
        self.steady_timer(min(values['period'], math.inf if self._can is None else self._can.period_s),
                          self._execution.apply)
        command, status = self._execution.topics
        self.watch((command, *self._gate_inputs.topics), (status,),
                   single=(command, status) if name == HVCH else (command,))
        of_source = '' if name == HVCH else f' of {name}'
        self.get_logger().info(
            f'Executing {command}{of_source} for vehicle {vehicle.name}, up to {most_w:g} W.')

    def _on_activation(self, is_active: bool) -> None:
        self._is_active = is_active
        self._execution.apply()

    def _obstacle(self, now: Instant) -> Verdict:
        """Return the Verdict of the car's own conditions."""
        if not self._is_active:
            return Verdict(Refusal.NOT_ACTIVE, NOT_ACTIVE)
        if self._can is not None and (fault := self._can.obstacle(now)).sentence:
            return fault
        return self._gate_inputs.verdict(now)

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entries on command and bus; log a new problem of the bus, also before the first command."""
        entries = [self._execution.entry('command')]
        if self._can is not None:
            entries.append(self._can.entry())
            problem = self._can.bus_problem
            if problem and not self._bus_problem:
                self.tell(problem)
            self._bus_problem = problem
        return entries

    def last_words(self) -> None:
        """Switch the heater off before the process ends, and say so."""
        self._execution.end('the controller is shutting down')
        if self._can is not None:
            self._can.end()
            self._can.close()


def main(output: Output | None = None) -> None:
    """Run the controller until a signal ends it; see the module on `output`."""
    sys.exit(run_node(lambda: HeaterControllerNode(output), PROGRAM))
