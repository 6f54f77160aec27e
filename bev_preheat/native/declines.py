# SPDX-License-Identifier: Apache-2.0
"""Calls that the core declined in this process, so that Python did the work: counted by function and reason."""

from __future__ import annotations

from collections import Counter
from typing import Any

OK, SATURATED, EMPTY, NO_CROSSING, LIMITED, CHEAPER_ELSEWHERE = range(6)
# Values of bev_status, then their names in the counter.
REASONS = {
    SATURATED: 'the battery is short of power', EMPTY: 'the charge runs out', NO_CROSSING: 'no crossing',
    LIMITED: 'a limit is active', CHEAPER_ELSEWHERE: 'heating elsewhere may cost less', -1: 'bad argument',
    -2: 'bad vehicle', -3: 'bad input', -4: 'no finite number', -5: 'search not settled'}
# Statuses besides OK that are answers: the caller uses the core's result.
ANSWERS = {
    'bev_run': {SATURATED}, 'bev_run_heated': {SATURATED}, 'bev_find_switch': {SATURATED},
    'bev_find_crossing': {NO_CROSSING}, 'bev_run_within_limits': {EMPTY},
    'bev_run_heated_within_limits': {EMPTY},
    'bev_plan_switch': {SATURATED, EMPTY, NO_CROSSING, LIMITED, CHEAPER_ELSEWHERE}}
_NONE: set[int] = set()


class Declines:
    """How often each function declined, and why."""

    def __init__(self) -> None:
        """Begin with no declined call."""
        self.counts: Counter[tuple[str, str]] = Counter()

    def note(self, status: int, function: Any, arguments: Any) -> int:
        """Count the status of a call unless it is an answer, and return it: an `errcheck` of ctypes."""
        if status != OK and status not in ANSWERS.get(function.__name__, _NONE):
            self.counts[function.__name__, REASONS.get(status, str(status))] += 1
        return status

    def in_words(self) -> str:
        """Return how many, and, if there are some, by function and reason; the most frequent first."""
        each = ', '.join(f'{count} x {name} ({reason})' for (name, reason), count in self.counts.most_common())
        return f'{self.counts.total()}: {each}' if each else '0'


# The counter of the process.
DECLINES = Declines()
