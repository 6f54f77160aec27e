# SPDX-License-Identifier: Apache-2.0
"""Keeps the heater from being switched too often, and off for a while after doubt."""

from __future__ import annotations

from collections import deque

from bev_preheat.control.margins import (
    COUNTED_OVER_S,
    FIRST_WAIT_S,
    HOUR_S,
    LEAST_LONGEST_WAIT_S,
    MOST_SWITCH_ONS,
    SPACING_S,
)
from bev_preheat.numerics.factors import NS_PER_S


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


class HeaterSwitch:
    """
    Least times on and off between a plan's request and the command; instants in nanoseconds.

    They delay requests, never a forced shutdown: `force_off` and `doubt` take effect at once. After a
    `doubt` the heater stays off for a while, whatever is requested.
    """

    def __init__(self) -> None:
        """Start with the heater off."""
        self.is_on = False
        # On only because of the least time.
        self.is_held = False
        self.pause = HeatingPause()
        self._since_ns: int | None = None
        self._power_w = 0.0

    def force_off(self) -> None:
        """Switch off because no heating is needed, or the driver does not want it."""
        self.is_on = self.is_held = False
        self._since_ns, self._power_w = None, 0.0

    def turn_off(self, now_ns: int) -> None:
        """Switch off at once because the plan has no more use for heat; the least time off begins."""
        was_on = self.is_on
        since_ns = self._since_ns
        self.force_off()
        self._since_ns = now_ns if was_on else since_ns

    def doubt(self, now_ns: int, cause: str, minimum_off_time_s: float) -> None:
        """Switch off because something is in doubt, for a cause in words; a pause begins."""
        self.pause.let_time_pass(now_ns)
        self.pause.doubt(cause, self.is_on, minimum_off_time_s)
        self.force_off()

    def allow(self) -> None:
        """Let the heater be switched at once: the reason to wait no longer holds; a pause continues."""
        self._since_ns = None

    def power_w(self, now_ns: int, wanted_w: float, limit_w: float, minimum_on_time_s: float,
                minimum_off_time_s: float) -> float:
        """
        Return the power [W] to command: `wanted_w`, unless the latest switching was too recent.

        A heater held on keeps its power, up to `limit_w` [W].
        """
        self.pause.let_time_pass(now_ns)
        wants_on = wanted_w > 0.0
        if wants_on != self.is_on and not self._must_wait(
                now_ns, self._least_s(minimum_on_time_s if self.is_on else minimum_off_time_s)) and not (
                wants_on and self.pause.left_s > 0.0):
            self.is_on, self._since_ns = wants_on, now_ns
            if wants_on:
                self.pause.note_switch_on()
        self.is_held = self.is_on and not wants_on
        if not self.is_on:
            return 0.0
        if wants_on:
            self._power_w = wanted_w
        self._power_w = min(self._power_w, limit_w)
        return self._power_w

    def held_for_s(self, now_ns: int, minimum_on_time_s: float, minimum_off_time_s: float) -> float:
        """Return the time [s] until the heater may be switched again."""
        if self._since_ns is None:
            return 0.0
        least_s = self._least_s(minimum_on_time_s if self.is_on else minimum_off_time_s)
        return max(0.0, least_s - (now_ns - self._since_ns) / NS_PER_S)

    def _least_s(self, minimum_s: float) -> float:
        return max(minimum_s, self.pause.spacing_s)

    def _must_wait(self, now_ns: int, least_s: float) -> bool:
        # After the clock was set back the time since the last switching is unknown.
        return (self._since_ns is not None
                and 0 <= now_ns - self._since_ns < round(least_s * NS_PER_S))
