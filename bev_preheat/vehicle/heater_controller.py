# SPDX-License-Identifier: Apache-2.0
"""
The reference for executing the command: power for the heater, or 0 W and the reason.

Pure and small, to be reviewed in one sitting. docs/explanation/safety.md ("Requirements for the heater
controller") numbers the rules R1 ... R9 and names the test of each. `HeaterController.take` hears a command,
`HeaterController.step` is called every period and returns the power. A lease ends by two clocks, whichever is
first: the clock that stamps are made with, which may be set, and a steady one, which never is.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from enum import IntEnum
import math
from typing import NamedTuple

from bev_preheat.numerics import NS_PER_S

# The heater stays off for this time after a refused command [s], so that it does not flicker between valid and
# invalid ones; another sender counts as commanding for at least as long.
DOUBT_S = 2.0


class Refusal(IntEnum):
    """Why the active power is below the requested one; the numbers are those of HvchStatus."""

    NOT_REFUSED = 0
    NO_COMMAND = 1
    INVALID_COMMAND = 2
    INVALID_LEASE = 3
    COMMAND_CONFLICT = 4
    NOT_ACTIVE = 5
    HEATER_FAULT = 6
    LOW_CHARGE = 7
    HOT_BATTERY = 8
    IN_MOTION = 9
    CABIN_FIRST = 10
    RATE_LIMITED = 11
    STEP_OF_POWER = 12
    OTHER = 13


class Instant(NamedTuple):
    """An instant by the clock of the stamps and by a steady clock, each in nanoseconds."""

    clock_ns: int
    steady_ns: int


@dataclass(frozen=True)
class HeaterLimits:
    """
    The heater's own limits.

    Its maximum power [W], the rate at which its power may rise [W/s], its steps of power [W], ascending (():
    continuous), the longest lease accepted [s], and how far a stamp may lie ahead of the clock [s].
    """

    maximum_power_w: float
    rise_w_per_s: float = math.inf
    steps_w: tuple[float, ...] = ()
    longest_lease_s: float = 30.0
    clock_tolerance_s: float = 1.0


class HeaterCommand(NamedTuple):
    """Power [W], instant and end of the lease [ns of the stamps' clock], and which node sent it, if known."""

    power_w: float
    stamp_ns: int
    valid_until_ns: int
    sender: Hashable = None


class Verdict(NamedTuple):
    """A Refusal with its sentence."""

    refusal: Refusal
    sentence: str = ''


class HeaterAnswer(NamedTuple):
    """Power requested by the command in force and power to apply [W], and why they differ."""

    requested_w: float
    active_w: float
    refusal: Refusal = Refusal.NOT_REFUSED
    sentence: str = ''


def step_below_w(steps_w: Sequence[float], power_w: float) -> float:
    """Return the highest of a heater's steps of power that is at most `power_w` [W], or 0."""
    return power_w if not steps_w else max((step_w for step_w in steps_w if step_w <= power_w), default=0.0)


SERVED = Verdict(Refusal.NOT_REFUSED)
SILENT = Verdict(Refusal.NO_COMMAND, 'no valid command is in force')


class HeaterController:
    """Applies HeaterCommands within HeaterLimits; off until the first valid one."""

    def __init__(self, limits: HeaterLimits) -> None:
        """Start with the heater off."""
        self.limits = limits
        # The command in force and the end of its lease by the steady clock [ns]; None: 0 W.
        self._command: HeaterCommand | None = None
        self._ends_steady_ns = 0
        # The reason for 0 W.
        self._verdict = SILENT
        # Until when each sender counts as commanding, by the steady clock [ns].
        self._senders: dict[Hashable, int] = {}
        # Until when a refused command keeps the heater off, by the steady clock [ns].
        self._doubt_ends_ns = 0
        self._clock_ns: int | None = None
        self._stepped_ns: int | None = None
        self._ramp_w = 0.0

    def take(self, command: HeaterCommand, now: Instant) -> Verdict:
        """Take a command that arrived and return its Verdict; a refused one ends the lease of the one before."""
        self._watch_clock(now)
        verdict = self._judge(command, now)
        lease_ns = min(max(command.valid_until_ns - command.stamp_ns, 0), round(
            self.limits.longest_lease_s * NS_PER_S))
        doubt_ns = round(DOUBT_S * NS_PER_S)
        self._senders[command.sender] = now.steady_ns + max(lease_ns, doubt_ns)
        if self._conflict(now):
            return self._verdict
        if verdict.refusal is not Refusal.NOT_REFUSED:
            self._doubt_ends_ns = now.steady_ns + doubt_ns
            self._drop(verdict)
            return verdict
        if now.steady_ns < self._doubt_ends_ns:
            return verdict
        self._command = command
        # R1: never longer than from its stamp, or from now, whichever leaves less.
        self._ends_steady_ns = now.steady_ns + min(command.valid_until_ns - now.clock_ns, lease_ns)
        return verdict

    def lease_left_s(self, now: Instant) -> float:
        """Return for how long the command in force may still be applied [s]; 0 without one."""
        if self._command is None:
            return 0.0
        return max(0, min(self._command.valid_until_ns - now.clock_ns,
                          self._ends_steady_ns - now.steady_ns)) / NS_PER_S

    def lose_sender(self, sentence: str) -> None:
        """End the lease because the middleware reports a missed deadline or a lost liveliness (R7)."""
        self._drop(Verdict(Refusal.NO_COMMAND, sentence))

    def step(self, now: Instant, available_w: float = math.inf, obstacle: Verdict = SERVED) -> HeaterAnswer:
        """
        Return the HeaterAnswer of an instant; call it every period.

        `available_w` [W] is the power that the cabin leaves (R8), `obstacle` the car's own reason for 0 W (R9).
        """
        elapsed_s = 0.0 if self._stepped_ns is None else (now.steady_ns - self._stepped_ns) / NS_PER_S
        self._stepped_ns = now.steady_ns
        self._watch_clock(now)
        self._conflict(now)
        command = self._command
        # R1, R2: silence ends the lease, by either clock.
        if command is not None and not (now.clock_ns < command.valid_until_ns
                                        and now.steady_ns < self._ends_steady_ns):
            self._drop(Verdict(Refusal.NO_COMMAND, 'the lease of the latest command has ended'))
            command = None
        if command is None:
            self._ramp_w = 0.0
            return HeaterAnswer(0.0, 0.0, *self._verdict)
        if obstacle.refusal is not Refusal.NOT_REFUSED:
            self._ramp_w = 0.0
            return HeaterAnswer(command.power_w, 0.0, *obstacle)
        return self._apply(command.power_w, available_w, elapsed_s)

    def _apply(self, requested_w: float, available_w: float, elapsed_s: float) -> HeaterAnswer:
        """Return the answer to a valid request, within cabin, rate and steps of power."""
        # A comparison with NaN is false: no power is available then.
        left_w = max(available_w, 0.0) if available_w >= 0.0 else 0.0
        allowed_w = min(requested_w, left_w)
        # R5: the power rises at the limited rate, and falls at once.
        limit_w = self._ramp_w + self.limits.rise_w_per_s * elapsed_s if elapsed_s > 0.0 else self._ramp_w
        self._ramp_w = min(allowed_w, math.inf if math.isinf(self.limits.rise_w_per_s) else limit_w)
        active_w = step_below_w(self.limits.steps_w, self._ramp_w)
        if active_w == requested_w:
            return HeaterAnswer(requested_w, active_w)
        if allowed_w < requested_w:
            return HeaterAnswer(requested_w, active_w, Refusal.CABIN_FIRST,
                                f'the cabin leaves {left_w:.0f} W of the heater')
        if self._ramp_w < allowed_w:
            return HeaterAnswer(requested_w, active_w, Refusal.RATE_LIMITED,
                                f'the power rises by at most {self.limits.rise_w_per_s:g} W/s')
        return HeaterAnswer(requested_w, active_w, Refusal.STEP_OF_POWER,
                            f'the next lower step of power is {active_w:g} W')

    def _judge(self, command: HeaterCommand, now: Instant) -> Verdict:
        """Return the Verdict on a command as it arrives (R3, R4)."""
        power_w, most_w = command.power_w, self.limits.maximum_power_w
        if not 0.0 <= power_w <= most_w:
            return Verdict(Refusal.INVALID_COMMAND, f'battery_heating_power: {power_w:g} W is not allowed; it '
                           f'must be 0 ... {most_w:g} W')
        left_s = (command.valid_until_ns - now.clock_ns) / NS_PER_S
        ahead_s = (command.stamp_ns - now.clock_ns) / NS_PER_S
        problem = ''
        if command.stamp_ns <= 0:
            problem = 'header.stamp: is not set'
        elif left_s <= 0.0:
            problem = f'valid_until: is {abs(left_s):.3f} s in the past'
        elif ahead_s > self.limits.clock_tolerance_s:
            problem = (f'header.stamp: is {ahead_s:.3f} s ahead of the clock; at most '
                       f'{self.limits.clock_tolerance_s:g} s are allowed')
        elif max(left_s, left_s - ahead_s) > self.limits.longest_lease_s + self.limits.clock_tolerance_s:
            problem = (f'valid_until: a lease of {max(left_s, left_s - ahead_s):.3f} s is too long; at most '
                       f'{self.limits.longest_lease_s:g} s are allowed')
        elif self._command is not None and command.stamp_ns < self._command.stamp_ns:
            problem = (f'header.stamp: is {(self._command.stamp_ns - command.stamp_ns) / NS_PER_S:.3f} s before '
                       'that of the command in force')
        return Verdict(Refusal.INVALID_LEASE, problem) if problem else SERVED

    def _conflict(self, now: Instant) -> bool:
        """Return whether two nodes command the heater (R6); if so, no command is in force."""
        self._senders = {sender: until for sender, until in self._senders.items() if now.steady_ns < until}
        if len(self._senders) > 1:
            self._drop(Verdict(Refusal.COMMAND_CONFLICT, f'{len(self._senders)} nodes command the heater'))
            return True
        if self._verdict.refusal is Refusal.COMMAND_CONFLICT:
            self._verdict = Verdict(Refusal.NO_COMMAND, 'no valid command has arrived since two nodes commanded')
        return False

    def _watch_clock(self, now: Instant) -> None:
        """End the lease if the clock of the stamps was set back: its instants mean nothing any more."""
        last_ns, self._clock_ns = self._clock_ns, now.clock_ns
        if last_ns is not None and now.clock_ns < last_ns and self._command is not None:
            self._drop(Verdict(Refusal.INVALID_LEASE,
                               f'the clock was set back by {(last_ns - now.clock_ns) / NS_PER_S:.3f} s'))

    def _drop(self, verdict: Verdict) -> None:
        self._command, self._verdict = None, verdict
