# SPDX-License-Identifier: Apache-2.0
"""
`heater_controller`: bad commands in this process; over DDS a second or hanging commander, and signals.

Beside a planner, in this process: refusals, clocks that jump, kills.
"""

import math
import re
import signal

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from example_frames import can_map
from node_bench import repeating
from planner_car import command_at, driving, has_entry, LEASE_S, QUICK, state_at
import pytest
from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Float64

from bev_preheat.files.input_files import find_configuration
from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.nodes.heater_execution import CommandSenders
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.msg import HvchCommand, HvchStatus, PreheatPlan

OFFERED = QoSProfile(depth=1, deadline=Duration(seconds=2.5), liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
                     liveliness_lease_duration=Duration(seconds=2.5))
PERIOD_S = 0.2
FREQUENT = ('-p', 'period:=0.02')


def test_senders_are_told_apart_by_their_sequence_numbers():
    senders = CommandSenders()
    # A planner in its second hour, and a stranger that begins.
    heard = [(7200, 'planner'), (7201, 'planner'), (1, 'stranger'), (7202, 'planner'), (2, 'stranger'),
             (7205, 'planner'), (3, 'stranger')]
    found = [(senders.sender(number), name) for number, name in heard]
    assert len(set(found)) == 2
    assert len({number for number, _ in found}) == 2
    # A restart begins a sequence of its own; a lost message does not.
    assert senders.sender(1) not in {number for number, _ in found}
    assert CommandSenders().sender(None) == CommandSenders().sender(None)


class Controlled:
    """A heater_controller, a publisher of commands, and all that it says."""

    def __init__(self, bench, *arguments):
        self.bench = bench
        self.statuses = bench.record(HvchStatus, 'hvch_status', 100)
        self.diagnostics = bench.record(DiagnosticArray, '/diagnostics', 100)
        self.process = bench.start('heater_controller', *FREQUENT, *arguments)
        self.commands = bench.publisher(HvchCommand, 'hvch_command', OFFERED)
        self.commands.wait_for_subscription()

    def give(self, power_w, ahead_s=0.0, lease_s=1.0):
        """Publish a command, stamped some time later than now [s], and keep the end of its lease."""
        message = command_at(self.bench.now_ns + round(ahead_s * NS_PER_S), power_w, lease_s)
        self.lease_end_ns = nanoseconds(message.valid_until)
        self.commands.publish(message)

    def heats(self, lease_s=1.0):
        self.statuses.clear()
        with self.bench.repeating(lambda: self.give(2500.0, lease_s=lease_s), PERIOD_S):
            self.statuses.wait_for(lambda status: status.active_power == 2500.0, 'heat')

    def refused(self, refusal):
        """Return the next status with a refusal, and see that its entry in the diagnostics names it."""
        status = self.statuses.wait_for(lambda status: status.refusal == refusal, f'refusal {refusal}')
        assert status.active_power == 0.0
        return status

    def names(self, text, level=DiagnosticStatus.ERROR):
        self.diagnostics.wait_for(has_entry('heater_controller: command', text, level),
                                  f'the diagnostics with {text!r}')


@pytest.fixture
def controlled(rehearsal):
    """Return a Controlled in this process."""
    return Controlled(rehearsal)


@pytest.fixture(scope='module')
def installed(module_bench):
    """Return a Controlled over DDS that tests share; the last one ends it."""
    return Controlled(module_bench)


def test_command_is_served_until_silence_and_the_status_says_both(controlled):
    controlled.heats()
    # Before the heat there was no command either.
    status = controlled.statuses.wait_for(
        lambda status: status.explanation == 'the lease of the latest command has ended', 'the end of the lease')
    # By the stamps, because on a busy computer messages arrive late.
    assert not any(told.active_power and nanoseconds(told.header.stamp) > controlled.lease_end_ns
                   for told in controlled.statuses.messages)
    assert (status.refusal, status.active_power) == (HvchStatus.NO_COMMAND, 0.0)
    assert (status.requested_power, status.measured_power_known) == (0.0, False)
    controlled.names('NO_COMMAND', DiagnosticStatus.WARN)


@pytest.mark.parametrize('bad, refusal, text', [
    ({'power_w': math.nan}, HvchStatus.INVALID_COMMAND, 'nan W is not allowed'),
    ({'power_w': 1000.0, 'ahead_s': 3600.0}, HvchStatus.INVALID_LEASE, 's ahead of the clock'),
], ids=['nan', 'stamp'])
def test_bad_command_ends_the_heat_of_the_good_one_before(controlled, bad, refusal, text):
    controlled.heats()
    controlled.statuses.clear()
    controlled.give(**bad)
    assert text in controlled.refused(refusal).explanation
    controlled.names(text)
    controlled.heats()
    assert 'is over; the command is served' in controlled.process.output()


def test_second_commander_switches_off_and_is_named(installed):
    installed.heats()
    stranger = installed.bench.publisher(HvchCommand, 'hvch_command', OFFERED)
    stranger.wait_for_subscription()

    def publish_both():
        # Together, as planners that answer the same battery state.
        installed.give(2500.0)
        stranger.publish(command_at(installed.bench.now_ns, 1500.0))

    with repeating(publish_both, PERIOD_S):
        installed.refused(HvchStatus.COMMAND_CONFLICT)
        installed.names('2 nodes command the heater')
        installed.statuses.clear()
        assert all(status.active_power == 0.0 for status in installed.statuses.wait_for_count(4))
    stranger.destroy()


def test_hanging_commander_ends_the_heat_before_a_long_lease(installed):
    installed.heats(lease_s=9.0)
    installed.statuses.clear()
    status = installed.statuses.wait_for(lambda status: status.active_power == 0.0, '0 W')
    assert nanoseconds(status.header.stamp) < installed.lease_end_ns
    assert any(word in status.explanation for word in ('deadline', 'alive'))


def test_end_by_signal_is_reported(installed):
    installed.heats()
    installed.process.send_signal(signal.SIGTERM)
    assert installed.process.wait() == 0
    assert installed.refused(HvchStatus.NOT_ACTIVE).explanation == 'the controller is shutting down'


def test_gates_of_the_car(rehearsal, car_with_gates):
    gated_car = car_with_gates(
        'minimum_soc: 0.15, maximum_temperature_c: 25, only_while_standing: true, power_steps_w: [2000, 5000]')
    controlled = Controlled(rehearsal, '-p', f'vehicle:={gated_car}')
    states = rehearsal.publisher(BatteryState, 'battery_state', 1)
    speeds = rehearsal.publisher(Float64, 'vehicle_speed', 1)
    car = {'soc': 0.5, 'temperature': 5.0, 'speed': 0.0}

    def drive():
        states.publish(state_at(rehearsal.now_ns, percentage=car['soc'], temperature=car['temperature']))
        speeds.publish(Float64(data=car['speed']))
        controlled.give(6000.0)

    controlled.give(6000.0)
    assert 'no valid battery_state' in controlled.refused(HvchStatus.OTHER).explanation
    with rehearsal.repeating(drive, 0.1):
        # The heater has 2000 and 5000 W.
        controlled.statuses.wait_for(lambda status: status.active_power == 5000.0
                                     and status.refusal == HvchStatus.STEP_OF_POWER)
        for name, value, refusal in (('soc', 0.1, HvchStatus.LOW_CHARGE),
                                     ('temperature', 30.0, HvchStatus.HOT_BATTERY),
                                     ('speed', 8.0, HvchStatus.IN_MOTION)):
            before = car[name]
            car[name] = value
            controlled.refused(refusal)
            car[name] = before
            controlled.statuses.clear()
            controlled.statuses.wait_for(lambda status: status.active_power == 5000.0)


@pytest.mark.needs('cantools', 'can', 'serial', 'crccheck')
def test_bus_that_cannot_be_opened_is_in_the_log_before_any_command_and_refuses_heat(rehearsal, tmp_path):
    adapter = tmp_path / 'no_adapter'
    controlled = Controlled(rehearsal, '-p', f'signals:={can_map(tmp_path, adapter)}')
    rehearsal.wait_until(lambda: f'slcan {adapter}: ' in controlled.process.output(), 'the bus')
    controlled.give(2500.0)
    assert controlled.refused(HvchStatus.HEATER_FAULT).explanation.startswith(f'slcan {adapter}: ')


@pytest.mark.needs('cantools', 'can', 'crccheck')
@pytest.mark.parametrize('signals, words', [
    ('vss', "vss.yaml: live.heater_command: is missing; it names the frame with the heater's power"),
    ('leafspy', 'leafspy.yaml: has no key live'),
    ('example_car', 'live.heater_command: carries at most 7000 W; the maximum_power_w of hvch in the vehicle file '
     'is 7001 W')])
def test_signal_map_without_a_frame_for_the_heater_is_refused_in_one_line(refusal, tmp_path, signals, words):
    vehicle = tmp_path / 'strong.yaml'
    vehicle.write_text(find_configuration('vehicles', 'reference', '.yaml').read_text().replace(
        'maximum_power_w: 7000', 'maximum_power_w: 7001'))
    assert words in refusal(
        'heater_controller', '--ros-args', '-p', f'signals:={signals}', '-p', f'vehicle:={vehicle}')


@pytest.mark.parametrize('age_s, open_for_s', [
    (0.0, 5.0),
    # Almost too old on arrival: for 2 s more.
    (4.9, 2.0),
    # Too old on arrival, or too far ahead.
    (5.1, 0.0), (-5.1, 0.0)])
def test_gates_close_once_the_state_has_expired(rehearsal, car_with_gates, age_s, open_for_s):
    controlled = Controlled(rehearsal, '-p', f'vehicle:={car_with_gates("minimum_soc: 0.1")}')
    arrived_ns = rehearsal.now_ns
    rehearsal.publisher(BatteryState, 'battery_state').publish(state_at(arrived_ns - round(age_s * NS_PER_S)))
    controlled.give(2500.0)
    with rehearsal.repeating(lambda: controlled.give(2500.0), PERIOD_S):
        closed = controlled.refused(HvchStatus.OTHER)
    assert (nanoseconds(closed.header.stamp) - arrived_ns) / NS_PER_S == pytest.approx(open_for_s, abs=0.03)
    assert any(status.active_power > 0.0 for status in controlled.statuses.messages) is (open_for_s > 0.0)
    assert ('battery_state refused' in controlled.process.output()) is (abs(age_s) > 5.0)


# Beside a planner

HEATER = ('-p', f'command_deadline:={LEASE_S + 1.0}')


def is_heating(status):
    return status.active_power > 0.0


def test_refusal_is_in_the_plan_and_in_one_entry(rehearsal, car_with_gates):
    plans = rehearsal.record(PreheatPlan, 'preheat_plan', 100)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 100)
    with driving(rehearsal):
        # The fed battery is at 80 %, and the planner's own file does not know the gate.
        rehearsal.start('planner', *QUICK)
        plans.wait_for(lambda plan: plan.status in (PreheatPlan.HEATING, PreheatPlan.TARGET_UNREACHABLE))
        rehearsal.start('heater_controller', *HEATER, '-p', 'battery_state_timeout:=60.0', '-p',
                        f'vehicle:={car_with_gates("minimum_soc: 0.95")}')
        plan = plans.wait_for(lambda plan: plan.explanation.startswith(
            'The heater does not heat (LOW_CHARGE): the state of charge is 80.0 %'))
        assert plan.status == PreheatPlan.TARGET_UNREACHABLE
        assert plan.hvch_electric_energy == 0.0
        diagnostics.wait_for(has_entry('planner: heater status', 'LOW_CHARGE', DiagnosticStatus.WARN))


# A step of the planner's clock [s]; the messages of planner and heater controller.
CLOCK_STEPS = [
    (3600, r'INVALID_INPUT: battery_state refused: header.stamp: the state is 3[56]\d\d(\.\d+)? s old; ',
     r'INVALID_LEASE: header.stamp: is 3[56]\d\d\.\d+ s ahead of the clock; '),
    (-3600, r'INVALID_INPUT: battery_state refused: header.stamp: the state is 3[56]\d\d(\.\d+)? s ahead of the ',
     r'INVALID_LEASE: valid_until: is 3[56]\d\d\.\d+ s in the past')]


def is_only_error(name, text):
    """Return a condition: a node's diagnostics have one ERROR, with this name and text."""
    def condition(array):
        errors = [status for status in array.status if status.level == DiagnosticStatus.ERROR]
        return [status.name for status in errors] == [name] and re.match(text, errors[0].message)
    return condition


def test_clock_steps_and_kills_of_planner_and_heater_end_in_0_w_and_heat_again(rehearsal):
    statuses = rehearsal.record(HvchStatus, 'hvch_status', 100)
    commands = rehearsal.record(HvchCommand, 'hvch_command', 100)
    diagnostics = rehearsal.record(DiagnosticArray, '/diagnostics', 100)
    clock, ahead_ns = rehearsal.publisher(Clock, '/clock', 10), [0]
    tick = rehearsal.repeating(
        lambda: clock.publish(Clock(clock=time_message(rehearsal.now_ns + ahead_ns[0]))), 0.05)
    with driving(rehearsal), tick:
        # Its clock may jump, and that of the car does not.
        planner = rehearsal.start('planner', *QUICK, '-p', 'use_sim_time:=true')
        heater = rehearsal.start('heater_controller', *HEATER)
        statuses.wait_for(is_heating, 'heat')
        for step_s, planner_says, heater_says in CLOCK_STEPS:
            diagnostics.clear()
            ahead_ns[0] = step_s * NS_PER_S
            diagnostics.wait_for(is_only_error('planner: preheating', planner_says), planner_says)
            diagnostics.wait_for(is_only_error('heater_controller: command', heater_says), heater_says)
            statuses.clear()
            assert not any(map(is_heating, statuses.wait_for_count(4)))
            ahead_ns[0] = 0
            statuses.wait_for(is_heating, 'heat after the clock is right again')
        planner.kill()
        statuses.clear()
        ended = statuses.wait_for(lambda status: status.refusal == HvchStatus.NO_COMMAND)
        assert not is_heating(ended)
        lease_end_ns = max(nanoseconds(command.valid_until) for command in commands.messages)
        assert not any(is_heating(status) and nanoseconds(status.header.stamp) > lease_end_ns
                       for status in statuses.messages)
        rehearsal.start('planner', *QUICK)
        statuses.clear()
        statuses.wait_for(is_heating, 'heat again')
        heater.kill()
        statuses.clear()
        rehearsal.start('heater_controller', *HEATER)
        statuses.wait_for(is_heating, 'heat of the second controller')
