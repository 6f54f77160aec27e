# SPDX-License-Identifier: Apache-2.0
"""What is worth a line in the log: what has not just been said."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

# So long a sentence is not repeated [s], and so many different ones are told within that time.
PERIOD_S = 5.0
MOST_SENTENCES = 10
FIGURE = re.compile(r'[-+]?\d+(\.\d+)?(e[-+]?\d+)?')


class RepetitionFilter:
    """
    Tells news from repetition.

    A throttle of the logger's own would keep silent about a second, different problem. Sentences
    that differ in their figures only, such as ages, are the same here.
    """

    def __init__(self, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Take a clock [s of real time]: where simulated time stands, things go wrong too."""
        self._clock_s = clock_s
        self._told_s: dict[str, float] = {}

    def has(self, sentence: str) -> bool:
        """Return whether a sentence is to be logged now; if it is, it counts as told."""
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
