# SPDX-License-Identifier: Apache-2.0
"""Requests of the cabin over VSS become goals of the planner's action; without a broker, a planner and DDS."""

from queue import SimpleQueue
from types import SimpleNamespace

from action_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from rclpy.task import Future
from rehearsal import RehearsedNode

from bev_preheat.bus.conditioning import (
    FAST_CHARGING,
    INACTIVE,
    IS_ACTIVE,
    IS_ONGOING,
    MODE,
    TEMPERATURE,
    TIME,
)
from bev_preheat.messages.fields import nanoseconds, time_message
from bev_preheat.nodes import bus_conditioning
from bev_preheat.numerics import NS_PER_S
from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand

RESULT = PrepareBattery.Result


class Goal:
    """A goal as its planner has it, and in place of rclpy's ClientGoalHandle."""

    def __init__(self, message, on_feedback):
        self.message, self.is_canceled, self.accepted = message, False, False
        self.feed = lambda: on_feedback(PrepareBattery.Feedback())
        self.answer, self._result = Future(), Future()

    def accept(self):
        self.accepted = True
        self.answer.set_result(self)

    def reject(self):
        self.answer.set_result(self)

    def end(self, code, explanation='', status=GoalStatus.STATUS_ABORTED):
        self._result.set_result(SimpleNamespace(status=status, result=RESULT(code=code, explanation=explanation)))

    def get_result_async(self):
        return self._result

    def cancel_goal_async(self):
        self.is_canceled = True


class Planner:
    """In place of rclpy's ActionClient: the planner at its other end."""

    def __init__(self, node, action_type, name):
        assert action_type is PrepareBattery
        self.name, self.is_there, self.goals = name, True, []

    def server_is_ready(self):
        return self.is_there

    def send_goal_async(self, message, on_feedback):
        self.goals.append(Goal(message, on_feedback))
        return self.goals[-1].answer


class Cabin:
    """A BusConditioning with the planner and the broker at its ends; `values` are those of the broker."""

    def __init__(self, rehearsal, monkeypatch):
        self.rehearsal, self.values = rehearsal, {}
        monkeypatch.setattr(bus_conditioning, 'ActionClient', self._connect)
        monkeypatch.setattr(bus_conditioning, 'steady_s', lambda: rehearsal.now_ns / NS_PER_S)
        self.broker = SimpleNamespace(connections=1, publish=self.values.update)
        self._requests = SimpleQueue()
        rehearsal.hold_time()
        self.node = type('Gateway', (RehearsedNode,), {'rehearsal': rehearsal})('bus_gateway')
        self.part = bus_conditioning.BusConditioning(self.node, 'planner', self.broker, self._requests, 10.0)
        self.part.has_battery = True
        self._commands = rehearsal.publisher(HvchCommand, 'hvch_command')

    def _connect(self, *arguments):
        self.planner = Planner(*arguments)
        return self.planner

    def request(self, **values):
        self._requests.put({{'mode': MODE, 'target': TEMPERATURE, 'at': TIME}[name]: value
                            for name, value in values.items()})
        self.pass_by(0.2)

    def ask(self, **values):
        """Request a battery for fast charging; return the Goal that the planner gets, None without one."""
        before = len(self.planner.goals)
        self.request(mode=FAST_CHARGING, **values)
        assert len(self.planner.goals) <= before + 1
        return self.planner.goals[-1] if len(self.planner.goals) > before else None

    def pass_by(self, seconds):
        self.rehearsal.advance(seconds)

    def command(self):
        """Command the heater for 2 s, as the planner does."""
        stamp_ns = self.rehearsal.now_ns
        message = HvchCommand(battery_heating_power=3000.0, valid_until=time_message(stamp_ns + 2 * NS_PER_S))
        message.header.stamp = time_message(stamp_ns)
        self._commands.publish(message)

    def state(self):
        """Return three values of the broker: the mode, whether a goal is active, whether the heater heats."""
        return self.values[MODE], self.values[IS_ACTIVE], self.values[IS_ONGOING]

    def warning(self):
        """Return the sentence of the diagnostics, '' if they have no doubt."""
        entry = self.part.entry()
        assert entry.name == 'conditioning'
        return entry.message if entry.level == DiagnosticStatus.WARN else ''


@pytest.fixture
def cabin(rehearsal, monkeypatch):
    cabin = Cabin(rehearsal, monkeypatch)
    yield cabin
    cabin.node.destroy_node()


def test_a_request_becomes_a_goal_and_its_state_comes_back(cabin):
    cabin.pass_by(0.2)
    assert cabin.planner.name == 'planner/prepare_battery'
    assert cabin.state() == (INACTIVE, False, False)
    cabin.part.is_plugged_in, cabin.part.ambient_c = True, -7.5
    goal = cabin.ask(target=0.0, at='2026-01-31T06:30:00.250Z')
    assert goal.message.has_target_battery_temperature and goal.message.target_battery_temperature == 0.0
    assert goal.message.has_ambient_temperature and goal.message.ambient_temperature == -7.5
    assert goal.message.plugged_in
    # 250 ms, to the microsecond.
    assert round(nanoseconds(goal.message.ready_at) / 1000) == 1_769_841_000_250_000
    assert cabin.state() == (FAST_CHARGING, False, False)
    goal.accept()
    cabin.pass_by(0.2)
    assert cabin.state() == (FAST_CHARGING, True, False)
    cabin.command()
    cabin.pass_by(0.2)
    assert cabin.state() == (FAST_CHARGING, True, True)
    goal.end(RESULT.REACHED, 'the battery is warm')
    cabin.pass_by(2.5)
    assert cabin.state() == (INACTIVE, False, False)
    assert '[INFO] BatteryConditioning: the battery is warm' in cabin.node.log.lines
    assert not cabin.warning()
    assert len(cabin.planner.goals) == 1


def test_a_heater_that_heats_without_a_goal_is_reported_until_its_lease_ends(cabin):
    cabin.command()
    cabin.pass_by(1.5)
    assert cabin.state() == (INACTIVE, True, True)
    cabin.pass_by(0.7)
    assert cabin.state() == (INACTIVE, False, False)


def test_a_request_that_is_withdrawn_cancels_the_goal(cabin):
    goal = cabin.ask()
    goal.accept()
    cabin.request(mode=INACTIVE)
    assert goal.is_canceled
    goal.end(RESULT.CANCELED, 'canceled', GoalStatus.STATUS_CANCELED)
    cabin.pass_by(1.0)
    assert cabin.state() == (INACTIVE, False, False) and not cabin.warning()


def test_a_request_that_is_withdrawn_before_the_planner_answers_is_canceled_then(cabin):
    goal = cabin.ask()
    cabin.request(mode=INACTIVE)
    assert not goal.is_canceled
    goal.accept()
    assert goal.is_canceled
    assert cabin.state() == (INACTIVE, False, False)


def test_another_target_is_another_goal_and_the_end_of_the_first_is_not_its_end(cabin):
    first = cabin.ask()
    first.accept()
    second = cabin.ask(target=30.0)
    second.accept()
    first.end(RESULT.REPLACED, 'replaced')
    cabin.pass_by(1.0)
    assert not first.is_canceled and second.message.target_battery_temperature == 30.0
    assert cabin.state() == (FAST_CHARGING, True, False) and not cabin.warning()


@pytest.mark.parametrize('values, sentence', [
    ({'mode': 'HOT'}, "RequestedMode: 'HOT' is not one of"), ({'at': 'soon'}, "TargetTime: 'soon' is no instant"),
    ({'target': 99.0}, 'TargetTemperature: 99 is not allowed'), ({'target': 'warm'}, "'warm'"),
    ({'target': None}, 'NoneType')])
def test_a_request_that_is_not_allowed_is_named_and_the_cabin_sees_what_counts(cabin, values, sentence):
    goal = cabin.ask(target=20.0)
    goal.accept()
    cabin.values.clear()
    cabin.request(**values)
    assert cabin.warning().startswith('BatteryConditioning refused: ') and sentence in cabin.warning()
    assert cabin.state() == (FAST_CHARGING, True, False) and cabin.values[TEMPERATURE] == 20.0
    assert not goal.is_canceled and len(cabin.planner.goals) == 1
    cabin.pass_by(60.0)
    assert not cabin.warning()


@pytest.mark.parametrize('name', ['a b', 'car/'])
def test_a_planner_by_another_name_than_of_a_node_is_refused(refusal, name):
    assert f'planner: {name!r} is not allowed; it must be the name of a node' in refusal(
        'bus_gateway', '--ros-args', '-p', 'signals:=vss', '-p', f'planner:={name}')


def test_a_rejected_goal_is_a_warning(cabin):
    cabin.ask().reject()
    cabin.pass_by(0.2)
    assert cabin.warning() == 'BatteryConditioning: the planner has rejected the goal'
    assert cabin.state() == (INACTIVE, False, False)


def test_a_goal_is_sent_again_while_the_planner_starts_and_a_later_refusal_counts(cabin):
    cabin.ask().accept()
    cabin.planner.goals[-1].end(RESULT.REFUSED, 'no battery yet')
    cabin.pass_by(0.4)
    assert len(cabin.planner.goals) == 1
    assert cabin.warning() == 'the planner is starting'
    cabin.pass_by(0.3)
    assert len(cabin.planner.goals) == 2
    cabin.planner.goals[-1].accept()
    cabin.pass_by(4.5)
    cabin.planner.goals[-1].end(RESULT.REFUSED, 'too hot')
    cabin.pass_by(1.0)
    assert len(cabin.planner.goals) == 2
    assert cabin.warning() == 'BatteryConditioning: too hot'
    assert cabin.state() == (INACTIVE, False, False)


def test_a_request_waits_for_the_battery_and_for_the_planner(cabin):
    cabin.part.has_battery = False
    assert cabin.ask() is None
    assert cabin.warning() == 'the request waits for the battery'
    cabin.part.has_battery, cabin.planner.is_there = True, False
    cabin.pass_by(0.2)
    assert cabin.warning() == 'the planner does not answer: its action prepare_battery is not there'
    cabin.planner.is_there = True
    cabin.pass_by(0.2)
    assert len(cabin.planner.goals) == 1 and not cabin.warning()


@pytest.mark.parametrize('status, code', [
    (GoalStatus.STATUS_ABORTED, RESULT.SHUTTING_DOWN), (GoalStatus.STATUS_UNKNOWN, RESULT.UNKNOWN)])
def test_a_planner_that_shuts_down_or_knows_no_goal_gets_it_again(cabin, status, code):
    goal = cabin.ask()
    goal.accept()
    cabin.pass_by(20.0)
    cabin.planner.goals[-1].accept()
    cabin.planner.goals[-1].end(code, '', status)
    before = len(cabin.planner.goals)
    cabin.pass_by(0.2)
    assert len(cabin.planner.goals) == before + 1
    assert cabin.values[MODE] == FAST_CHARGING and not cabin.warning()


def test_a_planner_that_says_nothing_for_5_s_has_lost_the_goal(cabin):
    goal = cabin.ask()
    goal.accept()
    for _ in range(4):
        cabin.pass_by(4.0)
        goal.feed()
    assert len(cabin.planner.goals) == 1
    cabin.pass_by(4.8)
    assert len(cabin.planner.goals) == 1
    cabin.pass_by(0.4)
    assert len(cabin.planner.goals) == 2
    # The lost goal no longer counts.
    goal.feed()
    goal.end(RESULT.MISSED, 'missed')
    assert cabin.values[MODE] == FAST_CHARGING and not cabin.warning()


def test_a_broker_that_connects_again_gets_every_value(cabin):
    cabin.pass_by(0.2)
    cabin.values.clear()
    cabin.pass_by(1.0)
    assert not cabin.values
    cabin.broker.connections += 1
    cabin.pass_by(0.2)
    assert cabin.state() == (INACTIVE, False, False)


def test_in_the_end_nothing_is_active(cabin):
    cabin.ask().accept()
    cabin.command()
    cabin.pass_by(0.2)
    cabin.part.end()
    assert cabin.state() == (FAST_CHARGING, False, False)
