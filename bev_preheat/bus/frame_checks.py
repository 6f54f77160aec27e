# SPDX-License-Identifier: Apache-2.0
"""Checks of the frames of one CAN message: length, checksum, alive counter, rate."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
import re
from typing import Any

from bev_preheat.bus.checksums import Checksum, signal_of
from bev_preheat.bus.live_map import MessageRule
from bev_preheat.errors import InvalidInput

# Counters are recognised by these words in their names, unless the map names one.
COUNTER = re.compile(r'(^|_)(alive|alv|live|msg|message|rolling)?_?(counter|cntr|cnt|ctr|bz)$|alivecounter|'
                     r'rollingcounter|messagecounter', re.IGNORECASE)
# Frames within RATE_WINDOW_S may exceed those of the cycle time by this factor, and by MORE_FRAMES.
RATE_WINDOW_S, MOST_RATE, MORE_FRAMES = 1.0, 2.5, 2


class FrameChecks:
    """The checks of one message. A dropped frame leaves the last readings as they are, and these expire."""

    def __init__(self, message: Any, rule: MessageRule | None, where: str) -> None:
        """Take a cantools Message; raises InvalidInput if the map's rule does not fit it."""
        rule = rule or MessageRule()
        self.message = message
        self.counter = _counter(message, rule, where)
        self.checksum = None if rule.checksum is None else Checksum(
            rule.checksum, message, f'{where}.checksum', self.counter)
        self._largest_step = rule.largest_step
        self._count: int | None = None
        self._stays = 0
        cycle_s = rule.cycle_time_s if rule.cycle_time_s is not None else (message.cycle_time or 0) / 1000.0
        self.cycle_time_s = cycle_s
        most = MOST_RATE * RATE_WINDOW_S / cycle_s + MORE_FRAMES if cycle_s > 0.0 else None
        self._most_frames = None if most is None else int(most)
        self._instants_s: deque[float] = deque(maxlen=1 if most is None else int(most) + 1)

    def in_words(self) -> list[str]:
        """Return the names of counter, checksum and cycle time that are checked."""
        return [*([] if self.counter is None else [self.counter.name]),
                *([] if self.checksum is None else [self.checksum.signal]),
                *([f'{self.cycle_time_s:g} s'] if self._most_frames is not None else [])]

    def check_data(self, data: bytes, instant_s: float) -> None:
        """Raise InvalidInput if a frame comes too often, is too short, or has a wrong checksum."""
        name = self.message.name
        self._instants_s.append(instant_s)
        if self._most_frames is not None and len(self._instants_s) > self._most_frames:
            window_s = instant_s - self._instants_s[0]
            if window_s < RATE_WINDOW_S:
                raise InvalidInput(
                    f'{name}: {len(self._instants_s)} frames within {window_s:.2f} s; its cycle time of '
                    f'{self.cycle_time_s:g} s allows {self._most_frames} in {RATE_WINDOW_S:g} s; is there a '
                    'second sender?')
        if len(data) < self.message.length:
            raise InvalidInput(f'{name}: a frame of {len(data)} bytes; the DBC has {self.message.length}')
        if self.checksum is not None:
            problem = self.checksum.problem(data)
            if problem:
                raise InvalidInput(f'{name}: {problem}')

    def check_counter(self, values: Mapping[str, float]) -> None:
        """Raise InvalidInput if the counter of a frame with these raw values stays, or skips too many counts."""
        if self.counter is None or self.counter.name not in values:
            return
        name = f'{self.message.name}: the counter {self.counter.name}'
        count, before = int(values[self.counter.name]), self._count
        self._count = count
        if before is None:
            return
        if count == before:
            self._stays += 1
            raise InvalidInput(f'{name} has stayed at {count} for {self._stays + 1} frames')
        self._stays = 0
        step = (count - before) % counts_of(self.counter, self.checksum)
        if self._largest_step is not None and step > self._largest_step:
            raise InvalidInput(f'{name} went from {before} to {count}; at most {self._largest_step} steps are '
                               'allowed')


def counts_of(signal: Any, checksum: Checksum | None) -> int:
    """Return how many values a counter has, before it begins again at 0; a Checksum's E2E profile says so."""
    if checksum is not None and checksum.profile is not None:
        return checksum.profile.counts
    highest = signal.maximum if signal.maximum else 2**signal.length - 1
    return int(min(highest, 2**signal.length - 1)) + 1


def _counter(message: Any, rule: MessageRule, where: str) -> Any:
    if rule.counter is not None:
        return signal_of(message, rule.counter, f'{where}.counter')
    found = [signal for signal in message.signals if COUNTER.search(signal.name)]
    # Of several, only the map can tell which one counts the frames.
    return found[0] if len(found) == 1 and found[0].length <= 8 else None
