# SPDX-License-Identifier: Apache-2.0
"""Real failures of the disk, in processes of their own: a full disk, and a process that is killed."""

import subprocess
import sys

import pytest

from bev_preheat.recording.flight import read_flight
from bev_preheat.recording.ring import recordings_in

pytestmark = [pytest.mark.needs('mcap'), pytest.mark.costly]
# A planner's life without a planner: steps as fast as they come, for ever or until `put` raises.
PROGRAM = """
import sys, time
from pathlib import Path
from bev_preheat.recording import writer as module
from bev_preheat.recording.records import Beginning
from bev_preheat.recording.records import RecordedStep
from bev_preheat.recording.writer import BEGINNING_CHANNEL, Entry, Recording, RecordingWriter, STEP_CHANNEL
module.COLLECTING_S, module.REOPENED_AFTER_S = 0.01, 0.0
head = (Entry(BEGINNING_CHANNEL, 1, Beginning(
    '0', '/planner', '01234567', 0, 1, False, {}, '').as_dictionary()),)
writer = RecordingWriter(Recording(Path(sys.argv[1]), 10**9, '01234567', '20260101T000000'), {}, lambda: head)
"""
FULL = PROGRAM + """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
for step in range(2000):
    writer.put(Entry(STEP_CHANNEL, step, RecordedStep(step)))
    if step % 100 == 0:
        time.sleep(0.02)
time.sleep(0.2)
print(writer.report)
print(writer.dropped)
"""


def test_a_file_that_cannot_grow_costs_steps_and_not_the_planner(tmp_path):
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
