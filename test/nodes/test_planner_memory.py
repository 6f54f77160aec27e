# SPDX-License-Identifier: Apache-2.0
"""The planner's node and its `state_file`: refusals, backups and messages."""

import errno
import json
import os
import shutil

from diagnostic_msgs.msg import DiagnosticStatus
from planner_car import PlannerCar, values_of
import pytest

from bev_preheat.files.input_files import configuration_folder

VEHICLE = (configuration_folder('vehicles') / 'reference.yaml').read_bytes()
NOT_OURS = 'not overwritten: it is not a state file of this planner; name a file that does ' \
    'not exist yet'


class Planner(PlannerCar):
    """A planner with a battery, and its diagnostics of the state file."""

    def __init__(self, rehearsal, *arguments):
        super().__init__(rehearsal)
        self.start('-p', 'command_period:=0.2', '-p', 'command_lease:=0.8', *arguments)

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

    @property
    def entries(self):
        """Return the names of all entries so far."""
        return {entry.name for array in self.diagnostics.messages for entry in array.status}

    def end(self):
        self.process.end()


@pytest.fixture
def start(rehearsal):
    """`start(*arguments)` returns a Planner."""
    return lambda *arguments: Planner(rehearsal, *arguments)


OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


FOREIGN = {
    'a vehicle file': (lambda path: path.write_bytes(VEHICLE), NOT_OURS),
    'of a later version': (lambda path: path.write_text('{"bev_preheat_state_file": 9, "cars": {}}'),
                           'has format 9 of a later version; this version reads 1 to 3; name another file'),
    'pipe': (os.mkfifo, 'is a named pipe; only a regular file can be written')}


def what_is_there(path):
    """Return everything that a write would change; reading may change the access time."""
    found = path.lstat()
    return found.st_ino, found.st_mode, found.st_size, found.st_mtime_ns, found.st_ctime_ns


# test/estimation/test_state_file.py has more kinds of files.
@pytest.mark.parametrize('make, problem', FOREIGN.values(), ids=FOREIGN)
def test_with_a_file_of_others_it_starts_and_never_writes_it(start, tmp_path, make, problem):
    folder = tmp_path / 'memory'
    path = folder / 'state.json'
    folder.mkdir()
    make(path)
    before = what_is_there(path)
    planner = start('-p', f'state_file:={path}')
    problem = f'{path}: {problem}'
    assert planner.says(ERROR, problem)['last write'] == 'nothing written yet'
    planner.learn()
    # At the change of the car, and at the end, it would be written.
    assert planner.change(vehicle='small_car') == ''
    planner.says(ERROR, problem)
    planner.learn('small_car')
    planner.end()
    assert what_is_there(path) == before
    assert os.listdir(folder) == ['state.json']
    assert f'state_file: {problem}.' in planner.process.output()


def test_files_of_others_are_refused_while_it_runs(start, tmp_path):
    theirs, mine = tmp_path / 'car.yaml', tmp_path / 'mine.json'
    theirs.write_bytes(VEHICLE)
    planner = start('-p', f'state_file:={mine}')
    planner.learn()
    assert planner.change(state_file=str(theirs)) == f'state_file: {theirs}: {NOT_OURS}'
    link = tmp_path / 'link'
    link.symlink_to(theirs)
    assert planner.change(state_file=str(link)) == f'state_file: {link}: {NOT_OURS}'
    assert planner.says(OK, 'nothing written yet')['file'] == str(mine)
    planner.end()
    # The earlier value still holds.
    assert len(json.loads(mine.read_text())['cars']) == 1
    assert (theirs.read_bytes(), link.is_symlink()) == (VEHICLE, True)


def test_a_failure_to_write_is_told_until_it_is_written_again(start, tmp_path):
    folder = tmp_path / 'memory'
    path = folder / 'state.json'
    planner = start('-p', f'state_file:={path}')
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
    planner.end()
    assert len(json.loads(path.read_text())['cars']) == 2
    assert f'state_file: {path} is written again' in planner.process.output()
