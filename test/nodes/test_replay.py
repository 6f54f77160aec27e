# SPDX-License-Identifier: Apache-2.0
"""
The planner's node and the step without ROS give the same output for the same input.

A car with faults drives under the node. All inputs of the planner, and everything that it
publishes, is recorded. The record of the inputs then goes through `Supervisor.step`: each
command and each plan must be reproduced, at its instant, to the last digit.
"""

from collections import defaultdict
from dataclasses import dataclass

import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_srvs.srv import SetBool

from bev_preheat.control.events import PreheatingSwitched, Reconfigured
from bev_preheat.control.settings import Settings
from bev_preheat.control.supervisor import Supervisor
from bev_preheat.messages.battery_state import battery_event, reading_message
from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.messages.heater import command_message
from bev_preheat.messages.preheat_plan import plan_message
from bev_preheat.messages.route_intake import RouteIntake
from bev_preheat.messages.route_plan import route_plan_message
from bev_preheat.numerics.factors import NS_PER_S
from bev_preheat.planning.situation import BatteryState as State
from bev_preheat.planning.situation import Goal
from bev_preheat.planning.status import Status
from bev_preheat.route import load_route
from bev_preheat.simulation.heater_faults import HeaterFault
from bev_preheat.simulation.heater_lease import HeaterLease
from bev_preheat.simulation.imperfect_car import ImperfectCar, Imperfections
from bev_preheat.simulation.mismatch import Mismatch
from bev_preheat.simulation.sensors import Sensors
from bev_preheat.vehicle import load_vehicle
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

VEHICLE = load_vehicle('reference')
START_NS = 1_700_000_000 * NS_PER_S
LENGTH_S, TIMEOUT_S, COMMAND_PERIOD_S = 240, 5, 1.0
SETTINGS = Settings(battery_state_timeout_s=float(TIMEOUT_S), lease_s=2.5)
WARMER = Settings(battery_state_timeout_s=float(TIMEOUT_S), lease_s=2.5, target_temperature_c=27.0)
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
RECORDED = QoSProfile(depth=10_000)

CAR = ImperfectCar(
    VEHICLE, load_route('reference', VEHICLE.defaults).before(2.0 * LENGTH_S), State(17.0, 0.8),
    Goal(21.0), Imperfections(
        mismatch=Mismatch(heat_capacity=1.08, leakage=0.9, propulsion_power=1.1),
        sensors=Sensors(temperature_noise_k=0.2, temperature_resolution_k=0.5,
                        drop_outs=((40.0, 52.5),), invalid=((70.0, 73.0),)),
        heater_faults=(HeaterFault(100.0, share=0.4),)), seed=5)


def second_of(stamp):
    return (nanoseconds(stamp) - START_NS) / NS_PER_S


@dataclass(frozen=True)
class Given:
    """An input of the planner at a second; `kind` names the topic or service."""

    second: int
    kind: str
    value: object = None


class Drive:
    """A planner, its clock and its inputs, one at a time."""

    def __init__(self, bench):
        self._bench = bench
        self.commands = bench.record(HvchCommand, 'hvch_command', RECORDED)
        self.plans = bench.record(PreheatPlan, 'preheat_plan', RECORDED)
        # The planner's inputs, as they come out of their bytes.
        self._heard = {'battery_state': bench.record(BatteryState, 'battery_state', RECORDED),
                       'route_plan': bench.record(RoutePlan, 'route_plan', RECORDED)}
        self._senders = {'battery_state': bench.publisher(BatteryState, 'battery_state', 10),
                         'route_plan': bench.publisher(RoutePlan, 'route_plan', LATCHED)}
        self._clock = bench.publisher(Clock, '/clock', 10)
        bench.start('planner', '-p', 'use_sim_time:=true', '-p', 'vehicle:=reference', '-p',
                    f'command_period:={COMMAND_PERIOD_S}', '-p', 'command_lease:=2.5', '-p',
                    f'battery_state_timeout:={float(TIMEOUT_S)}')
        for sender in (self._clock, *self._senders.values()):
            sender.wait_for_subscription()
        self.commands.wait_for_publisher()
        self.plans.wait_for_publisher()
        self.given, self._second = [], 0
        self._start_clock()

    def _start_clock(self):
        """Let the clock run before the drive until the planner's timer goes by it."""
        seconds = iter(range(-10_000, 0))

        def is_heard():
            self._show(next(seconds))
            return self.commands.comes_to(
                lambda command: second_of(command.header.stamp) >= -10_000, 0.1)

        self._bench.wait_until(is_heard, 'a command by the clock')

    def _show(self, second):
        self._clock.publish(Clock(clock=time_message(START_NS + second * NS_PER_S)))

    def tick(self, second):
        """Set the clock to a second, and wait until the planner's timer has fired."""
        self._second = second
        self._show(second)
        assert self.commands.comes_to(
            lambda command: second_of(command.header.stamp) == second, 0.0), second

    def give(self, kind, message):
        """Send a message; wait for the plan that answers it."""
        before = len(self.plans.messages)
        heard = self._heard[kind]
        count = len(heard.messages)
        self._senders[kind].publish(message)
        self.plans.wait_for_count(before + 1)
        self.given.append(Given(self._second, kind, heard.wait_for_count(count + 1)[-1]))

    def enable(self, is_enabled):
        self._bench.call(SetBool, '/planner/enable', SetBool.Request(data=is_enabled))
        self.given.append(Given(self._second, 'enable', is_enabled))

    def set_target(self, target_c):
        self._bench.call(SetParameters, '/planner/set_parameters', SetParameters.Request(
            parameters=[Parameter(name='target_battery_temperature', value=ParameterValue(
                type=ParameterType.PARAMETER_DOUBLE, double_value=target_c))]))
        self.given.append(Given(self._second, 'settings', WARMER))


def a_route(**changed):
    message = route_plan_message(CAR.mission(START_NS))
    message.target_battery_temperature = 21.0
    for field, value in changed.items():
        setattr(message, field, value)
    return message


NO_TARGET = {'target_battery_temperature': 0.0, 'has_target_battery_temperature': False}
# Events besides battery states, by second.
HAPPENINGS = {
    0: lambda drive: drive.give('route_plan', a_route()),
    60: lambda drive: drive.give('route_plan', a_route(speed=[-1.0])),
    64: lambda drive: drive.give('route_plan', a_route(route_id='work', speed=[-1.0])),
    68: lambda drive: drive.give('route_plan', a_route(route_id='work')),
    85: lambda drive: drive.enable(False),
    90: lambda drive: drive.enable(True),
    130: lambda drive: drive.give('route_plan', RoutePlan()),
    135: lambda drive: drive.give('route_plan', a_route(target_battery_temperature=16.0)),
    150: lambda drive: drive.give('route_plan', a_route(**NO_TARGET)),
    155: lambda drive: drive.set_target(27.0),
}


@pytest.fixture(scope='module')
def driven(module_rehearsal):
    """Return the Drive, after LENGTH_S seconds."""
    drive = Drive(module_rehearsal)
    for second in range(LENGTH_S):
        drive.tick(second)
        if second in HAPPENINGS:
            HAPPENINGS[second](drive)
        for reading in CAR.readings():
            drive.give('battery_state', reading_message(
                reading, 200.0, START_NS + round(reading.instant_s * NS_PER_S)))
        command = drive.commands.latest
        CAR.advance_under(HeaterLease(
            command.battery_heating_power, second_of(command.valid_until)), second + 1.0)
    # The planner answers the last tick after all earlier inputs.
    drive.tick(LENGTH_S)
    return drive


def events_of(given, intake, supervisor):
    """Return the events that the planner's node makes from its input."""
    if given.kind == 'battery_state':
        return [battery_event(given.value)]
    if given.kind == 'route_plan':
        return [intake.read(given.value, supervisor.state)]
    if given.kind == 'enable':
        return [PreheatingSwitched(given.value)]
    return [Reconfigured(VEHICLE, given.value, intake.read_again(
        supervisor.state, VEHICLE, given.value))]


@dataclass(frozen=True)
class Said:
    """Commands and plans by second."""

    commands: dict
    plans: dict


def said(commands, plans):
    by_second = Said(defaultdict(list), defaultdict(list))
    for command in commands:
        by_second.commands[second_of(command.header.stamp)].append(command)
    for plan in plans:
        # Only the computing time differs.
        plan.planning_time = 0.0
        by_second.plans[second_of(plan.header.stamp)].append(plan)
    return by_second


@pytest.fixture(scope='module')
def replayed(driven):
    """Return the output of the step without ROS for the planner's input."""
    supervisor, intake = Supervisor(VEHICLE, SETTINGS), RouteIntake()
    commands, plans = [], []
    # The clock's leap to the first second fires both timers.
    given, stale_at = defaultdict(list), 0
    for each in driven.given:
        given[each.second].append(each)

    def step(second, *events):
        now_ns = START_NS + second * NS_PER_S
        output = supervisor.step(now_ns, *events)
        if output.command is not None:
            commands.append(command_message(output.command, now_ns))
        if output.decision is not None:
            plans.append(plan_message(
                output.decision, supervisor.state.mission, now_ns, supervisor.later_decisions()))
        return not output.refusals

    for command in driven.commands.messages:
        if second_of(command.header.stamp) < 0.0:
            step(round(second_of(command.header.stamp)))
    for second in range(LENGTH_S + 1):
        step(second)
        if second == stale_at:
            # The timer for stale states fires too.
            step(second)
            stale_at += TIMEOUT_S
        for each in given[second]:
            accepted = step(second, *events_of(each, intake, supervisor))
            if each.kind == 'settings' or (each.kind == 'battery_state' and accepted):
                stale_at = second + TIMEOUT_S
    return said(commands, plans)


@pytest.fixture(scope='module')
def heard(driven):
    """Return the planner's output."""
    return said(driven.commands.messages, driven.plans.messages)


@pytest.mark.parametrize('topic', ['commands', 'plans'])
def test_the_step_says_what_the_planner_said(heard, replayed, topic):
    of_planner, of_step = getattr(heard, topic), getattr(replayed, topic)
    # Messages before the clock started belong to no second of the drive.
    for second in range(LENGTH_S + 1):
        # Unknown values are NaN, which is equal to itself as text only.
        assert list(map(str, of_step[second])) == list(map(str, of_planner[second])), second


def test_the_drive_had_something_to_say(heard):
    """Each kind of fault occurred; otherwise the comparison would prove little."""
    statuses = {Status(plan.status) for plans in heard.plans.values() for plan in plans}
    assert statuses >= {
        Status.NO_BATTERY_STATE, Status.STALE_INPUT, Status.INVALID_INPUT, Status.DISABLED,
        Status.NO_CHARGING_PLANNED, Status.HEATING}
    powers_w = {command.battery_heating_power
                for commands in heard.commands.values() for command in commands}
    assert min(powers_w) == 0.0 and max(powers_w) > 3000.0
    assert sum(map(len, heard.commands.values())) > LENGTH_S
