# SPDX-License-Identifier: Apache-2.0
"""The commands `ros2 topic pub` of the tutorial, typed as printed, and the installed planner."""

from contextlib import contextmanager
from pathlib import Path
import subprocess
import sys

from node_bench import repeating
import pytest
from sensor_msgs.msg import BatteryState
from typed_commands import QOS, typed_commands

from bev_preheat.messages.fields import time_message
from bev_preheat.messages.route_plan import is_cancellation
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

TUTORIAL = Path(__file__).parents[2] / 'docs/tutorials/by_hand.md'
COMMANDS = typed_commands(TUTORIAL.read_text())


def command_for(message_type, cancels=False):
    """Return the one command of the tutorial that publishes a type."""
    found = [command for command in COMMANDS if command.message_type is message_type
             and (message_type is not RoutePlan
                  or is_cancellation(command.message(time_message(1))) is cancels)]
    assert len(found) == 1, found
    return found[0]


class Shell:
    """A planner, and a user who types commands beside it."""

    def __init__(self, bench):
        self._bench = bench
        self.commands = bench.record(HvchCommand, 'hvch_command')
        self.plans = bench.record(PreheatPlan, 'preheat_plan')
        # Typed commands are late on a busy computer.
        self.process = bench.start('planner', '-p', 'battery_state_timeout:=60.0')
        self.commands.wait_for_publisher()
        self.plans.wait_for_publisher()

    def type_once(self, command):
        """Act like the command with --once: wait for a subscriber, publish."""
        assert command.once
        self._publisher(command).publish(command.message(self._now()))

    @contextmanager
    def typing(self, command, period_s=0.2):
        """Publish again and again, faster than ros2cli's 1 Hz to save time."""
        assert not command.once
        publisher = self._publisher(command)
        with repeating(lambda: publisher.publish(command.message(self._now())), period_s):
            yield

    def _publisher(self, command):
        publisher = self._bench.publisher(command.message_type, command.topic, QOS)
        publisher.wait_for_subscription()
        return publisher

    def _now(self):
        return self._bench.node.get_clock().now().to_msg()


@pytest.fixture
def shell(bench):
    return Shell(bench)


def test_what_is_typed_heats_and_what_is_cancelled_stays_off(shell):
    with shell.typing(command_for(BatteryState)):
        shell.plans.wait_for(lambda plan: plan.status == Status.NO_ROUTE)
        shell.type_once(command_for(RoutePlan))
        shell.commands.wait_for(lambda command: command.battery_heating_power > 0.0, 'heating')

        shell.type_once(command_for(RoutePlan, cancels=True))
        plan = shell.plans.wait_for(lambda plan: plan.status == Status.NO_CHARGING_PLANNED)
        assert plan.explanation == ('The trip was cancelled: no heating until a new route plan '
                                    'arrives.')
        # A command of before may still be on its way.
        shell.commands.wait_for(lambda command: command.reason == Status.NO_CHARGING_PLANNED)
        # Ten battery states later.
        shell.plans.clear()
        shell.commands.clear()
        plans = shell.plans.wait_for_count(10)
        assert {plan.status for plan in plans} == {Status.NO_CHARGING_PLANNED}
        assert {(command.battery_heating_power, command.reason)
                for command in shell.commands.messages} == {(0.0, Status.NO_CHARGING_PLANNED)}

        shell.type_once(command_for(RoutePlan))
        shell.commands.wait_for(lambda command: command.battery_heating_power > 0.0,
                                'heating again')


@pytest.fixture
def by_hand(bench):
    """`by_hand(word)` starts the file of the tutorial; remaining processes are ended."""
    path, started = TUTORIAL.with_suffix('.py'), []

    def start(word):
        started.append(subprocess.Popen([sys.executable, str(path), word], text=True, stdout=subprocess.PIPE))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


# The same messages, published by a file of the tutorial.
@pytest.mark.deep
def test_the_walk_without_ros2_heats_cancels_and_says_no(shell, by_hand):
    by_hand('drive')
    shell.commands.wait_for(lambda command: command.battery_heating_power > 0.0, 'heating')
    assert by_hand('cancel').wait(60) == 0
    shell.commands.wait_for(lambda command: command.reason == HvchCommand.NO_CHARGING_PLANNED)
    process = by_hand('off')
    assert process.communicate(timeout=60)[0] == 'Preheating is switched off.\n'
    shell.commands.wait_for(lambda command: command.reason == HvchCommand.DISABLED)


def test_the_cancellation_is_as_short_as_can_be():
    assert command_for(RoutePlan, cancels=True).values == {'charging_planned': False}
