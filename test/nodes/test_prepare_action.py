# SPDX-License-Identifier: Apache-2.0
"""The action ~/prepare_battery and `preheat prepare`, beside the installed planner."""

from dataclasses import astuple
from datetime import datetime
from math import inf, nan
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from planner_car import heats, PlannerCar, values_of
import pytest
from rclpy.action import ActionClient
from refusals import problems_of
from spinning import take_down
from waiting import poll_until
import yaml

from bev_preheat.commands.main import main
from bev_preheat.commands.prepare import seconds_until
from bev_preheat.control.preparation_goal import PreparationEnding, PreparationGoal
from bev_preheat.errors import InvalidInput
from bev_preheat.messages.prepare_battery import goal_message, preparation_goal_of
from bev_preheat.monitoring import planner_client
from bev_preheat.monitoring.planner_client import feedback_line
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.status import Status
from bev_preheat_msgs.action import PrepareBattery
from bev_preheat_msgs.msg import HvchCommand

# config/vehicles/reference.yaml: 7 kW, less 1978 W for the cabin.
FULL_POWER_W = 5022.0
# A process that starts, on a busy computer.
LIMIT_S = 240.0
RESEND_AFTER_S = 20.0
HOW_TO = Path(__file__).parents[2] / 'docs/how-to/prepare.md'
PREPARE = [sys.executable, '-m', 'bev_preheat', 'prepare', '--namespace', '/car']


def goal(**fields):
    return PrepareBattery.Goal(**{
        'target_battery_temperature': 20.0, 'ambient_temperature': -5.0, **fields})


# Messages


@pytest.mark.parametrize('fields, target_c, ambient_c', [
    ({}, None, None), ({'target_battery_temperature': nan, 'ambient_temperature': nan}, None, None),
    ({'has_target_battery_temperature': True}, 0.0, None), ({'has_ambient_temperature': True}, None, 0.0),
    ({'target_battery_temperature': 31.0, 'ambient_temperature': -4.0}, 31.0, -4.0)])
def test_what_nobody_sets_is_not_given(fields, target_c, ambient_c):
    preparation_goal = preparation_goal_of(PrepareBattery.Goal(**fields))
    assert (preparation_goal.target_c, preparation_goal.ambient_c) == (target_c, ambient_c)
    assert preparation_goal.is_soonest and not preparation_goal.is_plugged_in


@pytest.mark.parametrize('fields, sentence', [
    ({'target_battery_temperature': inf}, 'target_battery_temperature: inf is not allowed; it must be finite'),
    ({'ambient_temperature': -inf}, 'ambient_temperature: -inf is not allowed'),
    ({'ambient_temperature': nan, 'has_ambient_temperature': True},
     'ambient_temperature: nan is not allowed where has_ambient_temperature is true'),
    ({'maximum_arrival_temperature': 61.0},
     'maximum_arrival_temperature: 61 is not allowed; it must be -60 ... 60 degC'),
    ({'maximum_arrival_temperature': inf}, 'maximum_arrival_temperature: inf is not allowed'),
    ({'ready_at': Time(sec=-1)}, 'ready_at: -1 s and 0 ns are no instant'),
    ({'ready_at': Time(sec=1, nanosec=1_000_000_000)}, 'nanoseconds below 1000000000')])
def test_a_goal_that_cannot_be_read_is_refused(fields, sentence):
    assert sentence in '; '.join(problems_of(preparation_goal_of, PrepareBattery.Goal(**fields)))


@pytest.mark.parametrize('fields', [
    (), (0, 0.0, True, 0.0), (NS_PER_S + 1, 31.0, False, -4.0, None, None, 35.0)])
def test_a_goal_survives_its_message(fields):
    wanted = PreparationGoal(*fields)
    assert astuple(preparation_goal_of(goal_message(wanted))) == astuple(wanted)


def test_the_results_codes_are_those_of_the_endings():
    assert {ending.name: ending.value for ending in PreparationEnding} == {
        ending.name: getattr(PrepareBattery.Result, ending.name) for ending in PreparationEnding}
    assert PrepareBattery.Result().code == PrepareBattery.Result.UNKNOWN


@pytest.mark.parametrize('clock, now, expected_s', [
    ('7:30', datetime(2026, 3, 4, 7, 20, 30), 570.0), ('07:20', datetime(2026, 3, 4, 7, 20), 86400.0),
    ('0:00', datetime(2026, 12, 31, 23, 0), 3600.0)])
def test_a_clock_time_is_the_next_one(clock, now, expected_s):
    assert seconds_until(clock, now) == expected_s


def test_a_line_of_feedback_leaves_out_what_is_unknown():
    assert feedback_line(PrepareBattery.Feedback(
        battery_temperature=1.24, time_left=754.0, predicted_battery_temperature=20.0,
        battery_heating_power=5022.0, status=int(Status.HEATING))) == (
            'HEATING: battery 1.2 degC, in 12:34 min 20.0 degC, heater 5022 W')
    assert feedback_line(PrepareBattery.Feedback(
        battery_temperature=nan, time_left=nan, predicted_battery_temperature=nan, status=200)) == (
            'status 200: battery -, in - -, heater 0 W')


def typed_goals():
    """Return the words of each `ros2 action send_goal` of the how-to, as bash makes them."""
    blocks = re.findall(r'^```bash\n(.*?)^```', HOW_TO.read_text(), re.MULTILINE | re.DOTALL)
    lines = '\n'.join(blocks).replace('\\\n', ' ').splitlines()
    return [subprocess.run(['bash', '-c', f'printf "%s\\0" {line}'], capture_output=True, text=True, check=True
                           ).stdout.split('\0')[:-1]
            for line in lines if line.startswith('ros2 action send_goal ')]


def test_the_goals_that_the_how_to_types_are_goals():
    preparation_goals = []
    for *_, action, kind, values in typed_goals():
        assert (action, kind) == ('/planner/prepare_battery', 'bev_preheat_msgs/action/PrepareBattery')
        preparation_goals.append(preparation_goal_of(PrepareBattery.Goal(**{
            name: Time(**value) if name == 'ready_at' else type(getattr(PrepareBattery.Goal(), name))(value)
            for name, value in yaml.safe_load(values).items()})))
    soonest, later = preparation_goals
    assert (soonest.is_soonest, soonest.target_c, soonest.ambient_c) == (True, 20.0, -5.0)
    assert later.is_plugged_in and later.ready_at_ns / NS_PER_S == pytest.approx(
        time.time() + 2400.0, abs=LIMIT_S)


# The client


class PlannerThatAnswersLate:
    """In place of rclpy's ActionClient: its answers to the first goals are lost."""

    def __init__(self, lost):
        self.lost, self.sent = lost, []

    def server_is_ready(self):
        return True

    def send_goal_async(self, sent, on_feedback):
        self.sent.append(sent)
        is_lost = len(self.sent) <= self.lost
        return SimpleNamespace(done=lambda: not is_lost, result=lambda: SimpleNamespace(
            accepted=True, get_result_async=lambda: None))


@pytest.fixture
def client_of(monkeypatch):
    """`client_of(planner)` returns a PreparationClient that has heard a command at 1000 s."""
    def client_of(planner):
        monkeypatch.setattr(planner_client, 'ActionClient', lambda *arguments: planner)
        monkeypatch.setattr(planner_client, 'ANSWERED_WITHIN_S', 0.02)
        monkeypatch.setattr(planner_client, 'FOUND_WITHIN_S', 0.3)
        callbacks = []
        node = SimpleNamespace(create_subscription=lambda *arguments: callbacks.append(arguments[2]))
        listener = SimpleNamespace(node=node, listen=lambda seconds: time.sleep(0.005))
        client = planner_client.PreparationClient(
            listener, '/planner', SimpleNamespace(have_come=False))
        command = HvchCommand()
        command.header.stamp = Time(sec=1000)
        callbacks[0](command)
        return client
    return client_of


@pytest.mark.parametrize('lost', [0, 2])
def test_a_goal_whose_answer_is_lost_is_sent_again(client_of, lost):
    planner = PlannerThatAnswersLate(lost)
    assert client_of(planner).send(PreparationGoal(target_c=20.0), 600.0)
    assert [goal.ready_at.sec for goal in planner.sent] == [1600] * (lost + 1)


def test_a_goal_of_which_nothing_is_heard_may_be_pursued_all_the_same(client_of):
    with pytest.raises(InvalidInput, match='may heat for it; call its ~/enable with false'):
        client_of(PlannerThatAnswersLate(10**6)).send(PreparationGoal(is_plugged_in=True), None)


# Over DDS


class Driver(PlannerCar):
    """A client of the installed planner's action, a battery, and the planner's messages."""

    def __init__(self, bench):
        super().__init__(bench, '/car')
        self.client = ActionClient(bench.node, PrepareBattery, 'car/planner/prepare_battery')
        self.feedback = []

    def begin(self):
        """Start a planner, and wait until it takes goals."""
        self.diagnostics.clear()
        self.start('-r', '__ns:=/car', '-p', 'command_period:=0.2', '-p', 'command_lease:=0.6',
                   '-p', 'battery_state_timeout:=60.0')
        poll_until(self.client.server_is_ready, 'the action')
        # The first goal may come before the battery's first state.
        self.figure('battery temperature [degC]')

    def figure(self, key):
        return values_of(self.entry('preheating', lambda entry: key in values_of(entry)))[key]

    def state(self, age_s=0.0, **fields):
        return super().state(age_s, temperature=3.0, **fields)

    def send(self, **fields):
        """Send a goal; return its handle and the future of its result."""
        sent = []

        def latest_answered():
            # The answer of a server that has not yet discovered the client is lost. The goal that is sent
            # again replaces the previous one.
            if not sent or time.monotonic() - sent[-1][0] > RESEND_AFTER_S:
                sent.append((time.monotonic(), self.client.send_goal_async(
                    goal(**fields), lambda message: self.feedback.append(message.feedback))))
            return sent[-1][1].done()

        poll_until(latest_answered, 'an answer', LIMIT_S)
        handle = sent[-1][1].result()
        assert handle.accepted
        return handle, handle.get_result_async()

    @staticmethod
    def done(future):
        poll_until(future.done, 'an answer', LIMIT_S)
        return future.result()

    def stays_off(self):
        """See that the next commands are 0 W, after those that are under way."""
        self.commands.clear()
        off = self.commands.wait_for(lambda command: not heats(command), 'off')
        self.commands.clear()
        assert not any(map(heats, self.commands.wait_for_count(3)))
        return off


@pytest.fixture(scope='module')
def driver(module_bench):
    driver = Driver(module_bench)
    with driver.feeding(period_s=0.1):
        driver.begin()
        yield driver
        take_down(module_bench.node, driver.client.destroy)


def test_a_goal_heats_tells_how_it_goes_and_is_cancelled(driver):
    handle, result = driver.send()
    assert driver.wait_for_heat().reason == int(Status.HEATING)
    poll_until(lambda: driver.feedback, 'feedback')
    told = poll_until(lambda: next((one for one in driver.feedback if one.battery_heating_power > 0.0), None),
                      'feedback on heating')
    assert told.status == int(Status.HEATING) and told.battery_temperature == pytest.approx(3.0, abs=0.5)
    # 5022 W times 0.87 warm 378 kJ/K; the leakage comes on top.
    assert 17.0 / (5022.0 * 0.87 / 378e3) < told.time_left < 1.5 * 17.0 / (5022.0 * 0.87 / 378e3)
    driver.plans.wait_for(lambda plan: plan.route_id == '~/prepare_battery')
    assert driver.figure('goal of prepare_battery') == 'as soon as possible'
    assert handle.status in (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)
    driver.done(handle.cancel_goal_async())
    answer = driver.done(result)
    assert (answer.status, answer.result.code) == (GoalStatus.STATUS_CANCELED, PrepareBattery.Result.CANCELED)
    assert answer.result.explanation == 'The goal was cancelled.' and not answer.result.reached
    assert driver.stays_off().reason == int(Status.NO_ROUTE)


def test_refused_replaced_and_reached_goals_get_their_results(driver):
    _, first = driver.send()
    _, refused = driver.send(target_battery_temperature=200.0)
    answer = driver.done(refused)
    assert (answer.status, answer.result.code) == (GoalStatus.STATUS_ABORTED, PrepareBattery.Result.REFUSED)
    assert 'target battery temperature: 200 is not allowed' in answer.result.explanation
    _, unreadable = driver.send(ambient_temperature=inf)
    assert driver.done(unreadable).result.code == PrepareBattery.Result.REFUSED
    assert not first.done() and driver.wait_for_heat()
    _, reached = driver.send(target_battery_temperature=2.0)
    assert driver.done(first).result.code == PrepareBattery.Result.REPLACED
    answer = driver.done(reached)
    assert (answer.status, answer.result.code) == (GoalStatus.STATUS_SUCCEEDED, PrepareBattery.Result.REACHED)
    assert answer.result.reached and answer.result.shortfall == 0.0


@pytest.fixture
def prepare(driver):
    """`prepare(*arguments)` starts `preheat prepare` for the planner."""
    started = []

    def start(*arguments):
        started.append(subprocess.Popen(
            [*PREPARE, *arguments], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env={**os.environ, 'ROS_DOMAIN_ID': str(driver.bench.node.context.get_domain_id()),
                 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                 # The middleware prints a line of its own if another process holds its shared memory.
                 'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_ctrl_c_cancels_the_goal_and_the_heater_is_off(driver, prepare):
    process = prepare('--target', '20', '--ambient', '-5', '--plugged-in')
    assert driver.wait_for_heat().battery_heating_power == FULL_POWER_W
    assert process.stdout.readline().startswith('HEATING: battery ')
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=LIMIT_S)
    assert (process.returncode, errors) == (
        130, 'preheat: interrupted; the goal is cancelled and its heating off\n')
    driver.stays_off()


def test_a_goal_outlasts_its_client_and_anybody_can_cancel_it(driver, prepare):
    process = prepare('--target', '20', '--ambient', '-5')
    driver.wait_for_heat()
    process.kill()
    process.wait()
    driver.commands.clear()
    assert all(map(heats, driver.commands.wait_for_count(5)))
    answer = driver.bench.call(
        CancelGoal, 'car/planner/prepare_battery/_action/cancel_goal', CancelGoal.Request())
    assert answer.return_code == CancelGoal.Response.ERROR_NONE
    driver.commands.wait_for(lambda command: command.battery_heating_power == 0.0)


# Without a planner


def test_without_a_planner_it_is_one_line(ros, capsys, monkeypatch):
    monkeypatch.setattr(planner_client, 'FOUND_WITHIN_S', 0.3)
    assert main(['prepare', '--namespace', '/nobody', '--in', '40']) == 2
    errors = capsys.readouterr().err
    assert errors.startswith('preheat: error: no planner answers as /nobody/planner') and errors.count('\n') == 1


@pytest.mark.parametrize('arguments, problem', [
    (('--at', '7.30'), "--at: '7.30' is not allowed; it must be HH:MM"), (('--in', '0'), '--in: 0 is not allowed'),
    (('--in', 'nan'), '--in: nan is not allowed'), (('--in', '1441'), 'at most 1440 min'),
    (('--namespace', 'a b'), "--namespace: 'a b'"), (('--node', 'a b'), "--node: 'a b'")])
def test_arguments_that_mean_nothing_are_refused(ros, capsys, arguments, problem):
    assert main(['prepare', *arguments]) == 2
    assert problem in capsys.readouterr().err
