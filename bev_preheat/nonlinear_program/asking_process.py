# SPDX-License-Identifier: Apache-2.0
"""Ends a solver's process together with the process that uses it."""

import ctypes
import os
import signal

# prctl(2).
PR_SET_PDEATHSIG = 1


def end_with(process_id: int) -> None:
    """
    Have the kernel kill this process when its parent with this id ends; exit at once if it already has.

    A watching thread would need computing time, which a low-priority process may not get for minutes. Linux only;
    elsewhere this does nothing.
    """
    try:
        prctl = ctypes.CDLL(None).prctl
    except (AttributeError, OSError, TypeError):
        return  # another system
    prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != process_id:
        # The parent ended before prctl().
        os._exit(0)
