# SPDX-License-Identifier: Apache-2.0
"""
Kills the processes that a test process leaves behind, however it ends.

SIGKILL leaves no time for fixtures. All that a test starts, and all that this starts, inherits a variable from
the environment. `python3 reaping.py NAME=VALUE TEST_PROCESS CONTROLLER` waits for the end of its parent, the test
process, and kills all processes that have the variable. A worker of pytest-xdist would go on without its
controller (0: none), so it is killed, too.
"""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

VARIABLE = 'BEV_PREHEAT_TEST_PROCESS'
LOOK_PERIOD_S = 0.2


def begin():
    """Mark this process's future children, and start their guard."""
    unmarked = {name: value for name, value in os.environ.items() if name != VARIABLE}
    os.environ[VARIABLE] = f'{os.getpid()} {time.time_ns()}'
    # Not in the terminal's session, or Ctrl-C would end it first.
    mark = f'{VARIABLE}={os.environ[VARIABLE]}'
    controller = os.getppid() if 'PYTEST_XDIST_WORKER' in os.environ else 0
    return subprocess.Popen([sys.executable, '-IS', __file__, mark, str(os.getpid()), str(controller)],
                            env=unmarked, stdin=subprocess.DEVNULL, start_new_session=True)


def parent_of(process):
    """Return the id of a process's parent, 0 without the process."""
    try:
        # Behind the name, which may contain anything: state, parent.
        return int(Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()[1])
    except OSError:
        return 0


def left_behind(mark):
    """Return the ids of the processes whose environment has a mark."""
    found = []
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            if mark in (folder / 'environ').read_bytes().split(b'\0'):
                found.append(int(folder.name))
        except OSError:
            # Of another user, or gone.
            pass
    return found


if __name__ == '__main__':
    worker, controller = map(int, sys.argv[2:])
    while os.getppid() == worker:
        if controller and parent_of(worker) != controller:
            os.kill(worker, signal.SIGKILL)
        time.sleep(LOOK_PERIOD_S)
    while processes := left_behind(sys.argv[1].encode()):
        for process in processes:
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                pass
        time.sleep(LOOK_PERIOD_S)
