# SPDX-License-Identifier: Apache-2.0
"""
Whether the current has the expected sign: positive = discharging inside this software.

Two kinds of evidence. The voltage falls while the discharge current rises, by the resistance: in measured
drives their changes are correlated by -0.99. The state of charge falls while the battery
discharges. The latest proof counts.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
import math
from typing import NamedTuple

from bev_preheat.estimation.readings import Resolution, SOC_STEPS

# Number of latest changes of voltage and current that are correlated, and the least number for a proof.
# The states of a change are at most APART_S [s] apart. The standard deviation of the current's changes [A]
# must exceed the first bound for few changes, the second for all changes.
CHANGES, LEAST_CHANGES = 60, 20
APART_S = 2.5
LEAST_DEVIATION_A, LEAST_DEVIATION_OF_ALL_A = 5.0, 1.5
# Least magnitude of the correlation.
PROVES_CORRELATION = 0.7
# Least change of the state of charge: an absolute bound, a share of the signal's step, and a multiple of the
# standard deviation of its noise, which shows in consecutive states.
LEAST_MOVED = 0.0025
LEAST_STEPS = 0.9
LEAST_DEVIATIONS = 5.0
# Number of states over which the noise is averaged, and the largest change that counts as noise.
NOISE_OVER, MOST_NOISE = 30.0, 0.01
# Least share of this change that the current accounts for.
LEAST_SHARE = 0.25
CONFIRMED_EVERY_S = 10.0
# A change of the charge from one state to the next that exceeds this number of its steps and this multiple of the
# charge moved by the current, beside LEAST_MOVED and the noise, is a jump: a correction of the battery management.
JUMP_STEPS, JUMP_MOVED = 2.5, 3.0
# The comparison starts again after this charge without proof.
RESTART_AFTER = 0.05


class Sign(Enum):
    """State of knowledge about the sign of the current."""

    UNKNOWN = 'unknown'
    RIGHT = 'right'
    REVERSED = 'reversed'


class _SignSample(NamedTuple):
    instant_s: float
    voltage_v: float
    current_a: float


class CurrentSign:
    """Watches voltage, current and state of charge; `sign` is the Sign, `evidence` a sentence."""

    def __init__(self, capacity_as: float) -> None:
        """Start without evidence; `capacity_as` [As] is that of the battery."""
        self._capacity_as = capacity_as
        self.sign, self.evidence = Sign.UNKNOWN, ''
        self._changes: deque[tuple[float, float]] = deque(maxlen=CHANGES)
        self._before: _SignSample | None = None
        self._soc_steps = Resolution(SOC_STEPS)
        self._first_soc: float | None = None
        self._discharged = 0.0
        # Variance of the change of the state of charge from one state to the next.
        self._latest_soc: float | None = None
        self._noise = 0.0
        self._confirmed_s = -math.inf

    def lose_time(self) -> None:
        """Forget the latest state, because the next one does not follow it."""
        self._before = self._first_soc = None
        self._confirmed_s = -math.inf
        self._discharged = 0.0

    def see(self, instant_s: float, voltage_v: float, current_a: float, soc: float) -> Sign:
        """Update with instant [s], voltage [V], current [A], state of charge (0 ... 1); return the Sign."""
        before, self._before = self._before, _SignSample(instant_s, voltage_v, current_a)
        self._soc_steps.see(soc)
        if before is None or not 0.0 < instant_s - before.instant_s <= 60.0:
            self._first_soc, self._discharged = soc, 0.0
            return self.sign
        elapsed_s = instant_s - before.instant_s
        if elapsed_s <= APART_S:
            self._changes.append((voltage_v - before.voltage_v, current_a - before.current_a))
        moved = 0.5 * (current_a + before.current_a) * elapsed_s / self._capacity_as
        has_jumped = self._has_jumped(soc, moved)
        if self._latest_soc is not None and self._soc_steps.step == 0.0:
            self._noise += (min(abs(soc - self._latest_soc), MOST_NOISE)**2 - self._noise) / NOISE_OVER
        self._latest_soc = soc
        self._discharged += moved
        if has_jumped:
            # It tells nothing about the current.
            self._first_soc, self._discharged = soc, 0.0
        # A sign proved right is confirmed from time to time.
        if self.sign is not Sign.RIGHT or instant_s >= self._confirmed_s + CONFIRMED_EVERY_S:
            self._confirmed_s = instant_s
            self._judge_voltage()
        self._judge_charge(soc)
        return self.sign

    def _has_jumped(self, soc: float, moved: float) -> bool:
        if self._latest_soc is None:
            return False
        most = JUMP_MOVED * abs(moved) + max(
            LEAST_MOVED + JUMP_STEPS * self._soc_steps.step, 2.0 * LEAST_DEVIATIONS * math.sqrt(self._noise))
        return abs(soc - self._latest_soc) > most

    def _judge_voltage(self) -> None:
        count = len(self._changes)
        if count < LEAST_CHANGES:
            return
        voltages = current = mixed = 0.0
        for change_v, change_a in self._changes:
            voltages += change_v * change_v
            current += change_a * change_a
            mixed += change_v * change_a
        least_a = LEAST_DEVIATION_OF_ALL_A if count == CHANGES else LEAST_DEVIATION_A
        if voltages == 0.0 or current < count * least_a**2:
            return
        correlation = mixed / math.sqrt(voltages * current)
        if correlation > PROVES_CORRELATION:
            self._prove(Sign.REVERSED, 'the voltage rises while the current discharges more')
        elif correlation < -PROVES_CORRELATION:
            self._prove(Sign.RIGHT, '')

    def _judge_charge(self, soc: float) -> None:
        if self._first_soc is None:
            self._first_soc = soc
        fallen = self._first_soc - soc
        noise = math.sqrt(0.5 * self._noise)
        least = max(LEAST_MOVED, LEAST_STEPS * self._soc_steps.step, LEAST_DEVIATIONS * noise)
        if abs(fallen) < least or abs(self._discharged) < max(LEAST_SHARE * abs(fallen), 0.5 * least):
            if abs(self._discharged) > max(RESTART_AFTER, 3.0 * least):
                self._first_soc, self._discharged = soc, 0.0
            return
        if fallen * self._discharged > 0.0:
            self._prove(Sign.RIGHT, '')
        else:
            self._prove(Sign.REVERSED, (
                f'the state of charge {"fell" if fallen > 0.0 else "rose"} by {100 * abs(fallen):.1f} % while '
                f'the current says that it {"rises" if self._discharged < 0.0 else "falls"}'))
        self._first_soc, self._discharged = soc, 0.0

    def _prove(self, sign: Sign, evidence: str) -> None:
        self.sign, self.evidence = sign, evidence
