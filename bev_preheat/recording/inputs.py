# SPDX-License-Identifier: Apache-2.0
"""Unusual inputs in a recording: late, lost and overtaken states, a clock that jumps, unannounced delays."""

from __future__ import annotations

from collections import deque
from statistics import median
import struct
from typing import TYPE_CHECKING

from bev_preheat.control.events import BATTERY_STATE
from bev_preheat.numerics import NS_PER_S
from bev_preheat.planning.explanation import duration_text
from bev_preheat.recording.flight import moment

if TYPE_CHECKING:
    from bev_preheat.recording.flight import Given
    from bev_preheat.recording.player import Played

# A clock that goes back by less is only read in two threads [ns].
CLOCK_NOISE_NS = 50_000_000
# The planner makes a step at least this often, unless it sleeps [ns].
STEPS_WITHIN_NS = 15 * NS_PER_S
# Ages and delays below these are usual [s].
USUAL_AGE_S, USUAL_DELAY_S = 0.5, 60.0
# A state is missing if the interval between two is longer than the usual one by this factor; that is worth a word
# beyond this share of the states.
MISSING_FACTOR, USUAL_SHARE_MISSING = 1.5, 0.02
# Offsets of the sensor that the estimation subtracts [K].
USUAL_OFFSET_K = 0.5
MOST_KEPT, NAMED_PROBLEMS = 100_000, 3
# CDR: four bytes, then the stamp of the header as seconds and nanoseconds.
STAMP = struct.Struct('<4xiI')


class InputRemarks:
    """Looks at the inputs of a drive, step by step; `sentences` names the unusual inputs."""

    def __init__(self) -> None:
        """Begin without a step."""
        self._latest_ns: int | None = None
        self._back: list[str] = []
        self._pauses: list[str] = []
        self._stamp_ns: int | None = None
        # Of the latest states: age on arrival, and interval from the state before [s].
        self._ages_s: deque[float] = deque(maxlen=MOST_KEPT)
        self._intervals_s: deque[float] = deque(maxlen=MOST_KEPT)
        self._overtaken = 0
        self._delay_s = self._offset_k = 0.0

    def add(self, given: Given, played: Played) -> None:
        """Add a step."""
        self._look_at_clock(given.step.now_ns)
        if given.message is not None and any(event.get('kind') == BATTERY_STATE for event in given.step.events):
            self._look_at_state(given.step.now_ns, given.message[1])
        mission, estimate = played.state.active_mission, played.state.estimate
        if mission is not None and abs(mission.delay_ns) > abs(self._delay_s) * NS_PER_S:
            self._delay_s = mission.delay_ns / NS_PER_S
        if estimate is not None and abs(estimate.sensor_offset_k) > abs(self._offset_k):
            self._offset_k = estimate.sensor_offset_k

    def _look_at_clock(self, now_ns: int) -> None:
        before_ns, self._latest_ns = self._latest_ns, now_ns
        if before_ns is None:
            return
        if now_ns < before_ns - CLOCK_NOISE_NS:
            self._back.append(f'by {(before_ns - now_ns) / NS_PER_S:.1f} s at {moment(before_ns)}')
        elif now_ns > before_ns + STEPS_WITHIN_NS:
            self._pauses.append(f'{duration_text((now_ns - before_ns) / NS_PER_S)} from {moment(before_ns)} on')

    def _look_at_state(self, now_ns: int, message: bytes) -> None:
        if len(message) < STAMP.size or message[1] != 1:
            return
        seconds, nanoseconds = STAMP.unpack_from(message)
        stamp_ns, before_ns = seconds * NS_PER_S + nanoseconds, self._stamp_ns
        if before_ns is not None and 0 < before_ns - stamp_ns < STEPS_WITHIN_NS:
            self._overtaken += 1
            return
        self._stamp_ns = stamp_ns
        self._ages_s.append((now_ns - stamp_ns) / NS_PER_S)
        if before_ns is not None and stamp_ns > before_ns:
            self._intervals_s.append((stamp_ns - before_ns) / NS_PER_S)

    @property
    def sentences(self) -> list[str]:
        """The unusual inputs, a sentence each."""
        found = []
        if self._back:
            found.append(f'the clock went back {_times(self._back)}')
        if self._pauses:
            found.append('the planner made no step, because it slept or its clock was set forward: '
                         f'{_times(self._pauses)}')
        if self._ages_s and median(self._ages_s) > USUAL_AGE_S:
            found.append(f'battery_state arrives {median(self._ages_s):.1f} s old (median)')
        if self._intervals_s:
            usual_s = median(self._intervals_s)
            missing = sum(interval_s > MISSING_FACTOR * usual_s for interval_s in self._intervals_s)
            missing -= self._overtaken
            if missing > USUAL_SHARE_MISSING * len(self._intervals_s):
                found.append(f'battery_state comes every {usual_s:g} s, and is missing {missing} times; the '
                             f'longest interval is {max(self._intervals_s):.1f} s')
        if self._overtaken:
            found.append(f'{self._overtaken} battery states were overtaken by later ones')
        if abs(self._delay_s) > USUAL_DELAY_S:
            found.append(f'the vehicle was up to {duration_text(abs(self._delay_s))} '
                         f'{"behind" if self._delay_s > 0.0 else "ahead of"} its route; the planner learned it '
                         'from power or position, not from a new route_plan')
        if abs(self._offset_k) > USUAL_OFFSET_K:
            found.append(f'the temperature sensor reads up to {abs(self._offset_k):.1f} K too '
                         f'{"warm" if self._offset_k > 0.0 else "cold"}, as the estimation found')
        return found


def _times(found: list[str]) -> str:
    more = len(found) - NAMED_PROBLEMS
    return ', '.join(found[:NAMED_PROBLEMS]) + (f' and {more} more times' if more > 0 else '')
