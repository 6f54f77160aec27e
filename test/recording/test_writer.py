# SPDX-License-Identifier: Apache-2.0
"""The writer never disturbs the planner: bounded folder, full or slow disk, and every loss is counted."""

import errno
import os
import shutil
import subprocess
import sys
import time

from hypothesis import given
from hypothesis import strategies as st
import pytest
from waiting import poll_until

from bev_preheat.errors import InvalidInput
from bev_preheat.recording import writer as module
from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.records import RecordedStep
from bev_preheat.recording.ring import check_folder, make_room, recordings_in
from bev_preheat.recording.writer import Entry, Recording, RecordingWriter, STEP_CHANNEL

pytestmark = pytest.mark.needs('mcap')
NUMBERS = st.integers(0, 2**62)


def a_writer(folder):
    return RecordingWriter(Recording(folder, 10**9, '01234567', '20260101T000000'), {}, tuple)


@given(st.builds(RecordedStep, NUMBERS, st.sampled_from(['step', 'fail', 'stop']),
                 st.lists(st.dictionaries(st.text(max_size=5), st.integers()), max_size=3).map(tuple), st.text(),
                 st.none() | st.tuples(st.floats(0.0, 1e5), NUMBERS, st.integers(0, 18)),
                 st.none() | st.integers(0, 18)))
def test_a_step_survives_its_plain_values(step):
    assert RecordedStep.from_dictionary(step.as_dictionary()) == step


@pytest.mark.parametrize('values', [
    None, {}, [], {'now_ns': 'x'}, {**RecordedStep(1).as_dictionary(), 'command': [1.0]}])
def test_a_damaged_step_is_named(values):
    with pytest.raises(InvalidInput, match='damaged'):
        RecordedStep.from_dictionary(values)


def test_a_folder_that_cannot_be_written_is_reported_and_the_planner_goes_on(tmp_path):
    blocked = tmp_path / 'file'
    blocked.write_text('mine')
    writer = a_writer(blocked / 'folder')
    for second in range(100):
        writer.put(Entry(STEP_CHANNEL, second, RecordedStep(second)))
    poll_until(lambda: writer.report, 'a report')
    assert 'cannot be written' in writer.report and 'goes on without a recording' in writer.report
    poll_until(lambda: writer.dropped == 100, 'the dropped steps')
    assert blocked.read_text() == 'mine'
    writer.close()


def test_a_full_disk_is_reported_counted_and_tried_again(tmp_path, monkeypatch):
    full = [True]

    def step(second):
        if full[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return Entry(STEP_CHANNEL, second, RecordedStep(second)),

    writer = a_writer(tmp_path)
    monkeypatch.setattr(module, 'REOPENED_AFTER_S', 0.0)
    writer.put_group(lambda: step(1))
    poll_until(lambda: 'No space left' in writer.report, 'the full disk')
    full[0] = False
    writer.put_group(lambda: step(2))
    poll_until(lambda: not writer.report, 'the end of the problem')
    writer.close(10.0)
    assert writer.dropped == 1
    data = b''.join(path.read_bytes() for path in recordings_in(tmp_path))
    assert b'{"dropped":1}' in data and b'"now_ns":2' in data


def test_after_its_file_was_deleted_it_writes_another_one(tmp_path, monkeypatch):
    monkeypatch.setattr(module, 'COLLECTING_S', 0.01)
    writer = a_writer(tmp_path / 'flights')
    writer.put(Entry(STEP_CHANNEL, 1, RecordedStep(1)))
    poll_until(lambda: writer.path, 'a file')
    shutil.rmtree(tmp_path / 'flights')
    first = writer.path
    # The first of these may still go into the deleted file.
    for second in range(2, 1000):
        writer.put(Entry(STEP_CHANNEL, second, RecordedStep(second)))
        if writer.path != first:
            break
        time.sleep(0.02)
    writer.close(10.0)
    [written] = recordings_in(tmp_path / 'flights')
    assert written.name.endswith('_0001.mcap') and f'"now_ns":{second},'.encode() in written.read_bytes()


def test_a_disk_that_hangs_costs_entries_not_time(tmp_path, monkeypatch):
    monkeypatch.setattr(module, 'MOST_WAITING', 50)
    writer = a_writer(tmp_path)
    began = time.monotonic()
    for _ in range(1000):
        writer.put_group(lambda: time.sleep(0.2) or ())
    assert time.monotonic() - began < 1.0
    assert writer.dropped > 800
    writer.close(0.0)


# A planner's life without a planner: steps as fast as they come, on a disk that gets full.
FULL = """
import resource, sys, time
from pathlib import Path
from bev_preheat.recording import writer as module
from bev_preheat.recording.records import Beginning, RecordedStep
from bev_preheat.recording.writer import BEGINNING_CHANNEL, Entry, Recording, RecordingWriter, STEP_CHANNEL
module.COLLECTING_S, module.REOPENED_AFTER_S = 0.01, 0.0
head = (Entry(BEGINNING_CHANNEL, 1, Beginning(
    '0', '/planner', '01234567', 0, 1, False, {}, '').as_dictionary()),)
writer = RecordingWriter(Recording(Path(sys.argv[1]), 10**9, '01234567', '20260101T000000'), {}, lambda: head)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
for step in range(2000):
    writer.put(Entry(STEP_CHANNEL, step, RecordedStep(step)))
    if step % 100 == 0:
        time.sleep(0.02)
time.sleep(0.2)
print(writer.report)
print(writer.dropped)
"""


@pytest.mark.costly
def test_a_file_that_cannot_grow_costs_steps_and_not_the_planner(tmp_path):
    """A real failure, in a process of its own."""
    result = subprocess.run(
        [sys.executable, '-c', FULL, str(tmp_path)], capture_output=True, text=True, check=True)
    report, dropped = result.stdout.splitlines()
    assert report == '' or ('File too large' in report and 'goes on' in report)
    assert 0 < int(dropped) < 2000
    # Every file is readable up to its last whole step, and gaps are reported.
    files = recordings_in(tmp_path)
    assert len(files) > 1
    flight = read_flight(files[0])
    assert flight.gaps and 'were not written' in ' '.join(flight.remarks)
    instants = [given.step.now_ns for given in flight.given]
    assert instants == sorted(set(instants)) and len(instants) + int(dropped) <= 2000


def test_the_folder_is_bounded_and_only_own_files_are_deleted(tmp_path):
    foreign = [tmp_path / name for name in ('holiday.mcap', 'flight_x.mcap', 'notes.txt')]
    for path in foreign:
        path.write_bytes(b'x' * 1000)
    own = [tmp_path / f'flight_2026010{day}T000000_01234567_0000.mcap' for day in range(1, 6)]
    for path in own:
        path.write_bytes(b'x' * 1000)
    assert make_room(tmp_path, 2500, own[-1]) == own[:3]
    assert recordings_in(tmp_path) == own[3:] and all(path.exists() for path in foreign)
    # The file that is being written stays, also if it alone is too large.
    assert make_room(tmp_path, 0, own[-1]) == [own[3]]
    assert own[-1].exists()


def test_two_planners_in_a_folder_do_not_delete_what_the_other_writes(tmp_path):
    other = RecordingWriter(Recording(tmp_path, 10**9, '89abcdef', '20250101T000000'), {}, tuple)
    other.put(Entry(STEP_CHANNEL, 1, RecordedStep(1)))
    poll_until(lambda: other.path, 'a file')
    [written] = recordings_in(tmp_path)
    old = tmp_path / 'flight_20260101T000000_01234567_0000.mcap'
    old.write_bytes(b'x' * 1000)
    assert make_room(tmp_path, 0, tmp_path / 'own') == [old]
    other.close(10.0)
    assert make_room(tmp_path, 0, tmp_path / 'own') == [written]


def test_a_file_or_a_dangling_link_is_no_folder(tmp_path):
    file, link = tmp_path / 'file', tmp_path / 'link'
    file.write_text('')
    link.symlink_to(tmp_path / 'nowhere')
    for path, words in ((file, 'not a folder'), (link, 'does not exist')):
        with pytest.raises(InvalidInput, match=words):
            check_folder(path)
    check_folder(tmp_path / 'new' / 'folder')
