# SPDX-License-Identifier: Apache-2.0
"""How long tests wait for other processes and threads."""

import time

# Used up only by a failing test, or on a heavily loaded computer.
TIME_LIMIT_S = 240.0
POLL_S = 0.005


def poll_until(condition, what, timeout_s=TIME_LIMIT_S):
    """Return the first truthy `condition()`; AssertionError naming `what` at the limit."""
    deadline_s = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < deadline_s, f'{what}: not within {timeout_s:g} s'
        time.sleep(POLL_S)
    return value
