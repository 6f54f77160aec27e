# SPDX-License-Identifier: Apache-2.0
"""
Whether the current and the state of charge move the same charge: a unit or a scale that is wrong by a factor.

Capacities, buffers and displayed charges differ by tens of per cent; the bound is a factor of three.
"""

from __future__ import annotations

from typing import NamedTuple

from bev_preheat.estimation.readings import Resolution, SOC_STEPS

# The two changes of the charge differ by at most this factor.
FACTOR = 3.0
# Least change of the state of charge that is compared: an absolute bound, and a number of the signal's steps.
LEAST_CHANGE, LEAST_STEPS = 0.02, 4.0
# Error of a change of the state of charge: an absolute one, and a number of steps.
ERROR, ERROR_STEPS = 0.002, 2.0
# A larger change from one state to the next is a correction by the battery management: the sum of an absolute
# one, a number of steps, and one for each second.
JUMP, JUMP_STEPS, JUMP_PER_S = 0.01, 2.5, 1.0 / 600.0
# States further apart than this are not compared, nor over a longer time [s]: a small current that is not measured
# adds up.
APART_S, LONGEST_S = 60.0, 3600.0
# Displays stay at 0 and 100 % while charge flows.
LOWEST_SOC, HIGHEST_SOC = 0.01, 0.99


class _ScaleSample(NamedTuple):
    instant_s: float
    current_a: float
    soc: float


class CurrentScale:
    """Compares current and state of charge; `doubt` is the sentence, '' while they agree."""

    def __init__(self, capacity_as: float) -> None:
        """Start without evidence; `capacity_as` [As] is that of the battery."""
        self.doubt = ''
        self._capacity_as = capacity_as
        self._steps = Resolution(SOC_STEPS)
        self._before: _ScaleSample | None = None
        self._first: _ScaleSample | None = None
        self._drawn = 0.0

    def lose_time(self) -> None:
        """Forget the latest state, because the next one does not follow it."""
        self._before = None

    def see(self, instant_s: float, current_a: float, soc: float) -> str:
        """Update with instant [s], current [A] and state of charge (0 ... 1); return `doubt`."""
        sample = _ScaleSample(instant_s, current_a, soc)
        before, self._before = self._before, sample
        self._steps.see(soc)
        if before is None or self._first is None or not self._follows(before, sample):
            self._begin(sample)
            return self.doubt
        self._drawn += 0.5 * (current_a + before.current_a) * (instant_s - before.instant_s) / self._capacity_as
        self._judge(abs(self._first.soc - soc), abs(self._drawn), sample)
        return self.doubt

    def _begin(self, sample: _ScaleSample) -> None:
        self._first, self._drawn = sample, 0.0

    def _follows(self, before: _ScaleSample, sample: _ScaleSample) -> bool:
        assert self._first is not None
        elapsed_s = sample.instant_s - before.instant_s
        return (0.0 < elapsed_s <= APART_S and sample.instant_s - self._first.instant_s <= LONGEST_S
                and LOWEST_SOC < sample.soc < HIGHEST_SOC and abs(sample.soc - before.soc)
                <= JUMP + JUMP_STEPS * self._steps.step + JUMP_PER_S * elapsed_s)

    def _judge(self, changed: float, drawn: float, sample: _ScaleSample) -> None:
        least = max(LEAST_CHANGE, LEAST_STEPS * self._steps.step)
        is_too_much = drawn >= FACTOR * max(least, changed + ERROR + ERROR_STEPS * self._steps.step)
        if not is_too_much and changed < least:
            return
        self.doubt = '' if not is_too_much and FACTOR * drawn >= changed else (
            f'current: it moved {100.0 * drawn:.1f} % of the charge while percentage changed by '
            f'{100.0 * changed:.1f} %; the unit or scale of either is wrong; voltage and current are not '
            'used')
        self._begin(sample)
