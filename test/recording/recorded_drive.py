# SPDX-License-Identifier: Apache-2.0
"""Flight recordings of simulated drives, made without DDS but with the messages and the writer of the node."""

from contextlib import suppress

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import BatteryState

from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.messages.battery_state import battery_event, reading_message
from bev_preheat.messages.inputs import RouteIntake
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.nodes.flight_recording import _kind
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.planner import DEFAULT_METHOD
from bev_preheat.planning.situation import BatteryState as Battery
from bev_preheat.planning.situation import Goal
from bev_preheat.recording.records import Beginning, command_values, event_values, GoalNumbers, RecordedStep
from bev_preheat.recording.writer import BEGINNING_CHANNEL, Entry, Recording, RecordingWriter, STEP_CHANNEL
from bev_preheat.route import load_route
from bev_preheat.simulation.heater import HeaterLease
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.phases import DrivePhase
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle, vehicle_contents
from bev_preheat_msgs.msg import RoutePlan

START_NS = 1_700_000_000 * NS_PER_S
LIFE = '0123abcd'
# So short that each of many tests can replay it, and warm enough to be heated, and no longer, before the end.
LENGTH_S, TARGET_C = 300, 12.5
# For deep tests.
LONG_S, LONG_TARGET_C = 900, 20.0
KINDS = {'/battery_state': _kind(BatteryState), '/route_plan': _kind(RoutePlan)}


def beginning(now_ns=START_NS, vehicle='reference', **changed):
    values = {'version': '0.3.0', 'node': '/planner', 'life': LIFE, 'part': 0, 'now_ns': now_ns,
              'uses_sim_time': True, 'parameters': {'method': DEFAULT_METHOD},
              'vehicle_file': vehicle_contents(vehicle).decode()}
    return Beginning(**{**values, **changed})


def writer(folder, head=None, most_bytes=10**9, **options):
    head = (Entry(BEGINNING_CHANNEL, START_NS, beginning().as_dictionary()),) if head is None else head
    return RecordingWriter(
        Recording(folder, most_bytes, LIFE, '20260101T000000'), KINDS, lambda: head, **options)


def a_car(target_c=TARGET_C, length_s=LENGTH_S, **imperfections):
    vehicle = load_vehicle('reference')
    return ImperfectCar(
        vehicle, DrivePhase(load_route('reference', vehicle.defaults).before(length_s), Goal(target_c)),
        Battery(10.0, 0.8), Imperfections(sensors=Sensors(temperature_resolution_k=0.5), **imperfections), seed=3)


class RecordedDrive:
    """Drives a simulated car under the step, second by second, and records it as the node does."""

    def __init__(self, car, folder, settings=Settings(), **options):
        self.car, self.settings = car, settings
        self.supervisor = Supervisor(load_vehicle('reference'), settings)
        self.intake, self.goals = RouteIntake(), GoalNumbers()
        self.writer = writer(folder, **options)
        self.outputs = []
        self._lease_w, self._until_ns = 0.0, 0

    def step(self, now_ns, event=None, topic=None, message=None):
        events = () if event is None else (event,)
        output = self.supervisor.step(now_ns, *events)
        if output.decision is not None:
            self.supervisor.later_decisions()
        self.outputs.append((now_ns, output))
        entries = [] if message is None else [Entry(topic, now_ns, message)]
        values = tuple(event_values(each, self.goals, message is not None) for each in events)
        entries.append(Entry(STEP_CHANNEL, now_ns, RecordedStep(
            now_ns, events=values, command=command_values(output.command),
            status=None if output.decision is None else int(output.decision.status))))
        self.writer.put(*entries)
        if output.command is not None:
            self._lease_w = output.command.battery_heating_power_w
            self._until_ns = output.command.valid_until_ns

    def drive(self, length_s):
        route = route_plan_message(self.car.mission(START_NS))
        self.step(START_NS, self.intake.read(route, self.supervisor.state), '/route_plan', route)
        for second in range(length_s):
            now_ns = START_NS + second * NS_PER_S
            for reading in self.car.readings():
                # As it comes out of DDS: some fields have fewer digits there.
                message = deserialize_message(serialize_message(reading_message(
                    reading, 200.0, START_NS + round(reading.instant_s * NS_PER_S))), BatteryState)
                self.step(now_ns, battery_event(message), '/battery_state', message)
            self.step(now_ns)
            self.car.advance_under(HeaterLease(
                self._lease_w, (self._until_ns - START_NS) / NS_PER_S), second + 1.0)
        with suppress(AttributeError):
            self.writer.close(30.0)
        return self
