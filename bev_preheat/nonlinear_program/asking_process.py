# SPDX-License-Identifier: Apache-2.0
"""A solver's process ends with the process that asks it."""

import ctypes
import os
import signal

# prctl(2).
PR_SET_PDEATHSIG = 1


def end_with(process_id: int) -> None:
    """
    Have the kernel kill this process when its parent, of this id, ends; at once where it has.

    A thread that notices needs computing time, which a process that takes only what others leave may
    not get for minutes. Linux only; elsewhere this does nothing.
    """
    try:
        prctl = ctypes.CDLL(None).prctl
    except (AttributeError, OSError, TypeError):
        return  # another system
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != process_id:
        # It ended before.
        os._exit(0)
