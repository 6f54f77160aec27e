# SPDX-License-Identifier: Apache-2.0
"""Whether battery states arrive often enough for heating."""

from __future__ import annotations

from collections import deque

# After this many long gaps in a row the feed is slow, after this many short ones it is steady again.
SLOW_GAPS, STEADY_GAPS = 2, 3


class FeedWatch:
    """Compares the time between valid battery states with the allowed time."""

    def __init__(self) -> None:
        """Start without states."""
        self._latest_s: float | None = None
        self._too_long_s: deque[float] = deque(maxlen=SLOW_GAPS)
        self._in_time = 0
        self._is_slow = self._has_expired = False

    def note_expired(self) -> None:
        """Note that the latest state is too old, and no other has arrived."""
        self._has_expired = True

    def lose_time(self) -> None:
        """Forget when the latest state arrived, because the clock was restarted."""
        self._latest_s, self._has_expired = None, False

    def see(self, instant_s: float, timeout_s: float) -> str:
        """
        Return the doubt about the feed after a state with the stamp `instant_s` [s]; '' while it is steady.

        A state is too old after `timeout_s` [s]; a gap counts as too long if that was noted within it.
        """
        if self._latest_s is not None:
            self._count(instant_s - self._latest_s)
        self._latest_s, self._has_expired = instant_s, False
        if not self._is_slow:
            return ''
        every_s = sum(self._too_long_s) / len(self._too_long_s)
        return (f'battery_state arrives every {every_s:.1f} s; battery_state_timeout is {timeout_s:g} s: '
                'raise it, or send battery_state more often')

    def _count(self, gap_s: float) -> None:
        if self._has_expired:
            self._in_time = 0
            self._too_long_s.append(gap_s)
            self._is_slow = self._is_slow or len(self._too_long_s) == SLOW_GAPS
            return
        self._in_time += 1
        if not self._is_slow or self._in_time >= STEADY_GAPS:
            self._is_slow = False
            self._too_long_s.clear()
