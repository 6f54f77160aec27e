# SPDX-License-Identifier: Apache-2.0
"""A test process that is killed leaves no process behind, neither its own nor those that these have started."""

from pathlib import Path
import signal
import subprocess
import sys

import pytest
import reaping
from waiting import poll_until

# It starts a process that starts another one in a session of its own, and prints the mark of both.
TEST_PROCESS = """
import os
import signal
import subprocess
import time

import reaping

# A background job of a shell inherits that SIGINT is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
guard = reaping.begin()
subprocess.Popen(['bash', '-c', 'setsid sleep 600 & wait'])
print(f'{reaping.VARIABLE}={os.environ[reaping.VARIABLE]}', flush=True)
time.sleep(600)
"""
# A controller that starts the test process as its worker.
CONTROLLER = """
import os
import signal
import subprocess
import sys
import time

signal.signal(signal.SIGINT, signal.default_int_handler)
subprocess.Popen([sys.executable, '-c', sys.argv[1]], env={**os.environ, 'PYTEST_XDIST_WORKER': 'gw0'})
time.sleep(600)
"""


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize('program', [(TEST_PROCESS,), (CONTROLLER, TEST_PROCESS)], ids=['alone', 'worker'])
def test_all_processes_of_a_killed_test_process_are_killed(monkeypatch, program, number):
    monkeypatch.delenv('PYTEST_XDIST_WORKER', raising=False)
    with subprocess.Popen([sys.executable, '-c', *program], cwd=Path(__file__).parent, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        mark = process.stdout.readline().strip().encode()
        # bash and sleep; the process itself has set the variable too late for its own environment.
        poll_until(lambda: len(reaping.left_behind(mark)) == 2, 'both processes')
        process.send_signal(number)
    poll_until(lambda: not reaping.left_behind(mark), 'their end')
