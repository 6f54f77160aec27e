# SPDX-License-Identifier: Apache-2.0
"""`bus_gateway`: the battery's signals of CAN or VSS as `battery_state`, and the heater's command onto CAN."""

from __future__ import annotations

from collections.abc import Mapping
from queue import SimpleQueue
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from bev_preheat.bus.can_source import CanSource
from bev_preheat.bus.conditioning import ACTUATORS
from bev_preheat.bus.live_map import AMBIENT, load_live_map, SPEED
from bev_preheat.bus.source import LiveBattery, steady_s
from bev_preheat.bus.vss_source import VssSource
from bev_preheat.control.heater import SOURCE_STATUS
from bev_preheat.control.inputs import SupplyStatus
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.battery_state import battery_state_message
from bev_preheat.messages.diagnostics import judged
from bev_preheat.nodes.bus_conditioning import BusConditioning
from bev_preheat.nodes.heater_execution import CanHeater, HeaterExecution
from bev_preheat.nodes.node import guarded, ProgramNode
from bev_preheat.nodes.parameters import StartParameter
from bev_preheat.nodes.process import NodeProgram
from bev_preheat.nodes.setup_watch import RESTART_S
from bev_preheat.numerics import NS_PER_S
from bev_preheat.vehicle.description import HVCH
from bev_preheat.vehicle.heater_controller import HeaterLimits

PARAMETERS = (
    StartParameter('signals', '', 'Signal map with a part live: a name in config/signals or a YAML file.'),
    StartParameter('battery_state_period', 1.0, 'Period of battery_state', 's', (0.02, 60.0)),
    StartParameter('planner', 'planner', 'Name of the planner whose prepare_battery serves BatteryConditioning of '
                   'VSS.'),
    StartParameter('longest_lease', 10.0, 'A command with a longer lease is refused', 's', (0.05, 60.0)),
    StartParameter('execute_commands', True, 'Write commands to CAN if the map has their frames. False: leave it '
                   'to heater_controller, which also keeps the gates and the rate limit of the heater.'),
)
PROGRAM = NodeProgram(
    'bus_gateway', 'Publishes the battery of a CAN bus (DBC) or of a VSS databroker as battery_state, and writes '
    "the heater's command to CAN.", PARAMETERS,
    subscribes=(('hvch_command', 'bev_preheat_msgs/HvchCommand: written to CAN if the map says so; with VSS, '
                 'whether it heats'),
                ('heat_source_command', 'bev_preheat_msgs/HeatSourceCommand, for heat_sources of the map')),
    publishes=(('battery_state', 'sensor_msgs/BatteryState'),
               ('vehicle_speed', 'std_msgs/Float64 [m/s], if the map has speed_mps'),
               ('hvch_status', 'bev_preheat_msgs/HvchStatus, if it writes the command'),
               ('heat_source_status', 'bev_preheat_msgs/HeatSourceStatus, for heat_sources of the map'),
               ('/diagnostics', 'diagnostic_msgs/DiagnosticArray')),
    actions=(('planner/prepare_battery',
              'bev_preheat_msgs/PrepareBattery (client): for BatteryConditioning of VSS'),))
# Stamps of one reading differ by less than this unless the clock was set [s].
SAME_STAMP_S = 0.05


SUPPLY_STATUS = {None: SupplyStatus.UNKNOWN, True: SupplyStatus.CHARGING, False: SupplyStatus.DISCHARGING}


class BusGatewayNode(ProgramNode):
    """Publishes the battery at a steady rate while its signals are valid, and nothing otherwise."""

    def __init__(self) -> None:
        super().__init__(PROGRAM)
        if not self.values['signals']:
            raise InvalidInput('signals: is not given; name a signal map with a part live (signals:=my_car.yaml)')
        self._map = load_live_map(self.values['signals'])
        self.hardware = self._map.signals.name
        self._simulated = bool(self.get_parameter('use_sim_time').value)
        self._latest_s = 0.0
        self._lacking: tuple[str, ...] = ()
        self._published, self._same = 0, (0.0, 0)
        self._battery: LiveBattery | None = None
        self._state_publisher = self.create_publisher(BatteryState, 'battery_state', 1)
        self._speed_publisher = (self.create_publisher(Float64, 'vehicle_speed', 1)
                                 if SPEED in self._map.sources else None)
        self._heaters: dict[str, CanHeater] = {}
        self._executions: dict[str, HeaterExecution] = {}
        self._conditioning: BusConditioning | None = None
        self._source = self._connected(self.values)
        # A timer on the system's clock would stand still after that was set back.
        timer = self.create_timer if self._simulated else self.steady_timer
        timer(self.values['battery_state_period'], self._on_state)
        topics = dict(each.topics for each in self._executions.values())
        subscribes = [*topics, *(['hvch_command'] if self._conditioning else [])]
        publishes = ['battery_state', *topics.values()] + ['vehicle_speed'] * (self._speed_publisher is not None)
        # Each heat source may have a controller of its own.
        self.watch(subscribes, publishes, single=[
            topic for topic in (*publishes, *subscribes) if topic != SOURCE_STATUS])
        self._source.start()
        self.get_logger().info(f'Signal map {self.hardware}: {self._source.name}')

    def _connected(self, values: Mapping[str, Any]) -> CanSource | VssSource:
        """Return the source; make the way back to the bus, too."""
        if self._map.vss is None:
            source = CanSource(self._map, self._now_s)
            for name in source.frames if values['execute_commands'] else ():
                heater = self._heaters[name] = CanHeater(source, name)
                execution = self._executions[name] = HeaterExecution(
                    self, HeaterLimits(heater.maximum_w, longest_lease_s=values['longest_lease']),
                    heater, heater.obstacle, self.tell, name=name)
                self.steady_timer(heater.period_s, execution.apply)
            return source
        requests: SimpleQueue[Mapping[str, Any]] = SimpleQueue()
        broker = VssSource(self._map, self._now_s, requests.put, ACTUATORS)
        if self._map.vss.conditioning:
            self._conditioning = BusConditioning(
                self, values['planner'], broker, requests, values['longest_lease'])
        return broker

    def _now_s(self) -> float:
        """Return the instant [s] on the clock of the readings; called by the bus's thread, too."""
        return self.now_ns() / NS_PER_S if self._simulated else steady_s()

    # Battery state

    @guarded
    def _on_state(self) -> None:
        now_s = self._now_s()
        if now_s < self._latest_s - RESTART_S:
            self.get_logger().warning(f'The clock fell back by {self._latest_s - now_s:.1f} s: all readings are '
                                      'dropped.')
            self._source.forget()
        self._latest_s = now_s
        self._battery, self._lacking = self._source.battery(now_s)
        battery = self._battery
        if self._conditioning is not None:
            self._conditioning.has_battery = battery is not None
            self._conditioning.is_plugged_in = battery is not None and bool(battery.is_charging)
            self._conditioning.ambient_c = self._source.value(AMBIENT, now_s)
        speed_mps = None if self._speed_publisher is None else self._source.value(SPEED, now_s)
        if self._speed_publisher is not None and speed_mps is not None:
            self._speed_publisher.publish(Float64(data=speed_mps))
        if battery is None or (self._simulated and now_s == 0.0):
            return
        stamp_ns = self._stamp_ns(battery.instant_s, now_s)
        if stamp_ns > 0:
            self._published += 1
            self._state_publisher.publish(battery_state_message(
                stamp_ns, battery.temperature_c, battery.soc, battery.voltage_v, battery.current_a,
                SUPPLY_STATUS[battery.is_charging], battery.cells_c))

    def _stamp_ns(self, instant_s: float, now_s: float) -> int:
        """Return an instant on the readings' clock as ROS time [ns]."""
        stamp_ns = self.now_ns() - round((now_s - instant_s) * NS_PER_S)
        same_s, same_ns = self._same
        if instant_s == same_s and abs(stamp_ns - same_ns) < SAME_STAMP_S * NS_PER_S:
            return same_ns
        self._same = (instant_s, stamp_ns)
        return stamp_ns

    # Diagnostics

    def entries(self) -> list[DiagnosticStatus]:
        """Return the entries on bus, signals and requests; log their problems."""
        now_s, source, battery = self._now_s(), self._source, self._battery
        lacking = [f'battery_state is not published: {sentence}' for sentence in self._lacking[:1]]
        lacking += self._lacking[1:]
        doubts = list(source.doubts().values())
        problem = f'{source.name}: {source.problem}' if source.problem else ''
        for sentence in [problem] if problem else [*lacking, *doubts]:
            self.tell(sentence)
        figures = {'published battery states': str(self._published)}
        if battery is not None:
            figures['age of the oldest signal [s]'] = f'{now_s - battery.instant_s:.2f}'
        entries = [
            judged('bus', [problem], [], f'{source.name}: works', source.figures())
            if not self._heaters else next(iter(self._heaters.values())).entry(),
            judged('signals', lacking, [*doubts, *(() if battery is None else battery.missing)],
                   'all signals are valid', figures)]
        entries += [execution.entry('heater command' if each == HVCH else f'command to {each}')
                    for each, execution in self._executions.items()]
        if self._conditioning is not None:
            entries.append(self._conditioning.entry())
        return entries

    # End

    def last_words(self) -> None:
        """Write 0 W, and close the bus."""
        for execution in self._executions.values():
            execution.end('the gateway is shutting down')
        for heater in self._heaters.values():
            heater.end()
        if self._conditioning is not None:
            self._conditioning.end()
        self._source.close()
