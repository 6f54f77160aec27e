# SPDX-License-Identifier: Apache-2.0
"""
The tutorials that end with nodes, typed as printed: your_bus.md, from_files.md and by_hand.md.

No package index has ros2cli, so `ros2 topic pub` follows its implementation (jazzy: ros2topic/verb/pub.py,
rosidl_runtime_py): the values are YAML, arrays are built from lists, `header: auto` is the publisher's time
at each message, and the quality of service is the profile `default`.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
import json
from pathlib import Path
import re
import shlex
import signal
import subprocess
import sys

from node_bench import repeating
from planner_car import heats, PlannerCar
import pytest
from rclpy.qos import QoSPresetProfiles
from sensor_msgs.msg import BatteryState
from typed_pages import files_of, node_commands_of, run_page
from waiting import poll_until
import yaml

from bev_preheat.commands.main import main
from bev_preheat.messages.fields import time_message
from bev_preheat.messages.route_plan import is_cancellation
from bev_preheat.planning.status import Status
from bev_preheat_msgs.msg import RoutePlan

TUTORIALS = Path(__file__).parents[2] / 'docs/tutorials'
# A state may be late on a busy computer.
PATIENT = ('-p', 'battery_state_timeout:=60.0')


# Your bus

YOUR_BUS = TUTORIALS / 'your_bus.md'


@pytest.fixture
def car(tmp_path, monkeypatch):
    """Return the lines that the car of the tutorial has printed so far, in a folder with the page's files."""
    monkeypatch.chdir(tmp_path)
    for name, content in files_of(YOUR_BUS).items():
        (tmp_path / name).write_text(content)
    with (open(tmp_path / 'car.log', 'w') as output,
          subprocess.Popen([sys.executable, 'play_car.py'], stdout=output) as process):
        yield lambda: (tmp_path / 'car.log').read_text().splitlines()
        assert process.poll() is None
        process.kill()


@pytest.mark.deep
@pytest.mark.needs('cantools', 'can', 'crccheck', 'serial')
def test_your_bus_leads_to_the_first_command_of_the_heater(car, bench):
    text = YOUR_BUS.read_text()
    assert '\npython3 play_car.py\n' in text
    shown = re.search(r'```text\n(heater: .*?)\n```', text, re.DOTALL)[1].splitlines()
    poll_until(car, 'the car plays')
    processes = {name: bench.start(name, *ros_arguments) for name, ros_arguments in node_commands_of(text)}
    poll_until(lambda: len(car()) >= len(shown), 'the first command')
    # It may take seconds; meanwhile the battery cools a little.
    assert [line.split(',')[0] for line in car()[:len(shown)]] == [line.split(',')[0] for line in shown]
    processes['planner'].send_signal(signal.SIGKILL)
    # After its lease, as test_bus_gateway.py and test_whole_car.py show.
    poll_until(lambda: car()[-1].startswith('heater: 0 W'), '0 W')


# From files

FROM_FILES = TUTORIALS / 'from_files.md'
# The state of the tutorial's `preheat plan`.
TEMPERATURE_C, SOC, AMBIENT_C = 14.0, 0.82, -3.0


def heating_wh(vehicle):
    """Return the heater's energy [Wh] in the plan of `preheat plan` with a vehicle file of the tutorial."""
    assert main(['plan', '--vehicle', vehicle, '--route', 'to_work.gpx', '--ambient', f'{AMBIENT_C:g}',
                 '--temperature', f'{TEMPERATURE_C:g}', '--soc', f'{SOC:g}', '--json', 'plan.json']) == 0
    return json.loads(Path('plan.json').read_text())['energy_wh']['hvch_electric']


@pytest.mark.deep
@pytest.mark.needs('casadi', 'scipy', 'jinja2', 'matplotlib', 'mcap', 'rosbags')
def test_from_files_leads_to_a_planner_with_the_identified_car(bench, tmp_path, monkeypatch, capfd):
    run_page(FROM_FILES, tmp_path, monkeypatch, capfd)
    own_wh, data_sheet_wh = heating_wh('my_car.yaml'), heating_wh('data_sheet.yaml')
    car = PlannerCar(bench)
    words = node_commands_of(FROM_FILES.read_text())
    assert [name for name, _ in words] == ['planner', 'route_publisher']
    for name, ros_arguments in words:
        bench.start(name, *ros_arguments, *(PATIENT if name == 'planner' else ()))
    with car.feeding(lambda: car.state(temperature=TEMPERATURE_C, percentage=SOC, voltage=371.0, current=-4.0,
                                       present=True)):
        plan = car.plans.wait_for(lambda plan: plan.status == Status.WAITING, 'a plan that waits')
        command = car.commands.wait_for(lambda command: command.reason == Status.WAITING, 'its command')
    assert plan.route_id == 'to_work'
    assert plan.predicted_arrival_temperature == pytest.approx(25.0, abs=0.3)
    assert command.battery_heating_power == 0.0
    # The file that was identified: with the data sheet's car it is another plan.
    assert abs(data_sheet_wh / own_wh - 1.0) > 0.2
    assert plan.hvch_electric_energy == pytest.approx(own_wh, rel=0.05)


# By hand

BY_HAND = TUTORIALS / 'by_hand.md'
QOS = QoSPresetProfiles.get_from_short_key('default')


@dataclass(frozen=True)
class Typed:
    """A command `ros2 topic pub`: whether it publishes once, the topic, the message's class, and its values."""

    once: bool
    topic: str
    message_type: type
    values: dict

    def message(self, stamp):
        """Return the message that is published at an instant (builtin_interfaces/Time)."""
        message = self.message_type()
        for name, value in self.values.items():
            field = getattr(message, name)
            if name == 'header' and value == 'auto':
                message.header.stamp = stamp
            elif hasattr(field, 'typecode'):
                setattr(message, name, type(field)(field.typecode, value))
            else:
                setattr(message, name, type(field)(value))
        return message


def typed_commands():
    """Return the commands `ros2 topic pub` in the code blocks of the tutorial, in order."""
    blocks = re.findall(r'^```\w*\n(.*?)^```', BY_HAND.read_text(), re.MULTILINE | re.DOTALL)
    found = []
    # A backslash continues on the next line.
    for line in '\n'.join(blocks).replace('\\\n', ' ').splitlines():
        if line.startswith('ros2 topic pub '):
            words = shlex.split(line, comments=True)[3:]
            once = words[0] == '--once'
            topic, kind, values = words[once:]
            package, _, name = kind.split('/')
            message_type = getattr(import_module(f'{package}.msg'), name)
            found.append(Typed(once, topic, message_type, yaml.safe_load(values)))
    return found


def command_for(message_type, cancels=False):
    """Return the one command of the tutorial that publishes a type."""
    command, = [command for command in typed_commands() if command.message_type is message_type
                and (message_type is not RoutePlan
                     or is_cancellation(command.message(time_message(1))) is cancels)]
    return command


class Shell(PlannerCar):
    """A planner, and a user who types commands beside it."""

    def __init__(self, bench):
        super().__init__(bench)
        self.start(*PATIENT)
        self.commands.wait_for_publisher()
        self.plans.wait_for_publisher()

    def type_once(self, command):
        """Act like the command with --once: wait for a subscriber, publish."""
        assert command.once
        self._publisher(command).publish(command.message(self._now()))

    @contextmanager
    def typing(self, command):
        """Publish again and again, faster than ros2cli's 1 Hz to save time."""
        assert not command.once
        publisher = self._publisher(command)
        with repeating(lambda: publisher.publish(command.message(self._now())), 0.2):
            yield

    def _publisher(self, command):
        publisher = self.bench.publisher(command.message_type, command.topic, QOS)
        publisher.wait_for_subscription()
        return publisher

    def _now(self):
        return time_message(self.now_ns)


@pytest.fixture
def shell(bench):
    return Shell(bench)


def test_what_is_typed_by_hand_heats_and_what_is_cancelled_stays_off(shell):
    with shell.typing(command_for(BatteryState)):
        shell.plans.wait_for(lambda plan: plan.status == Status.NO_ROUTE)
        shell.type_once(command_for(RoutePlan))
        shell.wait_for_heat()

        cancellation = command_for(RoutePlan, cancels=True)
        assert cancellation.values == {'charging_planned': False}
        shell.type_once(cancellation)
        plan = shell.plans.wait_for(lambda plan: plan.status == Status.NO_CHARGING_PLANNED)
        assert plan.explanation == 'The trip was cancelled: no heating until a new route plan arrives.'
        # A command of before may still be on its way.
        shell.commands.wait_for(lambda command: command.reason == Status.NO_CHARGING_PLANNED)
        # Ten battery states later.
        shell.clear()
        assert {plan.status for plan in shell.plans.wait_for_count(10)} == {Status.NO_CHARGING_PLANNED}
        assert not any(map(heats, shell.commands.messages))

        shell.type_once(command_for(RoutePlan))
        shell.wait_for_heat()


@pytest.fixture
def by_hand(bench):
    """`by_hand(word)` starts the file of the tutorial; remaining processes are ended."""
    path, started = BY_HAND.with_suffix('.py'), []

    def start(word):
        started.append(subprocess.Popen([sys.executable, str(path), word], text=True, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


# The same messages, published by a file of the tutorial.
@pytest.mark.deep
def test_the_walk_by_hand_without_ros2_heats_cancels_and_says_no(shell, by_hand):
    driving = by_hand('drive')
    shell.wait_for_heat()
    assert by_hand('cancel').wait(60) == 0
    shell.commands.wait_for(lambda command: command.reason == Status.NO_CHARGING_PLANNED)
    process = by_hand('off')
    assert process.communicate(timeout=60)[0] == 'Preheating is switched off.\n'
    shell.commands.wait_for(lambda command: command.reason == Status.DISABLED)
    driving.send_signal(signal.SIGINT)
    assert driving.communicate(timeout=60)[1] == ''
