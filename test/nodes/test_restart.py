# SPDX-License-Identifier: Apache-2.0
"""
A planner is killed while heating and restarted: the commands that the heater receives; and its `state_file`.

test/estimation/test_state_file.py has all kinds of files.
"""

import errno
import json
import math
import os
import shutil
import signal

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import heats, PlannerCar, values_of
import pytest
from waiting import poll_until

from bev_preheat.errors import InvalidInput
from bev_preheat.files.input_files import configuration_folder
from bev_preheat.messages.fields import nanoseconds
from bev_preheat.numerics import NS_PER_S
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.replay import replay
from bev_preheat.recording.ring import recordings_in
from bev_preheat_msgs.msg import HvchCommand, PreheatPlan, RoutePlan

LEASE_S = 0.8


class Car(PlannerCar):
    """A car with a latched route, whose planners have short leases."""

    def __init__(self, bench):
        super().__init__(bench)
        self._started_ns = 0
        self.send_route()

    def start(self, *arguments):
        # Commands of a killed planner may still arrive.
        self._started_ns = self.now_ns
        return super().start('-p', 'command_period:=0.2', '-p', 'battery_state_timeout:=60.0',
                             '-p', f'command_lease:={LEASE_S}', *arguments)

    def wait_for(self, reason):
        """Wait for the next command with a reason by the planner started last."""
        return self.commands.wait_for(lambda command: self._is_new(command) and command.reason == reason)

    def wait_for_heat(self):
        """Return the first command that heats by the planner started last, received already or to come."""
        return self.commands.wait_for(lambda command: self._is_new(command) and heats(command), 'heat')

    def _is_new(self, command):
        return nanoseconds(command.header.stamp) >= self._started_ns


@pytest.fixture
def car(rehearsal):
    """Return a Car of a planner in this process."""
    car = Car(rehearsal)
    with car.feeding():
        yield car


def test_what_was_learned_and_last_seen_outlives_the_process(car, tmp_path):
    memory = tmp_path / 'learned.json'
    first = car.start('-p', f'state_file:={memory}')
    car.wait_for_heat()
    first.end()
    contents = json.loads(memory.read_text())
    (car_entry,) = contents['cars'].values()
    seen = car_entry['last_seen']
    # It takes the heat of some seconds to exceed the sensor's noise.
    assert (seen['temperature_c'], seen['soc']) == (
        pytest.approx(-7.0, abs=0.5), pytest.approx(0.8, abs=0.01))
    assert 0 <= car.now_ns - seen['stamp_ns'] < 60 * NS_PER_S
    car_entry['log_factors']['heat_capacity'] = 0.125
    memory.write_text(json.dumps(contents))
    car.diagnostics.clear()
    second = car.start('-p', f'state_file:={memory}')
    # exp(0.125)
    assert values_of(car.entry('estimation'))['heat capacity / vehicle file [1]'].startswith('1.133 ')
    assert 'the estimation begins with the learned factors' in second.output()


def has_recorded_heat(folder):
    """Return whether the recording in a folder, which is still being written, has a command that heats."""
    try:
        flight = read_flight(folder)
    except InvalidInput:
        # There is no file yet, or only the first part of its beginning.
        return False
    return any(given.step.command and given.step.command[0] > 0.0 for given in flight.given)


@pytest.mark.needs('mcap')
def test_a_killed_planner_leaves_a_recording_that_is_reproduced(bench, tmp_path):
    """Of installed planners over DDS."""
    car = Car(bench)
    with car.feeding():
        first = car.start('-p', f'flight_recorder:={tmp_path}')
        car.wait_for_heat()
        # The recorder's thread writes some time later.
        poll_until(lambda: has_recorded_heat(tmp_path), 'heat in the recording')
        first.send_signal(signal.SIGKILL)
        assert first.wait() == -signal.SIGKILL
        # A second planner's life in the same folder.
        car.commands.clear()
        second = car.start('-p', f'flight_recorder:={tmp_path}')
        car.wait_for_heat()
        second.send_signal(signal.SIGTERM)
        assert second.wait() == 0
    killed, ended = recordings_in(tmp_path)
    for path in (killed, ended):
        replayed = replay(read_flight(path))
        assert replayed.comparison.is_reproduced and replayed.comparison.commands > 2
        assert replayed.course.heating
    assert [given.step.call for given in read_flight(tmp_path).given][-1] == 'stop'


@pytest.mark.needs('mcap')
def test_whatever_the_node_got_the_step_without_ros_says_the_same(rehearsal, car, tmp_path):
    """Refusals, an opt-out, silence, a cancellation, parameters, and a clock that is set back."""
    process = car.start('-p', f'flight_recorder:={tmp_path}')
    car.wait_for_heat()
    for happening in (
            lambda: car.send_route(speed=[-1.0]), lambda: car.send_route(route_id='work', speed=[-1.0]),
            lambda: car.send_route(route_id='work'), lambda: car.send_state(temperature=math.nan),
            lambda: car.enable(False),
            lambda: car.enable(True), lambda: car.give(RoutePlan()),
            lambda: car.send_route(target_battery_temperature=math.nan),
            lambda: car.set(target_battery_temperature=21.0), lambda: car.set(battery_state_timeout=0.1),
            lambda: car.set(vehicle='small_car'), lambda: car.at(car.now_ns - 3600 * NS_PER_S),
            lambda: car.send_route(route_id='again')):
        happening()
        rehearsal.advance(4.0)
    process.end()
    statuses = {plan.status for plan in car.plans.messages}
    assert statuses >= {PreheatPlan.TARGET_UNREACHABLE, PreheatPlan.INVALID_INPUT, PreheatPlan.DISABLED,
                        PreheatPlan.NO_CHARGING_PLANNED, PreheatPlan.STALE_INPUT}
    replayed = replay(read_flight(tmp_path))
    assert replayed.comparison.is_reproduced and replayed.comparison.commands > 200, replayed.comparison


def test_a_cancelled_trip_outlives_a_killed_process(rehearsal, car, tmp_path):
    """The navigation latches its route; a button in the car, another node, cancels it."""
    memory = tmp_path / 'state.json'
    first = car.start('-p', f'state_file:={memory}')
    car.wait_for_heat()
    button = rehearsal.publisher(RoutePlan, 'route_plan', 1)
    button.wait_for_subscription()
    button.publish(RoutePlan())
    car.wait_for(HvchCommand.NO_CHARGING_PLANNED)
    assert json.loads(memory.read_text())['driver']['cancelled_trip']
    first.kill()
    car.commands.clear()
    car.start('-p', f'state_file:={memory}')
    car.wait_for(HvchCommand.NO_CHARGING_PLANNED)
    assert not any(command.battery_heating_power for command in car.commands.messages)
    car.send_route(route_id='work')
    car.wait_for_heat()


def test_a_killed_planner_goes_on_with_the_trip_that_nobody_sends_again(car, tmp_path):
    """The navigation has gone; only the planner's own state knows the route."""
    memory = tmp_path / 'state.json'
    first = car.start('-p', f'state_file:={memory}')
    car.wait_for_heat()
    first.kill()
    car.publishers[RoutePlan].destroy()
    car.commands.clear()
    second = car.start('-p', f'state_file:={memory}')
    car.wait_for_heat()
    assert 'the planner goes on from its state of ' in second.output()
    # Another parameter reads the route again, which the planner knows as a message.
    assert car.set(planning_step=15.0).successful
    car.commands.clear()
    car.wait_for_heat()
    second.end()
    # The driver's button counts as before.
    car.commands.clear()
    third = car.start('-p', f'state_file:={memory}', '-p', 'planning_step:=15.0')
    car.wait_for_heat()
    third.end()


@pytest.mark.parametrize('change', ['parameter', 'vehicle', 'damaged', 'edited', 'other file'])
def test_a_state_of_other_circumstances_is_not_gone_on_from(car, tmp_path, change):
    memory = tmp_path / 'state.json'
    first = car.start('-p', f'state_file:={memory}')
    car.wait_for_heat()
    first.end()
    car.publishers[RoutePlan].destroy()
    running, more = memory.with_name('state.json.running'), []
    if change == 'parameter':
        more = ['-p', 'command_lease:=0.9']
    elif change == 'vehicle':
        more = ['-p', 'vehicle:=small_car']
    elif change == 'damaged':
        running.write_bytes(running.read_bytes()[:-500])
    elif change == 'edited':
        memory.write_text(memory.read_text() + ' ')
    else:
        running.write_text('my notes')
    car.commands.clear()
    second = car.start('-p', f'state_file:={memory}', *more)
    car.wait_for(HvchCommand.NO_ROUTE)
    assert not any(command.battery_heating_power for command in car.commands.messages)
    second.end()
    assert 'goes on from its state' not in second.output()
    if change == 'damaged':
        assert 'state.json.running: is damaged' in second.output()
    if change == 'other file':
        assert running.read_text() == 'my notes'


# The state file

VEHICLE = (configuration_folder('vehicles') / 'reference.yaml').read_bytes()
NOT_OURS = 'is not a state file of this planner, and stays as it is; name another file'


class Planner(PlannerCar):
    """A planner with a battery, and its diagnostics of the state file."""

    def __init__(self, rehearsal, path):
        super().__init__(rehearsal)
        self.start('-p', 'command_period:=0.2', '-p', 'command_lease:=0.8', '-p', f'state_file:={path}')

    def learn(self, vehicle='reference'):
        """Give battery states until this vehicle has an estimate that can be stored."""
        self.diagnostics.clear()
        with self.feeding():
            self.entry('estimation', lambda entry: entry.hardware_id == vehicle)

    def change(self, **values):
        """Set parameters; returns the reason of the refusal, empty without a refusal."""
        result = self.set(**values)
        assert result.successful == (result.reason == '')
        return result.reason

    def says(self, level, text):
        """Return the values of the state file's entry once it has this level and message."""
        self.diagnostics.clear()
        return values_of(self.entry('state file', lambda entry: entry.level == level and text in entry.message))


@pytest.fixture
def start(rehearsal):
    """`start(path)` returns a Planner with this state file."""
    return lambda path: Planner(rehearsal, path)


OK, ERROR = DiagnosticStatus.OK, DiagnosticStatus.ERROR


def test_with_a_file_of_others_it_starts_and_never_writes_it(start, tmp_path):
    path = tmp_path / 'memory' / 'theirs.yaml'
    path.parent.mkdir()
    path.write_bytes(VEHICLE)
    before = path.stat().st_mtime_ns
    planner = start(path)
    problem = f'{path}: {NOT_OURS}'
    assert planner.says(ERROR, problem)['last write'] == 'nothing written yet'
    planner.learn()
    # At the change of the car, and at the end, it would be written.
    assert planner.change(vehicle='small_car') == ''
    planner.says(ERROR, problem)
    planner.learn('small_car')
    planner.process.end()
    assert (path.read_bytes(), path.stat().st_mtime_ns) == (VEHICLE, before)
    assert os.listdir(path.parent) == ['theirs.yaml']
    assert f'state_file: {problem}.' in planner.process.output()


def test_a_file_of_others_is_refused_while_it_runs(start, tmp_path):
    theirs, mine = tmp_path / 'car.yaml', tmp_path / 'mine.json'
    theirs.write_bytes(VEHICLE)
    link = tmp_path / 'link'
    link.symlink_to(theirs)
    planner = start(mine)
    planner.learn()
    for path in (theirs, link):
        assert planner.change(state_file=str(path)) == f'state_file: {path}: {NOT_OURS}'
    assert planner.says(OK, 'nothing written yet')['file'] == str(mine)
    planner.process.end()
    # The earlier value still holds.
    assert len(json.loads(mine.read_text())['cars']) == 1
    assert (theirs.read_bytes(), link.is_symlink()) == (VEHICLE, True)


def test_a_failure_to_write_is_told_until_it_is_written_again(start, tmp_path):
    folder = tmp_path / 'memory'
    path = folder / 'state.json'
    planner = start(path)
    planner.learn()
    planner.says(OK, 'nothing written yet')
    # Root may write into any folder, but not below a file.
    shutil.rmtree(folder)
    folder.write_text('in the way')
    assert planner.change(vehicle='small_car') == ''
    planner.says(ERROR, f'{path}: cannot be a file: {os.strerror(errno.ENOTDIR)}')
    folder.unlink()
    planner.learn('small_car')
    assert planner.change(vehicle='reference') == ''
    assert planner.says(OK, ' s ago')['file'] == str(path)
    assert len(json.loads(path.read_text())['cars']) == 1
    # The file now keeps both.
    planner.learn()
    planner.process.end()
    assert len(json.loads(path.read_text())['cars']) == 2
    assert f'state_file: {path} is written again' in planner.process.output()
