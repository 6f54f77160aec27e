# SPDX-License-Identifier: Apache-2.0
"""How long the heater stays off after doubt, and how often it may be switched on."""

from __future__ import annotations

from collections import deque

from bev_preheat.control.inputs import NS_PER_S
from bev_preheat.control.margins import (
    COUNTED_OVER_S,
    FIRST_WAIT_S,
    HOUR_S,
    LEAST_LONGEST_WAIT_S,
    MOST_SWITCH_ONS,
    SPACING_S,
)


class HeatingPause:
    """
    The pause after doubt, and the switch-ons of the last hour; instants in nanoseconds.

    Only time that passes forward counts: a clock that falls back neither ends a pause nor prolongs it.
    """

    def __init__(self) -> None:
        """Begin without any pause."""
        self._now_ns: int | None = None
        self._elapsed_ns = 0
        self._interruptions: deque[int] = deque()
        self._switch_ons: deque[int] = deque()
        self._doubted_ns: int | None = None
        self._wait_ns = 0
        self._cause = ''

    def let_time_pass(self, now_ns: int) -> None:
        """Note the time; a pause that is over is forgotten."""
        if self._now_ns is not None:
            self._elapsed_ns += max(0, now_ns - self._now_ns)
        self._now_ns = now_ns
        if self._doubt_left_ns() <= 0:
            self._doubted_ns = None
        for instants, kept_s in ((self._interruptions, COUNTED_OVER_S), (self._switch_ons, HOUR_S)):
            while instants and self._elapsed_ns - instants[0] >= kept_s * NS_PER_S:
                instants.popleft()

    def doubt(self, cause: str, was_on: bool, minimum_off_time_s: float) -> None:
        """
        Begin or restart a pause, for a cause in words.

        It gets longer with each interruption of heating within COUNTED_OVER_S.
        """
        if was_on:
            self._interruptions.append(self._elapsed_ns)
            longest_s = max(minimum_off_time_s, LEAST_LONGEST_WAIT_S)
            doublings = min(len(self._interruptions) - 1, 10)
            self._wait_ns = round(min(FIRST_WAIT_S * 2.0 ** doublings, longest_s) * NS_PER_S)
        if was_on or self._doubted_ns is not None:
            self._doubted_ns, self._cause = self._elapsed_ns, cause

    def note_switch_on(self) -> None:
        """Count that the heater was switched on."""
        self._switch_ons.append(self._elapsed_ns)

    @property
    def spacing_s(self) -> float:
        """The least time on, and off, that the switch-ons of the last hour ask for [s]."""
        return SPACING_S if len(self._switch_ons) >= MOST_SWITCH_ONS // 2 else 0.0

    @property
    def left_s(self) -> float:
        """For how long [s] the heater stays off; 0 if it may be switched on."""
        return max(self._doubt_left_ns(), self._hour_left_ns(), 0) / NS_PER_S

    @property
    def is_for_doubt(self) -> bool:
        """Whether the heater stays off because of doubt."""
        return self._doubt_left_ns() > 0

    @property
    def sentence(self) -> str:
        """Why the heater stays off, and until when; '' if it may be switched on."""
        if self._doubted_ns is not None and self._doubt_left_ns() > 0:
            ago_s = (self._elapsed_ns - self._doubted_ns) / NS_PER_S
            number = len(self._interruptions)
            again = f' (interruption {number} in {COUNTED_OVER_S / 60.0:g} min)' if number > 1 else ''
            return (f'{self._cause} {ago_s:.0f} s ago; heating resumes after {self._wait_ns / NS_PER_S:g} s of '
                    f'valid input{again}.')
        if self._hour_left_ns() > 0:
            return (f'The heater was switched on {MOST_SWITCH_ONS} times within an hour; the next time is '
                    f'possible in {self._hour_left_ns() / NS_PER_S:.0f} s.')
        return ''

    def _doubt_left_ns(self) -> int:
        if self._doubted_ns is None:
            return 0
        return self._doubted_ns + self._wait_ns - self._elapsed_ns

    def _hour_left_ns(self) -> int:
        if len(self._switch_ons) < MOST_SWITCH_ONS:
            return 0
        return self._switch_ons[0] + round(HOUR_S * NS_PER_S) - self._elapsed_ns
