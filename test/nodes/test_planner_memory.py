# SPDX-License-Identifier: Apache-2.0
"""The planner's node and its `state_file`; test/estimation/test_state_file.py has all kinds of files."""

import errno
import json
import os
import shutil

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import PlannerCar, values_of
import pytest

from bev_preheat.files.input_files import configuration_folder

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
