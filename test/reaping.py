# SPDX-License-Identifier: Apache-2.0
"""
Kills the processes that a test process leaves behind, however it ends.

Ctrl-C and SIGKILL leave no time for fixtures. All that a test starts, and all that this starts, inherits a
variable from the environment. `python3 reaping.py NAME=VALUE PARENT` waits for the end of its parent and kills all
processes that have the variable.
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
    return subprocess.Popen([sys.executable, '-IS', __file__, mark, str(os.getpid())], env=unmarked,
                            stdin=subprocess.DEVNULL, start_new_session=True)


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
    while os.getppid() == int(sys.argv[2]):
        time.sleep(LOOK_PERIOD_S)
    while processes := left_behind(sys.argv[1].encode()):
        for process in processes:
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                pass
        time.sleep(LOOK_PERIOD_S)
