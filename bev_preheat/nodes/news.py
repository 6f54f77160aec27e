# SPDX-License-Identifier: Apache-2.0
"""Filters repeated sentences out of the log."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# A sentence is not repeated within this time [s]; at most this many different ones are logged in it.
PERIOD_S = 5.0
MOST_SENTENCES = 10
FIGURE = re.compile(r'[-+]?\d+(\.\d+)?(e[-+]?\d+)?')


class RepetitionFilter:
    """
    Distinguishes news from repetition.

    The logger's own throttle would suppress a second, different problem. Sentences that differ only in their
    figures, such as ages, count as the same.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Take a clock [s of real time], because problems also occur while simulated time stands."""
        self._clock_s = clock_s
        self._told_s: dict[str, float] = {}

    def has(self, sentence: str) -> bool:
        """Return whether to log a sentence now; if so, record it as logged."""
        kind, now_s = without_figures(sentence), self._clock_s()
        self._told_s = {told: told_s for told, told_s in self._told_s.items()
                        if now_s - told_s < PERIOD_S}
        if kind in self._told_s or len(self._told_s) >= MOST_SENTENCES:
            return False
        self._told_s[kind] = now_s
        return True


def without_figures(sentence: str) -> str:
    """Return a sentence with `#` in place of each number in it."""
    return FIGURE.sub('#', sentence)
