# SPDX-License-Identifier: Apache-2.0
"""The banner on a planner's health, and values as the page shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import json
import math
from typing import Any, NamedTuple

from bev_preheat.planning.status import Status

# A message is late after this time [s of real time], or after LATE_INTERVALS of its usual intervals.
LATE_S, LATE_INTERVALS, LONGEST_LATE_S = 3.0, 4.0, 40.0
# The battery state stands, though the planner answers.
FROZEN_S = 4.0
# Weight of the latest interval in the usual one.
INTERVAL_WEIGHT = 0.2


class Surroundings(NamedTuple):
    """
    Whether a planner is there, whether it follows /clock, and whether /clock has a publisher.

    `rivals` says that other nodes publish its plan's topic, too; '' if it is alone.
    """

    is_there: bool = True
    is_simulated: bool = False
    has_clock: bool = False
    rivals: str = ''


class Banner(NamedTuple):
    """A sentence at the top of the page, its level (`error`, `warning`), and the word in the list of planners."""

    level: str
    text: str
    word: str


@dataclass
class Pulse:
    """When the messages of a topic came [s, monotonic], and how far apart they usually are [s]."""

    came_s: float | None = None
    usual_s: float = 1.0
    _stamp_s: float | None = field(default=None, repr=False)
    # Since when the stamps have not advanced.
    stands_since_s: float | None = None

    def beat(self, now_s: float, stamp_s: float) -> None:
        """Note a message with a stamp [s of the planner's clock]."""
        if self.came_s is not None:
            self.usual_s += INTERVAL_WEIGHT * (min(now_s - self.came_s, LONGEST_LATE_S) - self.usual_s)
        if stamp_s != self._stamp_s:
            self.stands_since_s = None
        elif self.stands_since_s is None:
            self.stands_since_s = self.came_s
        self.came_s, self._stamp_s = now_s, stamp_s

    def age_s(self, now_s: float) -> float | None:
        """Return the age of the latest message [s]; None before the first."""
        return None if self.came_s is None else max(0.0, now_s - self.came_s)

    def is_late(self, now_s: float) -> bool:
        """Return whether the next message is overdue."""
        age_s = self.age_s(now_s)
        return age_s is not None and age_s > min(max(LATE_S, LATE_INTERVALS * self.usual_s), LONGEST_LATE_S)

    def stands_s(self, now_s: float) -> float:
        """Return for how long the stamps have not advanced although messages come [s]."""
        return 0.0 if self.stands_since_s is None else now_s - self.stands_since_s


def banner_of(around: Surroundings, command: Pulse, battery: Pulse, now_s: float) -> Banner | None:
    """Return the Banner on a missing, silent or frozen planner; None if all is well."""
    age_s = command.age_s(now_s)
    if not around.is_there:
        return Banner('error', 'The planner has disappeared. Its heater command has expired, so the heater is '
                      'off. The values below are its last ones.'
                      if age_s is not None else 'The planner has disappeared.', 'gone')
    if around.rivals:
        return Banner('error', f'{around.rivals}. Their plans are not mixed: the values below are from before.',
                      'not alone')
    if age_s is None:
        return Banner('warning', 'The planner is there; its first message has not arrived yet.', 'no message yet')
    if command.is_late(now_s):
        if around.is_simulated:
            why = '/clock does not advance' if around.has_clock else 'nothing publishes /clock'
            return Banner('error', f'The clock stands: {why}. No message for {age_s:.0f} s.', 'its clock stands')
        return Banner('error', f'The planner is silent: no message for {age_s:.0f} s. Without fresh commands the '
                      'heater is off.', 'silent')
    if command.stands_s(now_s) > FROZEN_S:
        return Banner('error', f"The planner's clock has been standing for {command.stands_s(now_s):.0f} s.",
                      'its clock stands')
    if battery.is_late(now_s):
        return Banner('warning', f'No battery state for {battery.age_s(now_s):.0f} s: the measured '
                      'values are old.', 'no battery state')
    if battery.stands_s(now_s) > FROZEN_S:
        return Banner('warning', 'The battery state repeats one stamp: the measured values are old.',
                      'the battery state stands')
    return None


# Values beyond this are no measurement of a car, and no scale of a chart fits them.
MOST_VALUE = 1e9
LONGEST_SENTENCE = 2000


def number(value: float | None, digits: int = 3) -> float | None:
    """Return a number rounded for display; None if it is unknown, infinite or beyond MOST_VALUE."""
    if value is None or not math.isfinite(value) or abs(value) > MOST_VALUE:
        return None
    return round(value, digits)


def instant(value: float | None) -> float | None:
    """Return an instant [s] in milliseconds' resolution; None if it is unknown or unset."""
    return None if value is None or not math.isfinite(value) or value <= 0.0 else round(value, 3)


def instants(values: Sequence[float]) -> list[float | None]:
    """Return the instants of a column [s]."""
    return [instant(value) for value in values]


def numbers(values: Sequence[float], digits: int = 3) -> list[float | None]:
    """Return the numbers of a column."""
    return [number(value, digits) for value in values]


def written(value: Any) -> str:
    """Return a value as JSON, without characters that end a script element."""
    return json.dumps(value, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')


def status_name(number: int) -> str:
    """Return the name of a status."""
    try:
        return Status(number).name
    except ValueError:
        return f'STATUS_{number}'
